"""Each effect does what its name says, seen in the motion and not in its own formula; switching them on and off."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from service.dynamics.axis import axis_mechanism
from service.dynamics.effects.bodies import HungMassMode, MachineBodyMode
from service.dynamics.effects.carriage import (
    AsymmetricFriction,
    ConstantForce,
    PositionDependentForce,
    StribeckFriction,
)
from service.dynamics.effects.effect import At, Effect, Measured, quantities
from service.dynamics.effects.library import LIBRARY
from service.dynamics.effects.sensors import SensorLatency
from service.dynamics.parameters import AxisParameters, Friction, GantryParameters, Machine
from service.dynamics.propagation import Propagator
from service.dynamics.simulation import DT, Effects, Plant, nominal_motion, simulate, ten_steps
from service.recording import Move

FloatArray = NDArray[np.float64]

P = AxisParameters(b=60e-6)
LEVEL = P.friction_mas.coulomb


class Asked:
    """A set-point that follows the moves from time ``start``, for n sub-steps."""

    enabled = True
    braked = False

    def __init__(self, start: float, n: int, moves: tuple[Move, ...] = ()) -> None:
        t = start + DT * np.arange(1, n + 1)
        self.position, self.speed, self.acceleration = (v / P.transmission for v in nominal_motion(t, moves))


def free_flight(effects: list[Effect], direction: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Carriage x, v and a inside the gap of the first or second step: eq. (8), so M·a is the force on it."""
    run = simulate(P, ten_steps(count=2), {"X1": effects})
    axis = run.axes["X1"]
    crossing = axis.diagnostic_crossing(run.moves[0 if direction > 0 else 1])
    assert crossing is not None
    inside = (run.time > crossing.t1) & (run.time <= crossing.t2)
    m = axis.measured
    return m.load_position[inside], m.load_speed[inside], m.load_acceleration[inside]


def guide(v: FloatArray) -> FloatArray:
    """The declared friction of the guide [N]."""
    return -np.sign(v) * LEVEL - P.friction_mas.viscous * v


@pytest.mark.parametrize("direction", [1, -1])
def test_declared_axis_feels_its_guide_only(direction: int) -> None:
    _, v, a = free_flight([], direction)
    np.testing.assert_allclose(P.M * a, guide(v), rtol=1e-9)


@pytest.mark.parametrize("direction", [1, -1])
def test_constant_force_is_the_same_both_ways(direction: int) -> None:
    _, v, a = free_flight([ConstantForce(70.0)], direction)
    np.testing.assert_allclose(P.M * a - guide(v), 70.0, rtol=1e-6)


@pytest.mark.parametrize("direction", [1, -1])
def test_position_dependent_force_pulls_to_its_centre(direction: int) -> None:
    x, v, a = free_flight([PositionDependentForce(3e4, 1e-3)], direction)
    # Evaluated in the middle of the sub-step that ends where the sample is taken.
    np.testing.assert_allclose(P.M * a - guide(v), -3e4 * (x - 1e-3), atol=3e4 * 0.1 * DT)


@pytest.mark.parametrize("direction", [1, -1])
def test_asymmetric_friction_brakes_more_in_positive_travel(direction: int) -> None:
    _, v, a = free_flight([AsymmetricFriction(30.0)], direction)
    np.testing.assert_allclose(P.M * a - guide(v), -30.0, rtol=1e-6)


def test_stribeck_friction_fades_with_speed() -> None:
    effect = StribeckFriction(static=200.0, v_s=0.09)
    _, v, a = free_flight([effect], 1)
    excess = P.M * a - guide(v)
    np.testing.assert_allclose(excess, -(200.0 - LEVEL) * np.exp(-((v / 0.09) ** 2)), rtol=2e-3)


def test_stribeck_friction_holds_at_rest_what_coulomb_friction_would_let_go() -> None:
    """A carriage in the gap under 150 N: held by 200 N of static friction, moved when only 120 N hold it."""
    push = ConstantForce(150.0)
    still = Asked(0.0, 40)
    for effects, moves in (([push], True), ([push, StribeckFriction(200.0, 0.01)], False)):
        (m,) = Plant(P, {"X1": effects}).advance(40 * DT, [still])
        assert bool(m.load_position[-1] != 0.0) == moves


