"""Forces balanced along a measured motion: against the simulation that made the motion, and against plain sums."""

from __future__ import annotations

import numpy as np
import pytest

from service.dynamics.driven import simulate
from service.dynamics.driven_balance import along, balance, in_series
from service.dynamics.driven_model import Model, Values
from service.dynamics.driven_motion import coefficients, plain_motion
from service.recording import FloatArray, Trace

H = 2.5e-4
K = 260
AXES = ("X1", "X2")


def machine(model: Model, **changes: float) -> Values:
    """One parameter set: what is typical, but for the gaps and what is said."""
    typical = {p.name: p.typical for p in model.parameters} | {"X1.backlash": 60e-6, "X2.backlash": 25e-6}
    return {name: np.array([value]) for name, value in (typical | changes).items()}


def motors() -> FloatArray:
    """Both motors of one step from t = 0.01 s, the second 2 % slower: (1, K, 2, 5)."""
    t = np.arange(-0.02, 0.11, 1e-3)
    speed = 0.1 * np.sin(np.pi * np.clip(t, 0.0, 0.085) / 0.085) ** 2
    both = [coefficients(plain_motion(Trace(t, f * speed), 1.0), 0.01, H, K) for f in (1.0, 0.98)]
    return np.stack(both, axis=1)[None]


def begun(values: Values, c: FloatArray) -> FloatArray:
    """Both loads 10 µm deep in the driving flank, at the motors' speed: (1, 1, 2, 2)."""
    depth = np.array([0.5 * values[f"{axis}.backlash"][0] + 1e-5 for axis in AXES])
    return np.stack((c[0, 0, :, 0] - depth, c[0, 0, :, 1]), axis=-1)[None, None]


@pytest.mark.parametrize("bridge", [1e3, 4e4])
def test_a_simulated_motion_is_in_balance(bridge: float) -> None:
    """To 1 %, a swing's mean over a sample being less than its middle, but for samples in which a flank is met."""
    model = Model(AXES, 0)
    values = machine(model, bridge_stiffness=bridge, bridge_offset=2e-5, mass_ratio=0.8)
    c, s = motors(), np.ones(1)
    load = begun(values, c)
    simulated = simulate(model, values, c[None], s, load, H)
    seen = along(c, simulated.acceleration[0], H)
    predicted, force = balance(
        model, values, s, seen, seen.motors(np.zeros((1, 2)), np.zeros((1, 1, 2, 1))), load
    )
    apart = np.abs(predicted - simulated.acceleration)
    size = np.ptp(simulated.acceleration)
    assert size > 5.0, "the flanks were left and met"
    assert np.quantile(apart, 0.95) < 0.01 * size
    assert np.quantile(np.abs(force - simulated.force), 0.9) < 0.02 * size


def test_a_wrong_gap_is_seen_only_where_it_matters() -> None:
    """What simulated would be lost for the rest of the step is wrong here only while the flank would be another."""
    model = Model(AXES, 0)
    values, c, s = machine(model, bridge_stiffness=1e3), motors(), np.ones(1)
    load = begun(values, c)
    seen = along(c, simulate(model, values, c[None], s, load, H).acceleration[0], H)
    at_rest = seen.motors(np.zeros((1, 2)), np.zeros((1, 1, 2, 1)))
    wrong = values | {"X1.backlash": np.array([80e-6])}
    right, other = (balance(model, v, s, seen, at_rest, load)[0][0, 0] for v in (values, wrong))
    assert np.array_equal(right[1], other[1]), "the partner is where it was measured"
    assert np.max(np.abs(right[0] - other[0])) > 1.0


def test_lost_samples_are_closed_by_lines() -> None:
    a = np.linspace(1.0, 2.0, K)[None, None].repeat(2, axis=1)
    gone = a.copy()
    gone[:, :, 100:103] = np.nan
    assert np.allclose(along(motors(), gone, H).load, along(motors(), a, H).load)


def test_speed_and_position_gained_are_integrals_up_to_the_middle() -> None:
    a = np.full((1, 2, K), 3.0)
    seen = along(motors(), a, H)
    t = (np.arange(K) + 0.5) * H
    assert np.allclose(seen.load[0, 0, :, 1], 3.0 * t)
    assert np.allclose(seen.load[0, 0, :, 0], 1.5 * t**2, rtol=1e-4, atol=2.0 * H**2)


def test_chain_is_springs_in_series_wound_up_by_what_they_carry() -> None:
    model = Model(AXES, 2)
    values = machine(model)
    k = {link: values[f"X1.{link}_stiffness"][0] for link in ("gear", "pinion", "contact")}
    m = {link: values[f"X1.{link}_mass"][0] for link in ("gear", "pinion")}
    soft, inert, mass, _ = (float(part.ravel()[0]) for part in in_series(model, values, "X1"))
    assert soft == pytest.approx(1.0 / k["gear"] + 1.0 / k["pinion"] + 1.0 / k["contact"])
    assert inert == pytest.approx((m["gear"] + m["pinion"]) / k["gear"] + m["pinion"] / k["pinion"])
    assert mass == pytest.approx(m["gear"] + m["pinion"])
