"""The driven forward model against what can be written down, and against a plain integrator of its equations."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from service.dynamics.driven import simulate
from service.dynamics.driven_model import Model, Parameter
from service.dynamics.driven_motion import coefficients, plain_motion, sample_period
from service.recording import FloatArray, Trace

H = 2.5e-4
K = 320


def values(**changes: float) -> dict[str, FloatArray]:
    """One parameter set of a single axis without lumps."""
    base = {
        "backlash": 60e-6,
        "contact_stiffness": 3e5,
        "contact_damping_ratio": 0.06,
        "coulomb": 0.3,
        "viscous": 0.8,
        "constant": 0.05,
        "skew": 0.0,
    }
    return {f"X1.{name}": np.array([value]) for name, value in (base | changes).items()}


def step_motion() -> Trace:
    """Speed of a motor that accelerates and brakes smoothly, 0.1 m/s at most, (n,) at 1 kHz."""
    t = np.arange(-0.02, 0.11, 1e-3)
    return Trace(t, 0.1 * np.sin(np.pi * np.clip(t, 0.0, 0.085) / 0.085) ** 2)


def driven(v: dict[str, FloatArray], load: FloatArray, model: Model | None = None) -> FloatArray:
    """Predicted acceleration (K,) of one step that starts at t = 0.01 s."""
    c = coefficients(plain_motion(step_motion(), 1.0), 0.01, H, K - 60)
    response = simulate(model or Model(("X1",)), v, c[None, None, :, None], np.ones(1), load, H)
    return np.asarray(response.acceleration[0, 0, 0])


def start(v: dict[str, FloatArray]) -> FloatArray:
    """The load on the driving flank, at the motor's speed: (1, 1, 1, 2)."""
    position = plain_motion(step_motion(), 1.0)
    return np.array(
        [float(position(0.01)) - 0.5 * float(v["X1.backlash"][0]) - 1e-5, float(position(0.01, 1))]
    ).reshape(1, 1, 1, 2)


def integrated(v: dict[str, FloatArray], load: FloatArray) -> FloatArray:
    """The same equations, (5)-(8), by a general integrator with tiny steps."""
    position = plain_motion(step_motion(), 1.0)
    p = {name[3:]: float(value[0]) for name, value in v.items()}
    k, half = p["contact_stiffness"], 0.5 * p["backlash"]
    d = 2.0 * p["contact_damping_ratio"] * np.sqrt(k)

    def rates(t: float, x: FloatArray) -> list[float]:
        delta, rate = float(position(t)) - x[0], float(position(t, 1)) - x[1]
        beyond = delta - np.clip(delta, -half, half)
        force = k * beyond + d * rate * (beyond != 0.0)
        force = force if force * beyond > 0.0 else 0.0
        return [x[1], force - p["coulomb"] - p["viscous"] * x[1] + p["constant"]]

    grid = 0.01 + H * np.arange(K - 59)
    speed = solve_ivp(
        rates, (0.01, grid[-1]), load.ravel(), t_eval=grid, max_step=2e-5, rtol=1e-8, atol=1e-12
    ).y[1]
    return np.asarray(np.diff(speed) / H)


@pytest.mark.parametrize("zeta", [0.02, 0.3])
def test_agrees_with_a_general_integrator_through_release_and_impact(zeta: float) -> None:
    v = values(contact_damping_ratio=zeta)
    ours, theirs = driven(v, start(v)), integrated(v, start(v))
    assert theirs.min() < -2.0, "the load is braked by the other flank"
    assert np.max(np.abs(ours - theirs)) < 2e-3


def test_inside_the_gap_only_friction_acts() -> None:
    """Eq. (8): with a gap that is never crossed the load decelerates by friction alone."""
    v = values(backlash=0.1, viscous=0.0, constant=0.0)
    load = np.array([0.0, 0.05]).reshape(1, 1, 1, 2)
    assert driven(v, load) == pytest.approx(-0.3, abs=1e-9)


def test_is_smooth_in_the_backlash() -> None:
    """Events are located inside the interval: no jump while the impact moves over a grid point."""
    b = 60e-6 + 2e-8 * np.arange(80)
    curve = np.array([driven(values(backlash=float(x)), start(values()))[185:200] for x in b])
    second = np.abs(np.diff(curve, 2, axis=0))
    first = np.abs(np.diff(curve, axis=0)).max()
    assert second.max() < 0.2 * first


def test_a_stiff_light_lump_in_series_is_the_chain_without_lumps() -> None:
    """Springs in series: 1/k = 1/k_contact + 1/k_drive; the lump's own mode is an order of magnitude faster."""
    v = values()
    drive = {"stiffness": 1e7, "damping_ratio": 0.05, "mass": 0.02}
    split = {f"X1.drive_{name}": np.array([x]) for name, x in drive.items()}
    split["X1.contact_stiffness"] = 1.0 / (1.0 / v["X1.contact_stiffness"] - 1e-7)
    difference = driven(v, start(v)) - driven(v | split, start(v), Model(("X1",), lumps=1))
    assert np.sqrt(np.mean(difference[20:] ** 2)) < 0.1


def test_bridge_pulls_both_ways_and_keeps_the_momentum() -> None:
    """Two free loads on a spring: what one gains the other loses, by the masses' ratio."""
    model = Model(("X1", "X2"))
    v = {
        name.replace("X1", axis): x
        for axis in model.axes
        for name, x in values(backlash=0.5, coulomb=0.0).items()
    }
    v |= {name: np.zeros(1) for name in v if name.endswith(("viscous", "constant"))}
    v |= {f"bridge_{n}": np.array([x]) for n, x in (("stiffness", 4e4), ("damping", 3.0), ("offset", 0.0))}
    v["mass_ratio"] = np.array([2.0])
    c = coefficients(plain_motion(step_motion(), 1.0), 0.01, H, K - 60)
    load = np.array([[1e-4, 0.0], [0.0, 0.0]]).reshape(1, 1, 2, 2)
    a = simulate(model, v, np.stack([c, c], axis=1)[None, None], np.ones(1), load, H).acceleration[0, 0]
    assert np.abs(a[0]).max() > 3.0
    assert a[0] + 2.0 * a[1] == pytest.approx(0.0, abs=1e-9)


def test_parameter_coordinates_go_there_and_back() -> None:
    for parameter in Model(("X1", "X2"), lumps=2).parameters:
        assert parameter.value(0.0) == pytest.approx(parameter.typical)
        assert parameter.internal(parameter.value(1.3)) == pytest.approx(1.3)
    assert Parameter("k", "1", 2.0, 0.5).value(1.0) == pytest.approx(2.0 * np.exp(0.5))


def test_sample_period_counts_lost_samples() -> None:
    t = 0.1 + 2.4e-4 * np.arange(1000)
    kept = np.delete(t, [10, 11, 500])
    assert sample_period(Trace(kept, np.zeros(len(kept)))) == pytest.approx(2.4e-4, rel=1e-9)