def peak_frequency(a: FloatArray) -> float:
    """Strongest line [Hz] of a free decay: the interpolated maximum of its spectrum."""
    n = 1 << 17
    spectrum = np.abs(np.fft.rfft((a - a.mean()) * np.hanning(len(a)), n))
    return float(np.fft.rfftfreq(n, DT)[np.argmax(spectrum)])


def test_a_hung_mass_swings_against_the_free_carriage() -> None:
    """Two free bodies on a spring: the part's own frequency times sqrt(1 + m/M), about their common centre."""
    m, f, shift = 30.0, 18.0, 1e-4
    free = replace(P, b=1e-3, friction_mas=Friction())
    mechanism = HungMassMode(m, f, 0.0).structure(axis_mechanism("X1", free), ("X1",))
    propagator = Propagator(mechanism, DT)
    q = np.zeros(5)
    q[mechanism.index("X1.hung")] = shift
    propagator.place(q, np.zeros(5))
    swing = []
    for _ in range(2000):
        propagator.step()
        swing.append(propagator.w[mechanism.index("X1.carriage")])
    t = DT * np.arange(1, 2001)
    centre = shift * m / (m + P.M)
    x = centre * (1 - np.cos(2 * np.pi * f * np.sqrt(1 + m / P.M) * t))
    np.testing.assert_allclose(swing, x, atol=1e-6 * shift)  # each turn costs a tick of friction at level 0


def test_machine_body_carries_the_axis_along() -> None:
    """After the step all rings at the frequency of body and axis together: the braked axis stands on the body."""
    effect = MachineBodyMode(2000.0, 12.0, 0.01)
    p = replace(P, friction_mas=Friction(5000.0, 0.0))
    run = simulate(p, ten_steps(count=1), {"X1": [effect]}, rest=1.5)
    after = run.time > run.moves[0].end + 0.2
    a = run.axes["X1"].measured.load_acceleration[after]
    assert np.abs(a).max() > 0.1
    together = 12.0 * np.sqrt(2000.0 / (2000.0 + p.M))
    assert peak_frequency(a) == pytest.approx(together, rel=0.02)


def test_rack_and_guide_push_the_body_back_by_as_much_as_they_push_the_carriage() -> None:
    """Only its feet change the momentum of carriage and body together."""
    mass, frequency = 2000.0, 12.0
    mechanism = MachineBodyMode(mass, frequency, 0.0).structure(axis_mechanism("X1", P), ("X1",))
    propagator = Propagator(mechanism, DT)
    layout = propagator.layout
    base, carriage = mechanism.index("base"), mechanism.index("X1.carriage")
    propagator.w[layout.command] = 5.0
    way, momentum = [0.0], []
    for _ in range(400):
        propagator.step()
        v = propagator.w[layout.v]
        way.append(propagator.w[base])
        momentum.append(P.M * v[carriage] + mass * v[base])
    x = np.array(way)
    feet = -mass * (2 * np.pi * frequency) ** 2 * np.cumsum((x[1:] + x[:-1]) / 2) * DT
    assert max(momentum) > 5.0
    np.testing.assert_allclose(momentum, feet, atol=1e-3 * max(momentum))
    assert x[40] < 0


def test_both_axes_of_a_gantry_share_one_body() -> None:
    machine = Machine({"X1": P, "X2": P}, (GantryParameters("X1", "X2"),))
    effect = MachineBodyMode(2000.0, 12.0, 0.01)
    both = simulate(machine, ten_steps(count=1), {"X1": [effect], "X2": [effect]})
    one, other = (both.axes[name].measured.load_speed for name in ("X1", "X2"))
    np.testing.assert_allclose(one, other, atol=1e-9)
    with pytest.raises(ValueError, match="has a body 'base' already"):
        simulate(machine, ten_steps(count=1), {"X1": [effect], "X2": [MachineBodyMode(1e3, 9.0, 0.1)]})


@pytest.mark.parametrize("latency", [0.0, 1.3 * DT, 2.1e-3])
def test_latency_shifts_the_accelerometer_and_nothing_else(latency: float) -> None:
    late = simulate(P, ten_steps(count=1), {"X1": [SensorLatency(latency)]})
    prompt = simulate(P, ten_steps(count=1)).axes["X1"].measured
    m = late.axes["X1"].measured
    expected = np.interp(late.time - latency, late.time, prompt.load_acceleration, left=0.0)
    np.testing.assert_allclose(m.load_acceleration, expected, atol=1e-9)
    np.testing.assert_array_equal(m.motor_speed, prompt.motor_speed)


