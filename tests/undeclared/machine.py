"""Many machines at once: each lane of the arrays is one axis, a gantry is two lanes joined by a bridge.

Everything is referred to the output (metres and newtons), so that the chain of eqs. (1)-(4) becomes four masses
in a row: motor, gearbox, pinion, carriage. The integrator is a leapfrog whose dampers see the predicted speed of
the same instant: one evaluation per step, second order. The flank damping of eq. (7) switches on within a step; it is
weighted by the fraction of the step spent in contact, so that the order survives the impact. A flank never pulls.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tests.undeclared import forces
from tests.undeclared.forces import BASE, CARRIAGE, MOTOR, NEUTRAL

Array = NDArray[np.floating[Any]]

TICK = 1.25e-4
"""Cycle of the drive's controller and of the recorded traces [s]; chosen: 8 kHz, as drives have it."""
REST = 0.35
"""Standstill before, between and after the moves [s]."""
CAP = 40_000.0
"""Largest force of the drive [N]: never reached by a sound machine."""


@dataclass(frozen=True)
class Steps:
    """Ten alternating jerk-limited steps: length [m], jerk [m/s³], standstill around them [s]."""

    length: float
    jerk: float
    count: int = 10
    rest: float = REST

    @property
    def period(self) -> float:
        """Length of one step [s] on the controller's grid, the closing sample included."""
        return float((np.ceil((32 * self.length / self.jerk) ** (1 / 3) / TICK) + 1) * TICK)

    @property
    def starts(self) -> Array:
        """Start of every step [s], shape (count,)."""
        return self.rest + (self.period + self.rest) * np.arange(self.count)

    @property
    def end(self) -> float:
        """End of the recording [s]."""
        return float(self.starts[-1] + self.period + self.rest)


@dataclass(frozen=True)
class Traces:
    """What the machines did, on the controller's grid; arrays of shape (ticks, lanes), SI, referred to the output."""

    motor_position: Array
    motor_speed: Array
    motor_force: Array
    load_position: Array
    load_speed: Array
    flank: Array
    """Pinion minus carriage [m]; flanks touch outside (LL, UL)."""


def setpoint(steps: Steps, times: Array) -> tuple[Array, Array, Array]:
    """Return position [m], speed [m/s], acceleration [m/s²] of the commanded motion at `times` (n,).

    Four quarters of constant jerk +, -, -, + (no limit of speed or acceleration is reached), mirrored in every second.
    """
    T = (32 * steps.length / steps.jerk) ** (1 / 3)
    position, speed, acceleration = np.zeros((3, times.size))
    for k, start in enumerate(steps.starts):
        sign, base = (1.0, 0.0) if k % 2 == 0 else (-1.0, steps.length)
        u = np.clip(times - start, 0.0, T)
        moving = times >= start
        x, v, a = _rise(np.minimum(u, T - u), T, steps.jerk)
        late = u > T / 2
        x, a = np.where(late, steps.length - x, x), np.where(late, -a, a)
        position = np.where(moving, base + sign * x, position)
        speed = np.where(moving, sign * v, speed)
        acceleration = np.where(moving, sign * a, acceleration)
    return position, speed, acceleration


def _rise(u: Array, T: float, jerk: float) -> tuple[Array, Array, Array]:
    """Return the first half of a step: jerk up to T/4, minus jerk up to T/2."""
    w = np.maximum(u - T / 4, 0.0)
    return jerk * (u**3 / 6 - w**3 / 3), jerk * (u**2 / 2 - w**2), jerk * (u - 2 * w)


class Lanes(dict[str, Array]):
    """Parameters as arrays (lanes,); one that no machine has is neutral."""

    def __init__(self, machines: Sequence[Mapping[str, float]]) -> None:
        names = set().union(*machines)
        super().__init__(
            {name: np.array([m.get(name, NEUTRAL.get(name, 0.0)) for m in machines]) for name in names}
        )
        self.count = len(machines)

    def __missing__(self, name: str) -> Array:
        return np.full(self.count, NEUTRAL.get(name, 0.0))


