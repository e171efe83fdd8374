"""The motor's motion between its speed samples, from its own equation (1).

Between its samples the motor is not simply smooth: at the impact its acceleration follows the contact force at
once, and the drive's torque follows the motor's speed within its current loop's lag. A spline through samples at
500 Hz cuts both corners, an error of the input that looks like a wrong structure. So eq. (1) with the simulated
force and the measured torque is integrated and only the difference to the measured speed is a spline; and the
torque between its own samples is what a drive with proportional speed feedback makes of that speed, with a spline
of the difference to the measured torque.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline, CubicSpline, PPoly
from scipy.signal import lfilter

from service.dynamics.driven_motion import between
from service.recording import FloatArray, Trace

EDGE_SAMPLES = 3
"""Samples beyond a step's grid that still hold the correction's spline; beyond them forces are held."""

FINE = 1e-4
"""Spacing at which the drive's reaction is followed [s]: a fifth of a sample at 2 kHz."""

LAGS = (1e-4, 2e-4, 3.5e-4, 5e-4, 7e-4, 1e-3, 1.4e-3, 2e-3)
"""Lags of the torque behind the speed that are tried [s]: a drive's cycle and its current loop."""

AT_ONCE = 64
"""Forces whose echoes are found at once: their splines hold fifteen numbers for each grid point and force."""

FORGOTTEN = 12
"""Samples after which a cubic spline has forgotten one: each leaves 0.27 of what the one before it left."""

Load = tuple[FloatArray, FloatArray]
"""Times [s] and the simulated force on the motor per moved mass [m/s²] of one step."""


@dataclass(frozen=True)
class Balance:
    """Eq. (1) at the output as found in the recording: a_mot = −force·F + torque·τ + smooth rest.

    force : M over the motor's inertia at the output [1]; torque : [m/s² per N m]
    """

    force: float
    torque: float


@dataclass(frozen=True)
class Drive:
    """How the torque follows the speed at the output: τ = −gain·(speed behind a first-order lag) + smooth rest.

    gain [N m per m/s]; lag [s]
    """

    gain: float
    lag: float


def as_reported(load: Load, lag: float) -> Load:
    """The force that makes the speed which a drive reports behind a first-order lag [s]: eq. (1) holds of both alike,
    since it is linear."""
    time, force = load
    return time, behind(force, float(time[1] - time[0]), lag)


def window(trace: Trace, load: Load) -> Trace:
    """A trace's samples around one step."""
    margin = (EDGE_SAMPLES + 0.5) * float(np.median(np.diff(trace.time)))
    return trace.between(float(load[0][0]) - margin, float(load[0][-1]) + margin)


def force_course(load: Load) -> PPoly:
    """The force between its grid points; held beyond them."""
    time, force = load
    outside = 0.05 * np.arange(1, 3)
    times = np.concatenate((time[0] - outside[::-1], time, time[-1] + outside))
    return CubicSpline(times, np.concatenate((force[:1], force[:1], force, force[-1:], force[-1:])))


def linear(time: FloatArray, value: FloatArray) -> PPoly:
    """Straight lines between samples, held at the ends by extrapolating them."""
    return PPoly(np.vstack((np.diff(value) / np.diff(time), value[:-1])), time)


def mean_between(course: PPoly, time: FloatArray) -> FloatArray:
    """Mean of a course between neighbouring times: (n − 1,)."""
    return np.asarray(np.diff(course.antiderivative()(time)) / np.diff(time))


def behind(course: FloatArray, spacing: float, lag: float) -> FloatArray:
    """Courses (n, …) of points so far apart [s] behind a first-order lag [s]; straight between them, steady before."""
    if not lag > 0.0:
        return course
    keep = np.exp(-spacing / lag)
    gain = lag / spacing * (1.0 - keep)
    out, _ = lfilter([1.0 - gain, gain - keep], [1.0, -keep], course, axis=0, zi=gain * course[:1])
    return np.asarray(out)


