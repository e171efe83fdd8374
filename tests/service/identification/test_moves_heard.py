"""What is heard to swing between the moves, fitted to all moves from typical machines."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import pytest

from service.backlash.moves import Moves, moves_of
from service.backlash.moves_begun import point_at, shared_at
from service.backlash.moves_fit import Fitted, fit
from service.backlash.moves_point import Point, resting
from service.dynamics.driven_model import Model
from service.dynamics.effects.driven_bodies import DrivenHungMass, DrivenMachineBody
from service.dynamics.effects.driven_sensors import DrivenLatency
from service.identification.moves_heard import at_first, heard
from service.identification.moves_rests import begun_as_left
from service.identification.moves_starts import Candidate
from service.identification.scene import Scene
from service.recording import Recording
from tests.service.identification.a_machine import MACHINE, as_heard, swinging_through

BODY = {"body_ratio": 0.3, "body_frequency": 9.0, "body_damping": 0.02}


def candidate(kind: type[DrivenHungMass] | type[DrivenMachineBody] | type[DrivenLatency]) -> Candidate:
    effect = kind(("X1",))
    return Candidate(effect, Model(("X1",), 1, (effect,), "whole_move", ("constant", "skew"), bridge=False))


@pytest.fixture(scope="module")
def on_a_body(captures: tuple[Recording, Recording]) -> Fitted:
    """Moves of a machine on a body that swings on from move to move, at the machine."""
    model, moves = candidate(DrivenMachineBody).model, moves_of(captures[0], ("X1",))
    return swinging_through(moves, model, Point(shared_at(model, MACHINE | BODY), resting([moves], model)))


def test_what_an_effect_may_have_or_not_beside_its_amounts_is_fitted_last() -> None:
    for kind, held in ((DrivenMachineBody, {"body_drive_ratio"}), (DrivenHungMass, set())):
        one = candidate(kind)
        names = [p.name for p in one.model.parameters]
        assert set(names) - {names[k] for k in at_first(one)} == held


def test_how_moves_go_on_from_one_to_the_next_leads_to_the_swing(on_a_body: Fitted) -> None:
    """Begun nearly a hundredth off, as what is heard may be, it ends within two thousandths, and the moves are
    described: how closely it comes beyond that depends on where it began. After so many rounds whatever the processor,
    while after half of them one has arrived and the other is on its way."""
    model, moves = on_a_body.model, [as_heard(on_a_body)]
    begun = point_at(model, MACHINE | BODY | {"body_ratio": 0.28, "body_frequency": 9.08}, moves)
    first = fit(moves, model, begun, 3)
    together = begun_as_left(first, 16)
    assert together.rms < 0.3 * first.rms
    assert together.rms < 1.01
    assert together.value("body_frequency") == pytest.approx(9.0, rel=0.002)
    assert begun_as_left(together, 2).rms <= together.rms


def test_nothing_is_fitted_where_nothing_is_heard_or_nothing_swings(on_a_body: Fitted) -> None:
    moves: list[Moves] = list(on_a_body.moves)
    still = cast(Scene, SimpleNamespace(heard=None))
    assert heard(still, on_a_body, candidate(DrivenMachineBody)) == []
    some = cast(Any, SimpleNamespace(heard=9.0))
    late = candidate(DrivenLatency)
    at = Point(shared_at(late.model, MACHINE), resting(moves, late.model))
    assert heard(some, fit(moves, late.model, at, 0), late) == []