def simulate(machines: Sequence[Mapping[str, float]], steps: Sequence[Steps], substeps: int = 10) -> Traces:
    """Run every machine through its steps.

    Parameters
    ----------
    machines : one mapping of parameters per lane; `partner` (+1, -1) joins two neighbouring lanes to a gantry.
    steps : the moves of each lane.
    substeps : integration steps per controller cycle.
    """
    p = Lanes(machines)
    n = len(machines)
    ticks = round(max(s.end for s in steps) / TICK) + 1
    times = np.arange(ticks) * TICK
    wanted = np.empty((3, ticks, n))
    for lane, s in enumerate(steps):
        wanted[:, :, lane] = setpoint(s, times)
    record = np.empty((6, ticks, n))
    plant = Plant(p, TICK / substeps)
    drive = Drive(p)
    for k in range(ticks):
        force = drive.force(wanted[:, k], *plant.position_and_speed())
        record[:, k] = plant.advance(substeps, times[k], force)
    return Traces(*record)


class Drive:
    """PPI cascade on the motor encoder with speed and torque feed-forward; the current loop is a first-order lag."""

    def __init__(self, p: Mapping[str, Array]) -> None:
        self.p = p
        self.integral = np.zeros_like(p["kv"])
        self.actual = np.zeros_like(p["kv"])
        self.gain = 1 - np.exp(-TICK / p["tau_current"])

    def force(self, wanted: Array, position: Array, speed: Array) -> Array:
        """Return the motor's force [N] (lanes,) for the next cycle."""
        p = self.p
        error = p["kv"] * (wanted[0] - position) + p["ff_speed"] * wanted[1] - speed
        self.integral = np.clip(self.integral + p["k_speed"] / p["ti_speed"] * TICK * error, -CAP, CAP)
        command = np.clip(p["k_speed"] * error + self.integral + p["ff_mass"] * wanted[2], -CAP, CAP)
        self.actual = self.actual + self.gain * (command - self.actual)
        return self.actual


