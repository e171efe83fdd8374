"""The search for an effect whose fits have many valleys."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from service.dynamics.driven_model import Model
from service.dynamics.effects.driven_library import DRIVEN
from service.identification import moves_starts, moves_valleys
from service.identification.moves_valleys import (
    APART,
    DRAWN,
    DRAWN_FITTED,
    FITTED,
    LEAST,
    POPULATION,
    Begun,
    by_rests,
    fitted_best,
    survivors,
    typical_machines,
    valleys,
)

CLEARANCE = DRIVEN["gearbox_clearance"](("X1",))
VALUES = {
    "X1.backlash": 4e-5,
    "X1.clearance": 2e-5,
    "X1.pinion_mass": 0.03,
    "X1.pinion_friction": 0.02,
    "X1.gear_mass": 0.1,
}


def one(rms: float, clearance: float) -> Any:
    values = {"X1.clearance": clearance}
    return cast(Any, SimpleNamespace(rms_with_motors=rms, value=lambda name: values[name]))


def test_of_fits_that_ended_alike_the_best_lives_on() -> None:
    fits = [one(1.2, 20e-6), one(1.0, 20.5e-6), one(1.4, 30e-6), one(1.1, 30.1e-6), one(1.3, 40e-6)]
    alive = survivors(fits, cast(Any, SimpleNamespace(effect=CLEARANCE)))
    assert [f.rms_with_motors for f in alive] == [1.0, 1.1, 1.3]
    many = [one(1.0 + k / 10, 1e-6 * (1 + 2 * APART) ** k) for k in range(2 * POPULATION)]
    assert len(survivors(many, cast(Any, SimpleNamespace(effect=CLEARANCE)))) == POPULATION
    gone = [one(1.0, 0.0), one(1.1, 1e-5)]
    assert len(survivors(gone, cast(Any, SimpleNamespace(effect=CLEARANCE)))) == 2, (
        "no gap at all is one valley"
    )


def test_the_best_after_a_few_rounds_go_on_from_their_rests(monkeypatch: pytest.MonkeyPatch) -> None:
    """How near a set comes as it is says little."""
    monkeypatch.setattr(
        moves_valleys, "fit", lambda _few, _model, at, _rounds: SimpleNamespace(rms_with_motors=at)
    )
    monkeypatch.setattr(moves_valleys, "by_rests", lambda _few, found: found.rms_with_motors - 0.5)
    begun: Any = [3.0, 4.0, 2.0]
    found: Any = fitted_best((), cast(Any, SimpleNamespace(model="model")), begun, 2, 2)
    assert found == [1.5, 2.5], "the third is given up"


def test_a_fit_that_goes_uphill_from_its_rests_stays_where_it_was(monkeypatch: pytest.MonkeyPatch) -> None:
    left = iter((1.4, 0.9, 1.2))
    monkeypatch.setattr(moves_valleys, "lying_as_left", lambda few, _model, at: (few, at))
    monkeypatch.setattr(moves_valleys, "as_anywhere", lambda found: found.at)

    def fit(_moves: Any, _model: Any, at: Any, rounds: int) -> Any:
        rms = next(left) if rounds else at
        return SimpleNamespace(rms_with_motors=rms, model="model", at=rms)

    monkeypatch.setattr(moves_valleys, "fit", fit)
    first: Any = SimpleNamespace(rms_with_motors=1.3, model="model", at=1.3)
    assert by_rests((), first).rms_with_motors == 0.9


def test_two_gaps_divide_anew_and_keep_their_sum() -> None:
    rng = np.random.default_rng(3)
    found = [CLEARANCE.varied(VALUES, 1.0, rng) for _ in range(200)]
    for values in found:
        assert values["X1.backlash"] + values["X1.clearance"] == pytest.approx(6e-5)
        assert min(values["X1.backlash"], values["X1.clearance"]) > 1e-6
        assert values["X1.gear_mass"] == 0.1, "before the second gap"
        assert values.keys() == VALUES.keys()
    for name, wide in (("clearance", 1.0), ("pinion_mass", 1.0), ("pinion_friction", 2.0)):
        spread = np.std([np.log(values[f"X1.{name}"]) for values in found])
        assert 0.6 * wide < spread < 1.2 * wide, name
    assert dict(CLEARANCE.varied(VALUES, 0.0, rng)) == pytest.approx(VALUES)


def test_typical_machines_keep_friction_and_play_and_divide_that_from_end_to_end(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """What lacks a gap has gone to a corner in all but these, and a machine in it is no typical one."""
    corner = {
        "X1.backlash": 6e-5,
        "X1.coulomb": 0.9,
        "X1.viscous": 2.0,
        "X1.drive_mass": 3.0,
        "X1.smear": 2e-4,
    }
    monkeypatch.setattr(moves_valleys, "values_at", lambda _found: corner)
    candidate = moves_starts.candidates(Model(("X1",), 1), (DRIVEN["gearbox_clearance"],), ())[0]
    machines = list(typical_machines(cast(Any, None), candidate, np.random.default_rng(3)))
    assert len(machines) == DRAWN
    for one in machines:
        assert one["X1.backlash"] + one["X1.clearance"] == pytest.approx(6e-5)
        assert (one["X1.coulomb"], one["X1.viscous"]) == (0.9, 2.0)
        assert "X1.smear" not in one, "two impacts, not one"
    shares = np.array([one["X1.clearance"] / 6e-5 for one in machines])
    assert (np.diff(shares) > 0.0).all() and (shares > LEAST).all() and (shares < 1.0 - LEAST).all()
    assert shares[0] < 0.06 and shares[-1] > 0.94
    typical = {p.name: p.typical for p in candidate.model.parameters}
    for name in ("X1.drive_mass", "X1.drive_stiffness", "X1.contact_stiffness", "X1.pinion_friction"):
        drawn = np.log([one[name] / typical[name] for one in machines]) / (2.0 if "friction" in name else 1.0)
        assert 0.25 < np.std(drawn) < 0.8 and abs(np.mean(drawn)) < 0.4, name


def test_where_more_is_missing_than_a_gap_does_nothing_is_searched() -> None:
    much: Any = SimpleNamespace(rms=moves_starts.TOO_MUCH + 0.1)
    assert valleys(cast(Any, None), much, cast(Any, None)) == []


def test_what_begins_on_typical_machines_goes_on_beside_what_begins_on_the_present_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """As they are, and after some rounds, they are farther from the moves than what begins on the present one."""
    candidate: Any = SimpleNamespace(model="")
    found: Any = SimpleNamespace(rms=1.1, model="", at=SimpleNamespace(shared=0))
    monkeypatch.setattr(moves_valleys, "asked", lambda _found: ((),))
    monkeypatch.setattr(moves_valleys, "own_of_few", lambda _found: 0.0)
    monkeypatch.setattr(moves_valleys, "widened", lambda local, _model: local)
    monkeypatch.setattr(moves_valleys, "places_of_loads", lambda *_: 0.0)
    monkeypatch.setattr(moves_valleys, "near_by", lambda *_: 30 * ["present"])
    monkeypatch.setattr(moves_valleys, "about", lambda *_: [4.3, 9.0])
    monkeypatch.setattr(moves_valleys, "typical_machines", lambda *_: 24 * ["typical"])
    monkeypatch.setattr(moves_valleys, "begun_at", lambda *_: 6.8)
    monkeypatch.setattr(moves_valleys, "left_at_present", lambda *_: 4.4)
    monkeypatch.setattr(
        moves_valleys, "fit", lambda _few, _model, at, _rounds: SimpleNamespace(rms_with_motors=at)
    )
    gone = {4.3: 4.25, 6.8: 4.35}
    monkeypatch.setattr(
        moves_valleys,
        "by_rests",
        lambda _few, one: SimpleNamespace(rms_with_motors=gone[one.rms_with_motors]),
    )
    seen: list[float] = []
    monkeypatch.setattr(
        moves_valleys,
        "survivors",
        lambda fits, _candidate: (
            seen.extend(f.rms_with_motors for f in fits) or sorted(fits, key=lambda f: f.rms_with_motors)
        ),
    )
    valleys(cast(Any, None), found, candidate)
    assert seen == FITTED * [4.25] + DRAWN_FITTED * [4.35]
    seen.clear()
    near = Begun(cast(Any, ((),)), [cast(Any, SimpleNamespace(rms_with_motors=4.3))], np.random.default_rng())
    valleys(cast(Any, None), found, candidate, near=near)
    assert seen == [4.3] + DRAWN_FITTED * [4.35], "begun near by already"
    assert [one.rms_with_motors for one in near.fits] == [4.3]


def test_an_effect_with_one_valley_is_not_varied() -> None:
    effect = DRIVEN["constant_force"](("X1",))
    assert effect.varied(VALUES, 1.0, np.random.default_rng(0)) == VALUES
    assert effect.divided(VALUES, 0.5) == VALUES


def test_all_play_is_divided_whether_or_not_there_is_a_second_gap_yet() -> None:
    only = {"X1.backlash": 6e-5, "X1.gear_mass": 0.1}
    for values in (VALUES, only):
        divided = CLEARANCE.divided(values, 0.25)
        assert (divided["X1.backlash"], divided["X1.clearance"]) == pytest.approx((4.5e-5, 1.5e-5))
        assert divided["X1.gear_mass"] == 0.1


@pytest.mark.parametrize(
    ("present", "nearest", "varied"),
    [
        (4.0, (3.8, 1.2), 0),  # takes a tenth of what shows: another effect is met halfway
        (1.22, (1.18, 1.08, 1.075), 2),  # a fifth of what shows, which led to a second gap
        (4.0, (2.0, 1.99), 1),  # gains nothing more
        (4.0, (2.0, 1.5, 1.49), 2),
        (4.0, (2.0, 1.5, 1.4, 1.3, 1.2), 3),
        (1.0, (0.99,), 0),  # chance
        (1.0, (0.95, 0.95), 1),
    ],
)
def test_what_came_nearest_is_varied_while_it_promises_and_gains(
    monkeypatch: pytest.MonkeyPatch, present: float, nearest: tuple[float, ...], varied: int
) -> None:
    left = iter(nearest)
    monkeypatch.setattr(moves_valleys, "asked", lambda _found: ((),))
    monkeypatch.setattr(moves_valleys, "own_of_few", lambda _found: 0.0)
    monkeypatch.setattr(moves_valleys, "values_at", lambda _found: {})
    monkeypatch.setattr(moves_valleys, "widened", lambda local, _model: local)
    monkeypatch.setattr(moves_valleys, "places_of_loads", lambda *_: 0.0)
    monkeypatch.setattr(moves_valleys, "near_by", lambda *_: [])
    monkeypatch.setattr(moves_valleys, "typical_machines", lambda *_: [0.0])
    monkeypatch.setattr(moves_valleys, "about", lambda *_: [1.0])
    monkeypatch.setattr(moves_valleys, "left_at_present", lambda _few, _found: present)

    def fitted(_few: Any, _candidate: Any, begun: Any, *_: Any) -> list[Any]:
        if begun == []:  # near the present machine
            return []
        return [
            SimpleNamespace(rms_with_motors=next(left), model="", at=SimpleNamespace(shared=0, local=[0]))
        ]

    monkeypatch.setattr(moves_valleys, "fitted_best", fitted)
    monkeypatch.setattr(
        moves_valleys, "survivors", lambda fits, _candidate: sorted(fits, key=lambda f: f.rms_with_motors)
    )
    found: Any = SimpleNamespace(rms=1.1, model="", at=SimpleNamespace(shared=0))
    alive = valleys(cast(Any, None), found, cast(Any, SimpleNamespace(model="")))
    assert [f.rms_with_motors for f in alive] == sorted(nearest[: varied + 1])
