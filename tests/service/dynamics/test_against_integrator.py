"""The simulated axis and gantry against scipy's stiff integrator, on equations written down a second time.

The reference keeps each quantity at its own shaft, as eqs. (1)-(4) print it, knows nothing of modes or events,
and makes friction smooth over 0.1 µm/s instead of letting bodies stick. What is left is that smoothing.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from service.dynamics.parameters import AxisParameters, Friction, GantryParameters, Machine
from service.dynamics.simulation import DT, simulate
from service.dynamics.trajectory import jerk_limited_step
from service.recording import Move

FloatArray = NDArray[np.float64]

SMOOTH = 1e-7  # [m/s] over which the reference's Coulomb friction changes sign
REST = 0.005
RTOL = 1e-7
END = 0.075  # [s] after the start: the axis is still moving, past the crossing and its ringing


@dataclass
class ReferenceAxis:
    """Eqs. (1)-(7) and the cascade; state: phi_m, phi_g, phi_p, x, their speeds, T."""

    p: AxisParameters
    integral: float = 0.0
    command: float = 0.0

    def control(self, s: FloatArray, x: float, v: float, a: float) -> None:
        c, r = self.p.ppi, self.p.D_p / 2 / self.p.i
        e = c.Kv * (x / r - s[0]) + c.speed_feedforward * v / r - s[4]
        self.integral += c.Kp / c.Tn * e * DT
        self.command = c.Kp * e + self.integral + c.inertia_feedforward * a / r

    def contact(self, s: FloatArray) -> float:
        p = self.p
        x_rp, v_rp = p.D_p / 2 * s[2] - s[3], p.D_p / 2 * s[6] - s[7]
        if x_rp > p.upper_limit:
            return max(0.0, p.k_p * (x_rp - p.upper_limit) + p.d_p * v_rp)
        if x_rp < p.lower_limit:
            return min(0.0, p.k_p * (x_rp - p.lower_limit) + p.d_p * v_rp)
        return 0.0

    def slope(self, s: FloatArray, pull: float) -> list[float]:
        p, R = self.p, self.p.D_p / 2
        tau_m = p.k_mg * (s[0] - s[1]) + p.d_mg * (s[4] - s[5])
        tau_g = p.k_gp * (s[1] / p.i - s[2]) + p.d_gp * (s[5] / p.i - s[6])
        F = self.contact(s)
        r = R / p.i
        return [
            *s[4:8],
            (s[8] - friction(p.friction_mot, s[4], r) - tau_m) / p.J_mot,
            (tau_m - friction(p.friction_g, s[5], r) - tau_g / p.i) / p.J_g,
            (tau_g - friction(p.friction_p, s[6], R) - R * F) / p.J_p,
            (F - friction(p.friction_mas, s[7], 1.0) + pull) / p.M,
            (self.command - s[8]) / p.ppi.current_loop_time,
        ]


def friction(f: Friction, speed: float, radius: float) -> float:
    return float(f.coulomb * np.tanh(speed * radius / SMOOTH) + f.viscous * speed)


def reference(axes: list[ReferenceAxis], move: Move, bridge: GantryParameters | None) -> FloatArray:
    """States at the ends of the sub-steps, (n, 9·axes)."""
    step = jerk_limited_step(move.length, move.jerk, 1e3, 1e2)

    def slope(_: float, s: FloatArray) -> list[float]:
        pull = 0.0
        if bridge is not None:
            pull = -bridge.k * (s[3] - s[12] - bridge.offset) - bridge.d * (s[7] - s[16])
        signs = (1, -1)
        return [y for k, axis in enumerate(axes) for y in axis.slope(s[9 * k : 9 * k + 9], signs[k] * pull)]

    s = np.zeros(9 * len(axes))
    states = []
    for n in range(round((REST + END) / DT)):
        t = (n + 1) * DT - move.start
        x, v, a = float(step.position(t)), float(step.speed(t)), float(step.acceleration(t))
        for k, axis in enumerate(axes):
            axis.control(s[9 * k : 9 * k + 9], x, v, a)
        s = solve_ivp(slope, (0, DT), s, method="Radau", rtol=RTOL, atol=1e-13, first_step=1e-6).y[:, -1]
        states.append(s)
    return np.array(states)


def the_move() -> Move:
    return Move(REST, 1, 4e-3, 200.0, jerk_limited_step(4e-3, 200.0, 1e3, 1e2).duration)


def compare(machine: Machine, states: FloatArray) -> None:
    """The motion within what the smoothing leaves open, some 0.1 µm/s and 1 nm; the crossing at its time."""
    run = simulate(machine, [the_move()])
    for k, (name, p) in enumerate(machine.axes.items()):
        s = states[:, 9 * k : 9 * k + 9]
        m = run.axes[name].measured
        n = len(s)
        np.testing.assert_allclose(m.load_position[:n], s[:, 3], atol=3e-9)
        np.testing.assert_allclose(m.load_speed[:n], s[:, 7], atol=1e-6)
        np.testing.assert_allclose(m.motor_position[:n] * p.transmission, s[:, 0] * p.transmission, atol=3e-9)
        np.testing.assert_allclose(m.motor_torque[:n], s[:, 8], atol=5e-4)
        crossing = run.axes[name].diagnostic_crossing(the_move())
        assert crossing is not None
        assert crossing.t2 == pytest.approx(touch_time(p, s, crossing.t2), abs=1e-6)
        assert_parts_at(ReferenceAxis(p), s, crossing.t1)


def touch_time(p: AxisParameters, s: FloatArray, near: float) -> float:
    """When the reference's pinion reaches the lower flank."""
    x_rp = p.D_p / 2 * s[:, 2] - s[:, 3] - p.lower_limit
    n = int(near / DT) - 1
    assert x_rp[n] > 0 > x_rp[n + 1]
    before, v_rp = p.D_p / 2 * s[n - 1 : n + 1, 6] - s[n - 1 : n + 1, 7]
    # In the gap the relative motion is nearly a parabola; its curvature is taken from the state before.
    a_rp = (v_rp - before) / DT
    root = (-v_rp - np.sqrt(v_rp**2 - 2 * a_rp * x_rp[n])) / a_rp
    return float((n + 1) * DT + root)


def assert_parts_at(axis: ReferenceAxis, s: FloatArray, t1: float) -> None:
    """The reference's flank force is still positive at the state before t1, and zero at the one after."""
    n = int(t1 / DT) - 1
    assert axis.contact(s[n]) > 0
    assert axis.contact(s[n + 1]) == 0


def test_single_axis_agrees_with_the_stiff_integrator() -> None:
    p = AxisParameters(b=60e-6, UL=15e-6)
    compare(Machine({"X1": p}), reference([ReferenceAxis(p)], the_move(), None))


def test_gantry_agrees_with_the_stiff_integrator() -> None:
    """Different gaps, zero positions, masses and friction on the two sides, a bridge under stress at the start."""
    first = AxisParameters(b=40e-6, M=300.0)
    rough = Friction(coulomb=200.0, viscous=500.0)
    second = replace(first, b=90e-6, UL=20e-6, M=350.0, k_p=1.3e8, friction_mas=rough)
    bridge = GantryParameters("X1", "X2", k=2e7, d=2e4, offset=5e-6)
    states = reference([ReferenceAxis(first), ReferenceAxis(second)], the_move(), bridge)
    compare(Machine({"X1": first, "X2": second}, (bridge,)), states)