def lagging(motion: PPoly, times: FloatArray, lag: float) -> tuple[FloatArray, FloatArray]:
    """Fine times [s] over the span of `times` and a motor's speed behind a first-order lag [m/s]."""
    fine = np.arange(times[0], times[-1] + FINE, FINE)
    return fine, behind(np.asarray(motion(fine, 1)), FINE, lag)


def drive_of(torques: Sequence[Trace], motions: Sequence[PPoly]) -> Drive:
    """Gain and lag by least squares on the second differences of the torque: what changes from sample to sample is
    the drive's answer to the speed, its integral and the commanded motion are smooth."""
    right = np.concatenate([np.diff(part.value, 2) for part in torques])
    found = []
    for lag in LAGS:
        column = np.concatenate(
            [
                np.diff(np.interp(part.time, *lagging(motion, part.time, lag)), 2)
                for part, motion in zip(torques, motions, strict=True)
            ]
        )
        gain = -float(column @ right) / max(float(column @ column), 1e-30)
        found.append((float(np.sum((right + gain * column) ** 2)), gain, lag))
    _, gain, lag = min(found)
    return Drive(max(gain, 0.0), lag)


def torque_courses(torques: Sequence[Trace], motions: Sequence[PPoly], lag: float = 0.0) -> list[PPoly]:
    """The torque around every step [N m], from its samples there and the motor's motion so far; as it makes the speed
    that is reported behind a `lag` [s]."""
    drive = drive_of(torques, motions)
    return [torque_course(part, motion, drive, lag) for part, motion in zip(torques, motions, strict=True)]


def torque_course(part: Trace, motion: PPoly, drive: Drive, lag: float) -> PPoly:
    """The torque around one step: the drive's answer to the speed, and a spline of the difference to the samples."""
    fine, speed = lagging(motion, part.time, drive.lag)
    answer = -drive.gain * speed
    rest = CubicSpline(part.time, part.value - np.interp(part.time, fine, answer))
    return CubicSpline(fine, behind(answer + rest(fine), FINE, lag))


def motor_balance(
    speed: Trace, transmission: float, loads: Sequence[Load], torques: Sequence[PPoly] | None
) -> Balance:
    """Least squares for the mean acceleration between neighbouring speed samples of all steps.

    Friction at the motor is a constant and a share of the speed. Without torque only what changes from one
    interval to the next is balanced, in which the impact stands out against the controller's smooth torque.
    """
    rows, right = [], []
    for t, load in enumerate(loads):
        part = speed.between(float(load[0][0]), float(load[0][-1]))
        v, dt = part.value * transmission, np.diff(part.time)
        columns = [-mean_between(force_course(load), part.time)]
        if torques is not None:
            columns.append(mean_between(torques[t], part.time))
        columns += [0.5 * (v[1:] + v[:-1]), np.sign(v[1:] + v[:-1])]
        block, acceleration = np.column_stack(columns), np.diff(v) / dt
        rows.append(block if torques is not None else np.diff(block, axis=0))
        right.append(acceleration if torques is not None else np.diff(acceleration))
    found = np.linalg.lstsq(np.vstack(rows), np.concatenate(right), rcond=None)[0]
    return Balance(float(found[0]), float(found[1]) if torques is not None else 0.0)


def reconstructed_motion(
    speed: Trace,
    transmission: float,
    load: Load,
    torque: PPoly | None,
    balance: Balance,
    before: PPoly,
    kept: float = 0.0,
) -> PPoly:
    """Position [m] around one step: eq. (1) between the samples, a spline of the difference through them.

    `before` is the motion so far, of which the share `kept` stays.
    """
    part, force = window(speed, load), force_course(load)
    knots = np.unique(np.concatenate((load[0], part.time)))
    acceleration, v = -balance.force * force(knots), -balance.force * force.antiderivative()(knots)
    if torque is not None:
        acceleration = acceleration + balance.torque * torque(knots)
        v = v + balance.torque * torque.antiderivative()(knots)
    v = v - v[0]
    left = CubicSpline(part.time, part.value * transmission - np.interp(part.time, knots, v))
    v, acceleration = v + left(knots), acceleration + left(knots, 1)
    v, acceleration = (
        (1.0 - kept) * new + kept * before(knots, nu) for nu, new in ((1, v), (2, acceleration))
    )
    position = CubicHermiteSpline(knots, v, acceleration).antiderivative()
    # The two motors of a gantry keep their distance from step to step: the position goes on from the whole run's.
    position.c[-1] += float(before(knots[0]))
    return position