def test_latency_looks_back_across_blocks() -> None:
    moves = ten_steps(rest=0.01, count=1)
    n = 800
    whole = Plant(P, {"X1": [SensorLatency(2.1e-3)]}).advance(n * DT, [Asked(0.0, n, moves)])[0]
    plant = Plant(P, {"X1": [SensorLatency(2.1e-3)]})
    parts = [plant.advance(8 * DT, [Asked(8 * k * DT, 8, moves)])[0] for k in range(n // 8)]
    joined = np.concatenate([part.load_acceleration for part in parts])
    np.testing.assert_allclose(joined, whole.load_acceleration, atol=1e-12)


def test_a_flank_effect_moves_the_flanks() -> None:
    """An effect of one's own needs no more than a class: here a gap that opens by 40 µm per 4 mm of travel."""

    class Wear(Effect):
        name = "position_dependent_backlash"

        def flanks(self, UL: float, LL: float, at: At) -> tuple[float, float]:
            return UL, LL - 0.01 * at.x

    ways = []
    for effects in ([], [Wear()]):
        run = simulate(P, ten_steps(count=1), {"X1": effects})
        m = run.axes["X1"].measured
        crossing = run.axes["X1"].diagnostic_crossing(run.moves[0])
        assert crossing is not None
        relative = m.motor_position * P.transmission - m.load_position
        ways.append(np.interp([crossing.t1, crossing.t2], run.time, relative) @ [1, -1])
        where = float(np.interp(crossing.t2, run.time, m.load_position))
    assert ways[1] - ways[0] == pytest.approx(0.01 * where, rel=0.05)


def test_effects_are_switched_on_in_a_running_plant() -> None:
    """As on a machine that changes overnight: the axis stands where it stood, and the next step shows it."""
    moves = ten_steps(rest=0.4, count=2)
    n = round((moves[0].end + 0.4) / DT)
    plant = Plant(P)
    (before,) = plant.advance(n * DT, [Asked(0.0, n, moves)])
    crossings = plant.crossings("X1")
    effects: Effects = {"X1": [HungMassMode(40.0, 20.0, 0.02), SensorLatency(1e-3)]}
    plant.switch_effects(effects)
    (after,) = plant.advance(n * DT, [Asked(n * DT, n, moves)])
    assert after.load_position[0] == pytest.approx(before.load_position[-1], abs=1e-9)
    assert np.abs(after.load_acceleration[:40]).max() < 1e-3
    assert plant.crossings("X1")[: len(crossings)] == crossings
    assert all(c.t2 > moves[1].start for c in plant.crossings("X1")[len(crossings) :])
    plain = Plant(P)
    (_, declared) = (plain.advance(n * DT, [Asked(k * n * DT, n, moves)])[0] for k in range(2))
    assert np.abs(after.load_acceleration - declared.load_acceleration).max() > 0.3
    with pytest.raises(ValueError, match="effects for"):
        plant.switch_effects({"Q": []})


def test_library_names_are_unique_and_every_parameter_has_unit_and_bounds() -> None:
    assert set(LIBRARY) >= {
        "constant_force", "stribeck_friction", "asymmetric_friction", "sensor_latency",
        "position_dependent_force", "hung_mass_mode", "machine_body_mode",
    }  # fmt: skip
    for name, effect in LIBRARY.items():
        assert effect.name == name
        assert quantities(effect)
        assert all(q.low < q.high and q.unit for q in quantities(effect).values())


def test_values_out_of_bounds_are_named() -> None:
    with pytest.raises(ValueError, match=r"sensor_latency: latency must lie between 0 and 0.05 s, got -1"):
        SensorLatency(-1.0)
    with pytest.raises(ValueError, match="constant_force: value must lie between"):
        ConstantForce(float("nan"))


def test_an_effect_leaves_what_it_does_not_touch() -> None:
    m = Measured(*np.ones((6, 3)))
    assert ConstantForce(1.0).measure(m, DT) is m
    assert ConstantForce(1.0).memory == 0.0
