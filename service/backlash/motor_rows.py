"""Eq. (1) at the motor as further rows of a fit: what the torque tells of the force on the motor.

The accelerometer tells the parts of a guide's friction from one another only by when flanks meet. The torque has to
overcome friction all the way, so what is left of the motor's equation of motion,

    a_mot = −force·F + torque·τ − friction at the motor,

with the force F that a model makes is a second witness: of friction above all. What the motor has of its own (its
inertia under both, its friction, which is a constant against the motion and a share of the speed, and how late torque
and force are) is fitted to every move by itself and taken off, so that the rows say nothing of it and stay within their
move. They are over the noise of speed and torque and over what a right model's force may be off by: after an impact
the motor's motion between two samples of its speed is known so well only, and stiff flanks turn 0.1 µm into newtons.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PPoly
from scipy.sparse import csr_array

from service.dynamics.driven_reconstruction import (
    Load,
    behind,
    force_course,
    mean_between,
    torque_courses,
    window,
)
from service.recording import FloatArray, Trace

MOVING = 0.05
"""Share of a move's greatest speed from which on the motor moves; below, its friction is none of these."""
OWN = 6
"""What is fitted to every move: force and torque, how late each is, and two parts of friction."""
FORCE = 4
"""Where among these the force is; how late it is comes last."""
LATE = 1e-4
"""Unit of how late they are [s]."""
EXACT = 1e-3
"""Share of the motor's acceleration to which its equation holds at best: of a recording without noise, too (chosen)."""
UNHEARD = 1e-7
"""Weight of a force, over the greatest, from which on it is not heard (chosen: what single precision would hold)."""
BETWEEN = 0.75
"""Noise of the mean of a course between two samples, over that of one, about (chosen): a straight line's has 0.71, that
of a cubic through four samples, (−1, 13, 13, −1)/24, 0.77."""


@dataclass(frozen=True)
class Heard:
    """How the force at the K + 1 points of a step's grid is heard between n + 1 neighbouring speed samples: its mean
    and its change over `LATE`, (n, K + 1) each. A force is heard near its own time only."""

    mean: csr_array
    change: csr_array


@dataclass(frozen=True)
class MotorRows:
    """What is left of the balance of one motor in one move, over its standard deviation: n rows.

    Attributes
    ----------
    heard : how the force is heard
    weight : (n,) one over the standard deviation [s²/m]; 0 where the motor does not move
    own : (n, q) what else than the force acts, weighed and orthonormal
    acceleration : (n,) of the motor, weighed, without what `own` explains
    place : (n,) where the motor is [m]
    """

    heard: Heard
    weight: FloatArray
    own: FloatArray
    acceleration: FloatArray
    place: FloatArray

    def of(self, force: FloatArray) -> FloatArray:
        """The rows (S, n) by forces per moved mass (S, K + 1) [m/s²]; one that would not hold the motor back acts on it
        by nothing."""
        mean, change = (
            self.without_own((how @ force.T).T * self.weight) for how in (self.heard.mean, self.heard.change)
        )
        mm, mc, cc = (np.sum(a * b, axis=1) for a, b in ((mean, mean), (mean, change), (change, change)))
        my, cy = mean @ self.acceleration, change @ self.acceleration
        scale = mm * cc - mc * mc
        scale = np.where(scale > 1e-12 * mm * cc, scale, np.inf)
        of_mean, of_change = (cc * my - mc * cy) / scale, (mm * cy - mc * my) / scale
        explained = of_mean[:, None] * mean + of_change[:, None] * change
        return np.asarray(self.acceleration - np.where(of_mean[:, None] > 0.0, 0.0, explained))

    def without_own(self, rows: FloatArray) -> FloatArray:
        """Rows (S, n) without what `own` explains."""
        return np.asarray(rows - (rows @ self.own) @ self.own.T)

    def over(self, spread: float) -> MotorRows:
        """The same rows over a standard deviation that is so many times as large."""
        return replace(self, weight=self.weight / spread, acceleration=self.acceleration / spread)