@dataclass(frozen=True)
class Echo:
    """How speed and acceleration of a reconstructed motion answer the forces at the K + 1 points of a step's grid.

    A spline forgets within a few samples, so a force is heard near its own time only; that is what is held, in single
    precision: over all points it would be the largest array of a fit.

    Attributes
    ----------
    start, h, points : first grid point on the motor's clock and spacing [s], K + 1
    size : what an answer is multiplied by
    parts : forces that follow one another, the points at which they are heard, and the answer (2, n, m) of n points to
        m forces, of a motor as heavy as the load
    """

    start: float
    h: float
    points: int
    size: float
    parts: tuple[tuple[slice, slice, NDArray[np.float32]], ...]

    def of(self, force: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Position, speed and acceleration (M, K + 1) that forces (M, K + 1) add to the motion."""
        out = np.zeros((2, len(force), self.points))
        for forces, heard, answer in self.parts:
            out[:, :, heard] += force[:, forces] @ answer.swapaxes(1, 2)
        v, a = self.size * out
        pieces = 0.5 * self.h * (v[:, 1:] + v[:, :-1]) + self.h**2 / 12.0 * (a[:, :-1] - a[:, 1:])
        position = np.zeros_like(v)
        np.cumsum(pieces, axis=1, out=position[:, 1:])
        return position, v, a


def echo(
    speed: Trace,
    load: Load,
    balance: Balance,
    share: float = 1.0,
    before: Echo | None = None,
    lag: float = 0.0,
) -> Echo:
    """How a reconstructed motion changes with the force at a step's grid points, linear, since the spline through the
    samples takes back what they contradict; `share` of it, behind the drive's `lag` [s]. An echo from `before` on the
    same times differs in size."""
    size, start = -share * balance.force, float(load[0][0])
    if before is not None and before.start == start:
        return replace(before, size=size)
    part, time = window(speed, load), load[0]
    h, points = float(time[1] - time[0]), len(time)
    reach = round(FORGOTTEN * float(np.median(np.diff(part.time))) / h)
    parts = []
    for first in range(0, points, AT_ONCE):
        forces = slice(first, min(first + AT_ONCE, points))
        heard = slice(max(0, forces.start - reach), min(points, forces.stop + reach))
        unit = behind(np.eye(points)[:, forces], h, lag)
        answer = unit_echoes(part, (time, unit), time[heard])
        parts.append((forces, heard, answer.astype(np.float32)))
    return Echo(start, h, points, size, tuple(parts))


def unit_echoes(part: Trace, load: Load, at: FloatArray) -> FloatArray:
    """The answer (2, n, …) of a motor as heavy as the load to forces (K + 1, …), at the times (n,)."""
    force = force_course(load)
    once = force.antiderivative()
    left = CubicSpline(part.time, once(part.time))
    return np.stack((once(at) - left(at), force(at) - left(at, 1)))


def answered(changed: FloatArray, echoes: Sequence[Sequence[Echo]], h: float) -> FloatArray:
    """What the motors' motion changes where the forces on them change by (S, T, X, K + 1), each having an echo (T, X):
    (S, T, K, X, 5). Steps that share an echo are done at once."""
    S, T, X, points = changed.shape
    out = np.empty((S, T, points - 1, X, 5))
    for x in range(X):
        alike: dict[int, list[int]] = {}
        for t in range(T):
            alike.setdefault(id(echoes[t][x]), []).append(t)
        for steps in alike.values():
            moved = echoes[steps[0]][x].of(changed[:, steps, x].reshape(-1, points))
            position, v, a = (part.reshape(S, len(steps), points) for part in moved)
            out[:, :, :, x][:, steps] = between(position, v, a, h)
    return out
