"""What a prediction of moves may see that were not fitted, and what it doubts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from service.backlash.moves import Moves, moves_of
from service.backlash.moves_begun import shared_at
from service.backlash.moves_fit import Fitted, fit
from service.backlash.moves_parts import early_part
from service.backlash.moves_point import Point, resting
from service.backlash.moves_predicted import REST_SPREAD, predict
from service.backlash.moves_refined import reconstructed, rests_found
from service.dynamics.driven_model import Model
from service.dynamics.effects.driven_bodies import DrivenMachineBody
from service.dynamics.effects.driven_sensors import DrivenBias
from service.identification.held_out import (
    IN_THE_GAP,
    NEAR,
    TURNS,
    Explained,
    Held,
    held_out,
    rms,
    told_by_train,
    zeros_found,
)
from service.recording import FloatArray, Recording, Trace
from tests.service.identification.a_machine import MACHINE, as_heard, swinging_through

LOST = 8.0
"""Where a load is put that a fit does not bring back, over its prior."""


@pytest.fixture(scope="module")
def moves(captures: tuple[Recording, Recording]) -> Moves:
    return moves_of(captures[0], ("X1",))


def altered(recording: Recording, from_share: float) -> Recording:
    """The recording with nonsense in the acceleration of every move from a share of it on."""
    trace = recording.traces["X1", "acceleration"]
    value = trace.value.copy()
    for move in recording.moves:
        late = (trace.time > move.start + from_share * move.duration) & (trace.time <= move.end)
        value[late] = 3.0
    return replace(recording, traces={**recording.traces, ("X1", "acceleration"): Trace(trace.time, value)})


def test_a_prediction_does_not_see_the_acceleration_that_it_predicts(
    captures: tuple[Recording, Recording], found: Fitted
) -> None:
    honest = held_out(moves_of(captures[1], ("X1",)), found)
    blind = held_out(moves_of(altered(captures[1], 0.46), ("X1",)), found)
    np.testing.assert_allclose(blind.predicted, honest.predicted, rtol=0.0, atol=1e-9)


def test_a_prediction_is_doubted_by_as_much_as_numbers_within_their_spread_change_it(
    captures: tuple[Recording, Recording], found: Fitted
) -> None:
    validate, rng = moves_of(captures[1], ("X1",)), np.random.default_rng(2)
    held = held_out(validate, found, thorough=False)
    known = np.linalg.cholesky(told_by_train(found) + 1e-12 * np.eye(len(found.at.shared)))
    others = []
    for _ in range(16):
        shared = found.at.shared + known @ rng.standard_normal(len(found.at.shared))
        other = replace(found, at=replace(found.at, shared=shared))
        others.append(held_out(validate, other, thorough=False).predicted - held.predicted)
    spread = np.sqrt(np.mean(np.square(others), axis=0)) / validate.noise[:, None] / validate.expected
    late = validate.used & ~early_part_mask(validate)
    expected = np.sqrt(np.mean(held.doubted[late] ** 2))
    assert np.sqrt(np.mean(spread[late] ** 2)) == pytest.approx(expected, rel=0.5)


def test_what_is_announced_holds_the_noise_of_all_channels_by_the_model_itself_and_its_doubts(
    captures: tuple[Recording, Recording], found: Fitted, monkeypatch: pytest.MonkeyPatch
) -> None:
    moves = moves_of(captures[1], ("X1",))
    moves = replace(moves, expected=np.full_like(moves.expected, 2.0))
    doubted = np.where(np.arange(moves.samples) % 2, 0.0, 4.0) * np.ones_like(moves.expected)

    as_simulated, at = replace(moves), Point(found.at.shared, found.at.local[:1])

    def by_itself(of: Moves, _model: Model, *point: FloatArray, fitted: bool) -> Any:
        assert of is as_simulated and point[0] is at.shared and point[1] is at.local[0]
        return SimpleNamespace(acceleration=np.full_like(of.expected, 6.0 + fitted))

    monkeypatch.setattr("service.identification.held_out.expected_errors", by_itself)
    explained = Explained(found, Held(moves, np.zeros_like(moves.expected), doubted, as_simulated, at))
    assert explained.announced == pytest.approx([np.sqrt(0.5 * (36.0 + 100.0))], rel=0.01)


def early_part_mask(moves: Moves) -> FloatArray:
    mask = np.zeros(moves.used.shape, dtype=bool)
    early = early_part(moves, 0.45).used
    mask[..., : early.shape[-1]] = early
    return mask


def test_a_held_out_move_that_is_begun_behind_the_wrong_flank_finds_where_its_load_lay(
    captures: tuple[Recording, Recording], found: Fitted, monkeypatch: pytest.MonkeyPatch
) -> None:
    """So it does beside a sensor's zero that is found again, which else makes up for the wrong place."""
    beyond = -0.2 * found.value("X1.backlash") / REST_SPREAD[0]

    def misplaced(moves: Sequence[Moves], model: Model, at: Point, among: Sequence[float] = ()) -> Point:
        if among == (IN_THE_GAP,):
            return rests_found(moves, model, at, among)
        local = [own.copy() for own in at.local]
        for part, own in zip(moves, local, strict=True):
            own[:, 0] = part.s * beyond
        return Point(at.shared, tuple(local))

    model = replace(found.model, effects=(*found.model.effects, DrivenBias(("X1",))))
    at = Point(
        np.append(found.at.shared, 0.0), tuple(np.pad(own, ((0, 0), (0, 1))) for own in found.at.local)
    )
    wandering = fit(found.moves, model, at, 2)
    validate = moves_of(captures[1], ("X1",))
    right = rms(held_out(validate, wandering, thorough=False).weighed)
    monkeypatch.setattr("service.identification.held_out.rests_found", misplaced)
    assert rms(held_out(validate, wandering, thorough=False).weighed) == pytest.approx(right, rel=0.01)


