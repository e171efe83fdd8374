"""The search for an effect whose fits have many valleys."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from service.dynamics.effects.driven_library import DRIVEN
from service.identification import moves_valleys
from service.identification.moves_valleys import APART, POPULATION, QUICK, fitted_best, survivors

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


def test_the_best_after_a_few_rounds_have_their_zeros_found_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    """How near a set comes as it is says little, and a fit that rests wrongly stays where it is."""

    def fit(_moves: Any, _model: Any, at: Any, rounds: int) -> Any:
        after, rest = at
        left = after if rounds == QUICK else after - (0.5 if rest == "anew" else 0.1)
        return SimpleNamespace(
            rms_with_motors=left, model="model", at=SimpleNamespace(local=rest, after=left)
        )

    def begun_at(_moves: Any, _model: Any, values: Any, local: Any) -> Any:
        assert local == "given", "what was found so far is one of the places"
        return (values, "anew")

    monkeypatch.setattr(moves_valleys, "fit", fit)
    monkeypatch.setattr(moves_valleys, "begun_at", begun_at)
    monkeypatch.setattr(moves_valleys, "values_at", lambda found: found.at.after)
    begun: Any = [[(9.0, (3.0, "given"))], [(1.0, (4.0, "given")), (2.0, (2.0, "given"))]]
    found = fitted_best((), cast(Any, SimpleNamespace(model="model")), begun, 2)
    assert [f.rms_with_motors for f in found] == [1.5, 2.5], "the third is given up"


def test_two_gaps_divide_anew_and_keep_their_sum() -> None:
    rng = np.random.default_rng(3)
    found = [CLEARANCE.varied(VALUES, 1.0, rng) for _ in range(200)]
    for values in found:
        assert values["X1.backlash"] + values["X1.clearance"] == pytest.approx(6e-5)
        assert min(values["X1.backlash"], values["X1.clearance"]) > 1e-6
        assert values["X1.gear_mass"] == 0.1, "before the second gap"
        assert values.keys() == VALUES.keys()
    for name in ("X1.clearance", "X1.pinion_mass", "X1.pinion_friction"):
        spread = np.std([np.log(values[name]) for values in found])
        assert 0.6 < spread < 1.2
    assert dict(CLEARANCE.varied(VALUES, 0.0, rng)) == pytest.approx(VALUES)


def test_an_effect_with_one_valley_is_not_varied() -> None:
    effect = DRIVEN["constant_force"](("X1",))
    assert effect.varied(VALUES, 1.0, np.random.default_rng(0)) == VALUES
