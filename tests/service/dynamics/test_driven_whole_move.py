"""The driven model from rest to rest, against a general integrator of the same equations."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from service.dynamics.driven import simulate
from service.dynamics.driven_model import Model
from service.dynamics.driven_motion import coefficients, plain_motion
from service.recording import FloatArray, Trace

H = 2.5e-4
K = 400
MODEL = Model(("X1",), friction="whole_move", held=("constant", "skew"))


def values(**changes: float) -> dict[str, FloatArray]:
    """One parameter set of a single axis without lumps."""
    base = {
        "backlash": 60e-6,
        "contact_stiffness": 3e5,
        "contact_damping_ratio": 0.06,
        "coulomb": 0.4,
        "viscous": 0.8,
        "turnover_speed": 4e-4,
        "turnover_spread": 2.5,
    }
    return {f"X1.{name}": np.array([value]) for name, value in (base | changes).items()}


def step_motion() -> Trace:
    """A motor at rest, a smooth step of 85 ms, and at rest again."""
    t = np.arange(-0.02, 0.14, 1e-3)
    return Trace(t, 0.1 * np.sin(np.pi * np.clip(t, 0.0, 0.085) / 0.085) ** 2)


def load() -> FloatArray:
    """The pinion rests a quarter of the gap away from its middle."""
    return np.array([float(plain_motion(step_motion(), 1.0)(-0.005)) - 15e-6, 0.0]).reshape(1, 1, 1, 2)


def driven(v: dict[str, FloatArray]) -> FloatArray:
    c = coefficients(plain_motion(step_motion(), 1.0), -0.005, H, K)
    return np.asarray(simulate(MODEL, v, c[None, None, :, None], np.ones(1), load(), H).acceleration[0, 0, 0])


def knee(x: FloatArray | float, spread: float) -> FloatArray:
    """The declared friction's turning over, its three corners written down once more."""
    before, after = np.clip(x * spread, -1, 1), np.clip(x / spread, -1, 1)
    return np.asarray(0.30 * before + 0.45 * np.clip(x, -1, 1) + 0.25 * after)


@pytest.mark.parametrize(
    ("law", "scale", "spread", "share"),
    [
        (np.tanh, 1.26, 2.0, 0.04),
        (lambda x: x / np.sqrt(1.0 + x**2), 1.41, 2.6, 0.04),
        (lambda x: 2.0 / np.pi * np.arctan(0.5 * np.pi * x), 1.74, 3.9, 0.065),
    ],
)
def test_friction_turns_over_like_the_laws_that_stand_for_it(
    law: Callable[[FloatArray], FloatArray], scale: float, spread: float, share: float
) -> None:
    x = np.linspace(-30.0, 30.0, 12001)
    assert np.abs(knee(x / scale, spread) - law(x)).max() < share


def integrated(v: dict[str, FloatArray]) -> FloatArray:
    """Flank and held friction written down once more, with tiny steps."""
    position = plain_motion(step_motion(), 1.0)
    p = {name[3:]: float(value[0]) for name, value in v.items()}
    k, half = p["contact_stiffness"], 0.5 * p["backlash"]
    d = 2.0 * p["contact_damping_ratio"] * np.sqrt(k)

    def rates(t: float, x: FloatArray) -> list[float]:
        delta, rate = float(position(t)) - x[0], float(position(t, 1)) - x[1]
        beyond = delta - np.clip(delta, -half, half)
        force = k * beyond + d * rate * (beyond != 0.0)
        force = force if force * beyond > 0.0 else 0.0
        held = p["coulomb"] * knee(x[1] / p["turnover_speed"], p["turnover_spread"])
        return [x[1], force - float(held) - p["viscous"] * x[1]]

    grid = -0.005 + H * np.arange(K + 1)
    speed = solve_ivp(
        rates, (grid[0], grid[-1]), load().ravel(), t_eval=grid, max_step=2e-5, rtol=1e-8, atol=1e-12
    ).y[1]
    return np.asarray(np.diff(speed) / H)


@pytest.mark.parametrize("turnover", [4e-4, 5e-5])
def test_agrees_with_a_general_integrator_from_rest_to_rest(turnover: float) -> None:
    v = values(turnover_speed=turnover)
    ours, theirs = driven(v), integrated(v)
    assert np.abs(theirs[:16]).max() < 1e-6, "the load lies still until the flank comes"
    assert theirs.min() < -2.0 < 2.0 < theirs.max(), "it is pushed and braked"
    assert np.max(np.abs(ours - theirs)) < 5e-3


def test_friction_holds_a_load_that_is_not_pushed_hard_enough() -> None:
    """A soft flank that never reaches the breakaway level leaves the load where it is but for a creep."""
    v = values(contact_stiffness=10.0, coulomb=2.0, backlash=1e-5)
    assert np.abs(np.cumsum(driven(v)) * H).max() < 4e-4


def test_held_parameters_are_no_free_numbers() -> None:
    names = {p.name for p in MODEL.parameters}
    assert "X1.constant" not in names
    assert "X1.skew" not in names
    assert MODEL.complete(values())["X1.skew"] == pytest.approx([0.0])
