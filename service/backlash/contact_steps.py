"""One step of one axis made ready for the regression and the model fit: D(t), its parts, release and impact.

Symbols
-------
D : x̄_mot − x_mas [m], motor minus load at the output; x_mas by integrating the accelerometer twice from rest
s : direction of the step, ±1
t1, t2 : the flanks part, the flanks meet [s], recording's clock

Why not by thresholds, eqs. (11)-(12): the relative *speed* of motor and load is an integral, so its extreme
stands far above the sensor's noise where the difference of two accelerations does not. It grows through
the whole gap and reverses within a fraction of the contact's period after the impact.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline, PPoly

from service.recording import FloatArray, Move, Recording, Trace

REST_BEFORE = 0.1
"""Rest looked at before a move [s]: chosen, shorter than the pause between two steps of one run."""

RING_TIME = 0.004
"""Time after each corner of the jerk in which the drive still rings [s]: chosen, see estimator.md no. 2."""


@dataclass(frozen=True)
class ContactStep:
    """One step on the accelerometer's own time stamps, from the move's start to its end.

    Attributes
    ----------
    index : of the move in the recording
    s : direction ±1
    time : (n,) [s] recording's clock
    v_mot, x_mot : (n,) [m/s], [m] motor at the output
    a_mas : (n,) [m/s²] load acceleration, its mean at rest removed
    v_mas, D : (n,) [m/s], [m]
    noise : standard deviation of one accelerometer sample at rest [m/s²]
    t1, t2 : release and impact [s]
    """

    index: int
    s: int
    time: FloatArray
    v_mot: FloatArray
    x_mot: FloatArray
    a_mas: FloatArray
    v_mas: FloatArray
    D: FloatArray
    noise: float
    t1: float
    t2: float


def rest_noise(trace: Trace) -> float:
    """Standard deviation of white noise [trace's unit] from differences, robust against slow motion (MAD)."""
    d = np.diff(trace.value)
    return float(1.4826 * np.median(np.abs(d - np.median(d))) / np.sqrt(2.0))


def output_speed(speed: Trace, transmission: float) -> CubicSpline:
    """Motor speed at the output [m/s] as a C2 spline; a lost sample widens one interval."""
    return CubicSpline(speed.time, speed.value * transmission)


def running_integral(time: FloatArray, value: FloatArray) -> FloatArray:
    """∫ value dt by trapezoids, zero at the first sample; (n,) each."""
    return np.concatenate(([0.0], np.cumsum(0.5 * np.diff(time) * (value[1:] + value[:-1]))))


def smooth(time: FloatArray, value: FloatArray, width: float) -> FloatArray:
    """Centred mean over about `width` [s], an odd number of samples; edges hold the first and last value."""
    n = max(1, round(width / float(np.median(np.diff(time))))) | 1
    padded = np.pad(value, n // 2, mode="edge")
    return np.asarray(np.convolve(padded, np.full(n, 1.0 / n), mode="valid"))


def impact_time(time: FloatArray, relative_speed: FloatArray, move: Move) -> float:
    """t2 [s]: where motor falls behind load fastest, s·(v_mas − v_mot) largest, in the middle of the move."""
    inside = (time > move.start + 0.35 * move.duration) & (time < move.start + 0.9 * move.duration)
    seen = np.where(inside, relative_speed, -np.inf)
    return float(time[int(np.argmax(seen))])


def release_time(time: FloatArray, acceleration: FloatArray, t2: float, noise: float, move: Move) -> float:
    """t1 [s]: the last moment before t2 at which s·ẍ_mas was above what friction alone gives, eq. (8).

    Early rather than late: in contact the regression's law holds up to the release, after it it does not.
    """
    gap = (time > t2 - 0.004) & (time < t2 - 0.0015)
    level = float(np.median(acceleration[gap])) if gap.any() else 0.0
    quiet = smooth(time, acceleration, 0.001)
    driven = (quiet > level + max(2.0 * noise, 0.1)) & (time < t2 - 0.0015) & (time > move.start)
    return float(time[driven][-1]) if driven.any() else float("nan")


def contact_step(recording: Recording, axis: str, index: int, v_mot: PPoly) -> ContactStep | None:
    """Cut and integrate one step; None when its samples do not reach over the move."""
    move, trace = recording.moves[index], recording.trace(axis, "acceleration")
    if trace is None:
        return None
    rest = trace.between(move.start - REST_BEFORE, move.start)
    part = trace.between(move.start, move.end + 0.5 * RING_TIME)
    if len(rest) < 20 or len(part) < 40:
        return None
    s, t, noise = move.direction, part.time, rest_noise(rest)
    a = part.value - float(np.mean(rest.value))
    v = running_integral(t, a)
    x_mot = v_mot.antiderivative()(t)
    D = x_mot - x_mot[0] - running_integral(t, v)
    speed = np.asarray(v_mot(t))
    t2 = impact_time(t, s * (v - speed), move)
    t1 = release_time(t, s * a, t2, noise, move)
    return ContactStep(index, s, t, speed, x_mot, a, v, D, noise, t1, t2)