def test_loads_that_are_not_found_by_themselves_lie_as_in_the_train_moves(
    captures: tuple[Recording, Recording], found: Fitted, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where two axes with a bridge rest tells only once it is known where the other one does: of a seed's gantry, whose
    numbers were all right, the held-out moves were left at 19 of the noise."""
    validate = moves_of(captures[1], ("X1",))
    right = rms(held_out(validate, found, thorough=False).weighed)

    def lost(moves: Sequence[Moves], model: Model, at: Point, among: Sequence[float] = ()) -> Point:
        return Point(at.shared, tuple(np.full_like(own, LOST) for own in at.local))

    monkeypatch.setattr("service.identification.held_out.rests_found", lost)
    assert rms(held_out(validate, found, thorough=False).weighed) == pytest.approx(right, rel=0.02)
    monkeypatch.setattr("service.identification.held_out.zeros_alike", lambda *_: ())
    assert rms(held_out(validate, found, thorough=False).weighed) > NEAR


def test_zeros_that_describe_every_move_are_looked_for_nowhere_else(
    captures: tuple[Recording, Recording], found: Fitted, monkeypatch: pytest.MonkeyPatch
) -> None:
    early, searched = [early_part(moves_of(captures[1], ("X1",)), 0.45)], list[int]()

    def counted(*arguments: Any, **named: Any) -> Point:
        searched.append(1)
        return rests_found(*arguments, **named)

    monkeypatch.setattr("service.identification.held_out.rests_found", counted)
    nothing = np.zeros(0, dtype=np.int64)
    begun = rests_found(early, found.model, Point(found.at.shared, resting(early, found.model)))
    at = zeros_found(early, found.model, begun, nothing)
    assert not searched
    lost = Point(begun.shared, tuple(np.where(np.arange(len(o))[:, None] == 3, LOST, o) for o in begun.local))
    again = zeros_found(early, found.model, lost, nothing)
    assert searched, "one move that is begun wrong among ten"
    assert fit(early, found.model, again, 0).rms == pytest.approx(
        fit(early, found.model, at, 0).rms, rel=0.01
    )


@pytest.mark.parametrize(("friction", "agreed"), [(1.0, True), (9.0, False)])
def test_the_motion_in_held_out_moves_follows_the_force_until_both_agree(
    captures: tuple[Recording, Recording],
    found: Fitted,
    monkeypatch: pytest.MonkeyPatch,
    friction: float,
    agreed: bool,
) -> None:
    """Not for a model that is far from their first part: it is not the right one."""
    shared = found.at.shared.copy()
    k = [p.name for p in found.model.parameters].index("X1.coulomb")
    shared[k] = found.model.parameters[k].internal(friction * found.value("X1.coulomb"))
    follows: list[bool] = []

    def noted(one: Fitted, follow: bool = True) -> tuple[Moves, ...]:
        follows.append(follow)
        return reconstructed(one, follow)

    monkeypatch.setattr("service.identification.held_out.reconstructed", noted)
    said = held_out(moves_of(captures[1], ("X1",)), replace(found, at=Point(shared, found.at.local)))
    assert follows[:2] == [False, False]
    assert follows[2:] == [True] * len(follows[2:])
    assert bool(follows[2:]) == agreed
    assert len(follows) < TURNS
    assert (rms(said.weighed) < 1.5) == agreed


def on_a_body(moves: Moves, faster: float) -> tuple[Fitted, Moves]:
    """A machine on a body that swings on from move to move, known as so much faster than it is; and moves in which the
    sensor feels it, also before they begin."""
    model = Model(("X1",), 1, (DrivenMachineBody(("X1",)),), "whole_move", ("constant", "skew"), bridge=False)
    body = {"body_ratio": 0.3, "body_frequency": 9.0, "body_damping": 0.012}
    machine = swinging_through(moves, model, Point(shared_at(model, MACHINE | body), resting([moves], model)))
    body["body_frequency"] *= faster
    at = Point(shared_at(model, MACHINE | body), machine.at.local)
    return fit(machine.moves, model, at, 0), as_heard(machine)


@pytest.mark.parametrize(("faster", "most"), [(1.0, 4.0), (1.003, 12.0)])
def test_every_held_out_move_begins_with_the_swing_that_the_move_before_left(
    moves: Moves, faster: float, most: float
) -> None:
    """Or with what is heard, where a number that is a little off leads astray: ten moves lie behind the last one."""
    machine, felt = on_a_body(moves, faster)
    still = np.zeros((1, *machine.at.local[0].shape))
    blind = predict(replace(felt, heard={}), machine.model, machine.at.shared[None], still).acceleration()[0]
    off = np.where(felt.used, felt.measured - blind, np.nan) / felt.noise[:, None]
    assert rms(off[-1]) > 5.0 * most, "something swings"
    assert max(rms(one) for one in held_out(felt, machine).errors) < most


@pytest.mark.filterwarnings("error")
def test_an_rms_is_of_what_is_there() -> None:
    assert rms(np.array([3.0, np.nan, -4.0])) == pytest.approx(np.sqrt(12.5))
    assert np.isnan(rms(np.full(3, np.nan)))
    assert np.isinf(rms(np.array([1.0, np.inf])))