def motor_rows(
    speed: Trace,
    torque: Trace,
    noise_left: FloatArray,
    transmission: float,
    loads: Sequence[Load],
    motions: Sequence[PPoly],
    noise: tuple[float, float],
    off: Sequence[FloatArray],
    lag: float = 0.0,
) -> list[MotorRows]:
    """The rows of one motor in every move over the noise; none where so many samples of its speed were lost that they
    tell nothing.

    Parameters
    ----------
    noise_left : share of the noise of each speed sample that is left by averaging alike moves, which then share it
    transmission : [m/rad]
    loads : the force on the motor as the model says it so far
    motions : of the motor so far
    noise : standard deviation of a sample of the speed [rad/s] and of the torque [N m]
    off : (S, K + 1) courses by which that force may be off with a right model, whose squares add up [m/s²]
    lag : of the speed that the drive reports [s]
    """
    within = [(speed.time >= load[0][0]) & (speed.time <= load[0][-1]) for load in loads]
    if min(np.count_nonzero(inside) for inside in within) <= 2 * OWN:
        return []
    courses = torque_courses([window(torque, load) for load in loads], motions, lag)
    known: dict[tuple[int, int], Heard] = {}
    balances, left = [], []
    for load, course, motion, inside in zip(loads, courses, motions, within, strict=True):
        time, v = speed.time[inside], speed.value[inside] * transmission
        where = (round((float(time[0]) - float(load[0][0])) * 1e7), len(time))
        if where not in known:
            known[where] = heard(load[0], time, lag)
        place = np.asarray(motion(0.5 * (time[1:] + time[:-1])))
        balances.append(Balanced(known[where], course, time, v, place))
        left.append(float(np.mean(noise_left[inside])))
    out = []
    for one, load, share, of_force in zip(balances, loads, left, off, strict=True):
        found = one.found(load[1])
        about = np.maximum(one.by_noise(found, noise, transmission), one.least) / share
        doubted = np.abs(found[FORCE]) * np.sqrt(np.sum((one.heard.mean @ of_force.T) ** 2, axis=1))
        out.append(one.rows(np.where(one.moving, 1.0 / np.hypot(about, doubted), 0.0)))
    return out


@dataclass(frozen=True)
class Balanced:
    """What eq. (1) is about in one move: the torque's course [N m], times [s] and values [m/s] of the motor's speed at
    the output, and where it is between them [m]."""

    heard: Heard
    torque: PPoly
    time: FloatArray
    speed: FloatArray
    place: FloatArray

    @property
    def mean(self) -> FloatArray:
        """(n,) speed between the samples [m/s]."""
        return np.asarray(0.5 * (self.speed[1:] + self.speed[:-1]))

    @property
    def moving(self) -> NDArray[np.bool_]:
        """(n,) where the motor moves."""
        return np.asarray(np.abs(self.mean) > MOVING * np.max(np.abs(self.speed)))

    @property
    def acceleration(self) -> FloatArray:
        """(n,) between the samples [m/s²]."""
        return np.asarray(np.diff(self.speed) / np.diff(self.time))

    @property
    def least(self) -> float:
        """Standard deviation that the balance has at least [m/s²]."""
        return max(EXACT * float(np.sqrt(np.mean(self.acceleration**2))), 1e-12)

    @property
    def own(self) -> FloatArray:
        """(n, 4) what else than the force acts: the torque, how late it is, and two parts of friction."""
        late = LATE * np.diff(self.torque(self.time)) / np.diff(self.time)
        torque = mean_between(self.torque, self.time)
        return np.column_stack((torque, late, self.mean, np.sign(self.mean)))

    def rows(self, weight: FloatArray) -> MotorRows:
        """The rows, weighed by (n,) [s²/m]."""
        own, acceleration = np.linalg.qr(self.own * weight[:, None])[0], self.acceleration * weight
        return MotorRows(self.heard, weight, own, acceleration - own @ (own.T @ acceleration), self.place)

    def found(self, force: FloatArray) -> FloatArray:
        """(6,) the factors with which `own`, such a force (K + 1,) and its change balance the motor where it moves."""
        acts = np.column_stack((self.own, self.heard.mean @ force, self.heard.change @ force))
        return np.asarray(np.linalg.lstsq(acts[self.moving], self.acceleration[self.moving], rcond=None)[0])

    def by_noise(self, found: FloatArray, noise: tuple[float, float], transmission: float) -> FloatArray:
        """(n,) the standard deviation of the balance with such factors by the noise of speed and torque."""
        of_speed = noise[0] * transmission * np.sqrt(2.0) / np.diff(self.time)
        return np.asarray(np.hypot(of_speed, found[0] * noise[1] * BETWEEN))


def heard(grid: FloatArray, time: FloatArray, lag: float) -> Heard:
    """How forces at the grid's times (K + 1,) are heard between the times (n + 1,) of speed samples, behind a `lag`."""
    unit = behind(np.eye(len(grid)), float(grid[1] - grid[0]), lag)
    course = force_course((grid, unit))
    dt = np.diff(time)[:, None]
    mean = np.diff(course.antiderivative()(time), axis=0) / dt
    change = LATE * np.diff(course(time), axis=0) / dt
    return Heard(near_by(mean), near_by(change))


def near_by(how: FloatArray) -> csr_array:
    """The weights without those that are too small to be heard."""
    return csr_array(np.where(np.abs(how) > UNHEARD * np.max(np.abs(how), initial=0.0), how, 0.0))
