"""What a few moves of a fit found, fitted to all, and what is begun once more where another fit ended."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from service.backlash.moves import moves_of
from service.backlash.moves_fit import fit, values_at
from service.backlash.moves_point import Point
from service.captures import read_capture
from service.dynamics.driven_model import Model
from service.dynamics.effects.driven_library import DRIVEN
from service.identification import moves_carried
from service.identification.moves_end import HOWEVER_FAR
from service.identification.moves_looks import Brief
from tests.service.identification.a_search import stub


def test_what_acts_one_way_is_begun_in_the_name_of_each_effect_that_is_alike() -> None:
    """While an axis moves, −s·(F_C + s·A) = −s·F_C − A: an asymmetry A is a constant force −A."""
    place = {"X1.constant_force": 0.8, "X1.spring_rate": 3.0, "X1.coulomb": 1.0}
    begun = {
        name: dict(DRIVEN[name](("X1",)).instead(place))
        for name in ("constant_force", "position_dependent_force", "asymmetric_friction", "sensor_gain")
    }
    assert begun["constant_force"] == {"X1.constant_force": 0.8}
    assert begun["position_dependent_force"] == {"X1.spring_preload": 0.8}
    assert begun["asymmetric_friction"] == {"X1.coulomb_asymmetry": -0.8, "X1.viscous_asymmetry": 0.0}
    assert begun["sensor_gain"] == {}
    assert not DRIVEN["constant_force"](("X1",)).instead({"X1.coulomb": 1.0})


@pytest.mark.usefixtures("sound")
def test_a_candidate_far_from_a_few_moves_is_not_fitted_to_all(monkeypatch: Any) -> None:
    rounds: list[int] = []
    monkeypatch.setattr(moves_carried, "unanswering", lambda moves: moves)
    monkeypatch.setattr(
        moves_carried, "carried", lambda _moves, brief, n: rounds.append(n) or stub(brief.rms)
    )
    monkeypatch.setattr(moves_carried, "glanced_at", lambda _found, brief: brief)
    near, far = [stub(1.5), stub(3.0)], [stub(4.0), stub(4.1)]
    assert moves_carried.refitted(stub(6.0), far, 1.5) == far[:1]
    assert not rounds
    moves_carried.refitted(stub(6.0), near, 1.5)
    assert rounds == [moves_carried.FIRST_ROUNDS]


@pytest.mark.usefixtures("sound")
def test_of_an_effect_with_many_valleys_a_fit_in_each_is_judged(monkeypatch: Any) -> None:
    """How near a few moves come, with the motor's motion that the present fit makes, says little of them; one that the
    motors speak against is none, however near it is."""
    ended, by_motors = {1.5: 1.2, 1.6: 1.0, 1.7: 1.1, 1.8: 0.9}, {1.2: 2.1, 1.0: 2.0, 1.1: 2.0, 0.9: 4.0}

    def asked(found: Any, asked: bool) -> float:
        assert asked
        return float(found.rms)

    def fit(rms: float, *_: Any) -> Any:
        found = stub(ended[rms])
        found.rms_with_motors = by_motors[found.rms]
        return found

    monkeypatch.setattr(moves_carried, "carried", lambda _moves, brief, _rounds: brief)
    monkeypatch.setattr(moves_carried, "reconstructed", asked)
    monkeypatch.setattr(moves_carried, "fit", fit)
    near = [stub(rms) for rms in (*ended, 3.0)]
    assert [f.rms for f in moves_carried.refitted(stub(6.0), near, 2.0)] == [1.5]
    for one in near:
        one.model.effects = (SimpleNamespace(many_valleys=True),)
    assert [f.rms for f in moves_carried.refitted(stub(6.0), near, 2.0)] == [1.0, 1.1, 1.2]


def test_a_glance_moves_no_wrong_start_away_but_takes_the_zeros_along(shared_dir: Path) -> None:
    """The moves begin where the fit of a few says or where they begin now, each where it is described best."""
    moves = moves_of(read_capture(shared_dir / "captures" / "none-train.parquet"), ("X1",))
    model = Model(("X1",), 2, held=("constant", "skew"))
    now = fit([moves], model, Point(np.zeros(len(model.parameters)), (np.zeros((len(moves.grids), 2)),)), 3)
    far = tuple(np.full_like(local, 8.0) for local in now.at.local)
    brief = Brief(model, 9.0, values_at(now), far)
    assert moves_carried.glanced_at(now, brief).rms < 1.05 * now.rms
    lost = fit([moves], model, Point(now.at.shared, far), 0)
    assert lost.rms > 2.0 * now.rms


def test_an_effect_is_begun_again_where_one_ended_that_contains_it(monkeypatch: Any) -> None:
    begun: list[dict[str, float]] = []

    def fitted_from(_found: Any, values: dict[str, float], _rounds: int) -> Any:
        begun.append(values)
        return stub(1.1)

    monkeypatch.setattr(moves_carried, "values_at", lambda _f: {"X1.spring_preload": 0.2, "X1.coulomb": 0.3})
    monkeypatch.setattr(moves_carried, "fitted_from", fitted_from)
    inner = stub(1.6)
    inner.model = SimpleNamespace(effects=(DRIVEN["constant_force"](("X1",)),))
    assert moves_carried.as_other(inner, stub(1.8)).rms == 1.6
    assert not begun, "what contains it is no nearer"
    assert moves_carried.as_other(inner, stub(1.2)).rms == 1.1
    assert begun[0]["X1.constant_force"] == 0.2
    assert begun[0]["X1.coulomb"] == 0.3


@pytest.mark.parametrize(
    ("glimpse", "rounds"), [(2.1, [moves_carried.GLIMPSE]), (1.9, [moves_carried.GLIMPSE, 3])]
)
def test_what_is_far_off_on_the_ground_of_the_best_is_not_followed(
    monkeypatch: Any, glimpse: float, rounds: list[int]
) -> None:
    asked: list[int] = []

    def fit(_moves: Any, _model: Any, _at: Any, rounds: int) -> Any:
        asked.append(rounds)
        return stub(glimpse)

    candidate: Any = SimpleNamespace(model="with the effect")
    monkeypatch.setattr(moves_carried, "placed", lambda ground, _candidate: ground)
    monkeypatch.setattr(moves_carried, "fit", fit)
    first = stub(2.0)
    assert moves_carried.seconded(stub(6.0), first, candidate, nearest=2.0, far=2.0) is first
    assert asked == rounds


@pytest.mark.parametrize(
    ("rms", "led"), [(11.0, True), (25.0, False), (1.04, False)], ids=["a part", "hardly any", "near"]
)
def test_what_couples_two_axes_is_led_on_first_where_it_takes_a_part(
    monkeypatch: Any, rms: float, led: bool
) -> None:
    """28 of the noise without a bridge: what is near is ended later, as all are; what takes nothing is none."""
    found = cast(Any, SimpleNamespace(moves=(), rms=28.0))
    candidate = cast(Any, SimpleNamespace(model="coupled"))
    monkeypatch.setattr(moves_carried, "unanswering", lambda moves: moves)
    monkeypatch.setattr(moves_carried, "point_at", lambda *_: "estimator's")
    monkeypatch.setattr(moves_carried, "rests_found", lambda *_: "rests")
    monkeypatch.setattr(moves_carried, "fit", lambda *_, **__: SimpleNamespace(at="at", rms=rms))
    monkeypatch.setattr(moves_carried, "with_own_errors", lambda one: one)
    monkeypatch.setattr(moves_carried, "settled", lambda _one, _rounds, ridges: ("led", ridges))
    scene = cast(Any, SimpleNamespace(coupled={}))
    coupled = cast(Any, moves_carried.as_coupled(scene, found, candidate))
    assert (coupled == ("led", HOWEVER_FAR)) is led
