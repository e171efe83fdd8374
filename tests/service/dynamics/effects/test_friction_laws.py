"""One law of friction begun as another: the curve over the speeds of a step stays, as near as the other law comes."""

from __future__ import annotations

import numpy as np
import pytest

from service.dynamics.effects.driven_guide import DrivenCurvedFriction, DrivenStribeckFriction

STRIBECK, CURVED = DrivenStribeckFriction(("X1",)), DrivenCurvedFriction(("X1",))
OF_SPEED = {"X1.coulomb": 2.0, "X1.viscous": 0.6, "X1.curved_level": 4.0, "X1.curved_power": 2.0}
OF_GREASE = {
    "X1.coulomb": 0.8,
    "X1.viscous": 5.0,
    "X1.breakaway": 0.6,
    "X1.stribeck_speed": 0.02,
    "X1.stribeck_exponent": 1.0,
    "X1.stribeck_tail": 0.0,
}


def curved(v: np.ndarray, values: dict[str, float]) -> np.ndarray:
    level, power = values["X1.curved_level"], values["X1.curved_power"]
    return np.asarray(values["X1.coulomb"] + values["X1.viscous"] * v + level * (v / 0.1) ** power)


def stribeck(v: np.ndarray, values: dict[str, float]) -> np.ndarray:
    """With the tail that falls off as (1 + τ·x)^(−1/τ); exp(−x) without one."""
    x = (v / values["X1.stribeck_speed"]) ** values["X1.stribeck_exponent"]
    tail = values["X1.stribeck_tail"]
    left = np.exp(-x) if tail < 1e-9 else (1.0 + tail * x) ** (-1.0 / tail)
    return np.asarray(values["X1.coulomb"] + values["X1.viscous"] * v + values["X1.breakaway"] * left)


def beside_a_line(v: np.ndarray, curve: np.ndarray) -> float:
    """How far a curve is from the nearest that the declared model has, F_C + b·v."""
    return float(np.std(curve - np.polyval(np.polyfit(v, curve, 1), v)))


def test_friction_that_is_curved_is_begun_as_a_stribeck_curve_and_the_other_way_round() -> None:
    """Three times as near as the declared law comes, in the best of the shapes."""
    v = np.linspace(2e-3, 0.1, 200)
    there = curved(v, OF_SPEED)
    apart = [np.std(stribeck(v, dict(numbers)) - there) for numbers in STRIBECK.imitating(OF_SPEED)]
    assert len(apart) == 3
    assert min(apart) < beside_a_line(v, there) / 3.0
    there = stribeck(v, OF_GREASE)
    apart = [np.std(curved(v, dict(numbers)) - there) for numbers in CURVED.imitating(OF_GREASE)]
    assert len(apart) == 2
    assert min(apart) < beside_a_line(v, there) / 3.0


def test_its_numbers_stay_where_friction_has_them() -> None:
    """A curve that bends down has no negative Coulomb level, no negative viscous friction, no power beyond the
    limits."""
    for numbers in CURVED.imitating(OF_GREASE):
        assert numbers.keys() == {"X1.curved_level", "X1.curved_power", "X1.coulomb", "X1.viscous"}
        assert numbers["X1.coulomb"] >= 0.0
        assert numbers["X1.viscous"] >= 0.0
        assert 0.2 <= numbers["X1.curved_power"] <= 4.0
    assert all(numbers["X1.breakaway"] >= 0.0 for numbers in STRIBECK.imitating(OF_SPEED))


@pytest.mark.parametrize(
    "values",
    [{"X1.coulomb": 1.0, "X1.viscous": 1.0}, OF_SPEED, OF_SPEED | OF_GREASE, {"X2.breakaway": 1.0}],
    ids=["no law", "its own", "both laws", "of another axis"],
)
def test_nothing_is_imitated_where_no_other_law_is(values: dict[str, float]) -> None:
    assert list(CURVED.imitating(values)) == []