class Plant:
    """The masses, their springs, the dead zone and the friction; `forces` holds what is beyond the paper's model."""

    def __init__(self, p: Lanes, h: float) -> None:
        self.p, self.h = p, h
        n = p["m_load"].size
        self.lanes = np.arange(n)
        self.extra = forces.active(p)
        bodies = forces.body_count(self.extra)
        self.x, self.v, self.a, self.net, self.vp = (np.zeros((bodies, n)) for _ in range(5))
        self.mass = forces.masses(p, bodies)
        self.coulomb = forces.rows(p, ("fc_motor", "fc_gear", "fc_pinion", "fc"), bodies)
        self.viscous = forces.rows(p, ("fv_motor", "fv_gear", "fv_pinion", "fv"), bodies)
        self.stiff = np.stack([p["k_gear"], p["k_shaft"]])
        self.damp = np.stack([p["d_gear"], p["d_shaft"]])
        self.middle = p["backlash"] * (0.5 - p["flank"])
        self.half = p["backlash"] / 2
        self.force: Array = np.zeros(n)
        self.partner = self.lanes + p["partner"].astype(int)
        self.gantry = bool(np.any(p["partner"] != 0))
        self.time, self.fresh = 0.0, True
        self.stretch, self.rate, self.load = (np.zeros((3, n)) for _ in range(3))
        self.smooth2 = p["v_smooth"] ** 2
        self.slip = self.direction = self.rubbing = np.zeros(n)
        self.based = any(isinstance(t, forces.Base) for t in self.extra)

    def position_and_speed(self) -> tuple[Array, Array]:
        """Return the motor's position [m] and predicted speed [m/s] of this instant, for the drive."""
        return self.x[MOTOR].copy(), self.v[MOTOR] + 0.5 * self.h * self.a[MOTOR]

    def advance(self, substeps: int, time: float, force: Array) -> Array:
        """Integrate one controller cycle under the motor force [N] (lanes,).

        The first kick reaches half a step back, into the old force's time: it sees the mean of both. The very first
        has no past and is half as long.

        Returns
        -------
        position, speed, force of the motor, position, speed of the load and flank at the cycle's begin (6, lanes)
        """
        half = 0.5 * self.h
        x, v, a = self.x, self.v, self.a
        positions = x[MOTOR].copy(), x[CARRIAGE].copy()
        self.force = 0.5 * (self.force + force)
        before = v.copy()
        self._accelerate(time)
        speed = before if self.fresh else before + half * a
        seen = np.stack(
            [positions[0], speed[MOTOR], force, positions[1], speed[CARRIAGE], self.stretch[2] + self.middle]
        )
        self._move(half if self.fresh else self.h)
        self.fresh, self.force = False, force
        for k in range(1, substeps):
            self._accelerate(time + k * self.h)
            self._move(self.h)
        return seen

    def _accelerate(self, time: float) -> None:
        """Compute the accelerations `a` at this instant from the positions and the predicted speeds."""
        self.time = time
        np.multiply(self.a, 0.0 if self.fresh else 0.5 * self.h, out=self.vp)
        np.add(self.vp, self.v, out=self.vp)
        self._internal()
        self._net()
        np.divide(self.net, self.mass, out=self.a)

    def _move(self, kick: float) -> None:
        """Kick the speeds and let the positions drift for one step."""
        np.multiply(self.a, kick, out=self.vp)
        np.add(self.v, self.vp, out=self.v)
        np.multiply(self.v, self.h, out=self.vp)
        np.add(self.x, self.vp, out=self.x)

    def _internal(self) -> None:
        """Forces between the bodies: two springs and the flanks, eqs. (5)-(7), into `load` (3, lanes)."""
        x, vp, s, r, f = self.x, self.vp, self.stretch, self.rate, self.load
        np.subtract(x[:3], x[1:4], out=s)
        np.subtract(vp[:3], vp[1:4], out=r)
        np.subtract(s[2], self.middle, out=s[2])
        for term in self.extra:
            term.between(self, s, r)
        np.multiply(self.stiff, s[:2], out=f[:2])
        f[:2] += self.damp * r[:2]
        f[2] = self._flank(s[2], r[2])
        for term in self.extra:
            term.transmit(self, s, r, f)

    def _flank(self, s: Array, r: Array) -> Array:
        """Return the flank force [N] (lanes,) for the distance from mid-gap `s` [m] and its rate `r` [m/s]."""
        depth = np.abs(s)
        depth -= self.half
        touched = np.abs(r)
        touched *= self.h
        touched += 1e-15
        np.divide(depth, touched, out=touched)
        touched += 0.5
        np.maximum(touched, 0.0, out=touched)
        np.minimum(touched, 1.0, out=touched)
        touched *= self.p["dp"]
        touched *= np.copysign(r, r * s)
        np.maximum(depth, 0.0, out=depth)
        depth *= self.p["kp"]
        depth += touched
        np.maximum(depth, 0.0, out=depth)
        return np.copysign(depth, s)

    def _net(self) -> None:
        """Net force on every body into `net` (bodies, lanes): motor, chain, bridge of eq. (9), friction."""
        net, vp, f = self.net, self.vp, self.load
        four = vp[:4]
        if self.based:
            four = four.copy()
            four[CARRIAGE] -= vp[BASE]
        slide = np.multiply(four, four)
        slide += self.smooth2
        np.sqrt(slide, out=slide)
        np.divide(four, slide, out=slide)
        if self.extra:
            self.slip, self.direction = four[CARRIAGE], slide[CARRIAGE].copy()
        slide *= self.coulomb[:4]
        slide += self.viscous[:4] * four
        self.rubbing = slide[CARRIAGE]
        np.negative(slide, out=net[:4])
        if len(net) > 4:
            net[4:] = 0.0
        net[:3] -= f
        net[1:4] += f
        net[MOTOR] += self.force
        if self.gantry:
            self._bridge()
        for term in self.extra:
            term.push(self, net)

    def _bridge(self) -> None:
        p, x, v = self.p, self.x[CARRIAGE], self.vp[CARRIAGE]
        pull = p["k_c"] * (x[self.partner] - x + p["z_c"]) + p["d_c"] * (v[self.partner] - v)
        self.net[CARRIAGE] += pull


__all__ = ["REST", "TICK", "Drive", "Lanes", "Plant", "Steps", "Traces", "setpoint", "simulate"]
