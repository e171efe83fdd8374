"""The motor's measured motion as the model's input: polynomials on the accelerometer's grid.

The grid follows the accelerometer: one interval per sample, centred on its time stamp, so that the mean
acceleration over the interval is the difference of the model's speed at its ends. Lost samples leave the grid
as it is. The motor is looked up at grid time + skew.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline, PPoly

from service.dynamics.compiled import lean, within
from service.recording import FloatArray, Trace


@dataclass(frozen=True)
class StepGrid:
    """One step on the accelerometer's grid.

    Attributes
    ----------
    index : of the move in the recording
    s : direction ±1
    start : time of the first grid point [s]; K intervals of length h [s] follow
    measured : (X, K) load accelerations [m/s²], NaN where a sample was lost
    used : (X, K) bool, whether a sample takes part in the fit
    """

    index: int
    s: int
    start: float
    h: float
    measured: FloatArray
    used: NDArray[np.bool_]

    @property
    def time(self) -> FloatArray:
        """The K + 1 grid points [s]."""
        return self.start + self.h * np.arange(self.measured.shape[1] + 1)


def sample_period(trace: Trace) -> float:
    """Length of one sample interval [s] by regression of time on sample number; lost samples are counted."""
    rough = float(np.median(np.diff(trace.time)))
    number = np.concatenate(([0.0], np.cumsum(np.round(np.diff(trace.time) / rough))))
    return float(np.polyfit(number, trace.time, 1)[0])


def on_grid(trace: Trace, start: float, h: float, K: int) -> FloatArray:
    """Samples put into the grid's intervals by their time stamps: (K,), NaN where there is none."""
    part = trace.between(start, start + K * h)
    out = np.full(K, np.nan)
    out[np.clip(np.floor((part.time - start) / h).astype(int), 0, K - 1)] = part.value
    return out


def plain_motion(speed: Trace, transmission: float) -> PPoly:
    """Position [m] at the output by a C2 spline through the measured speed; enough at 1 kHz."""
    return CubicSpline(speed.time, speed.value * transmission).antiderivative()


def coefficients(position: PPoly, start: float, h: float, K: int) -> FloatArray:
    """c_j of x_mot(t) = Σ c_j t^j/j! in each grid interval: (K, 5); exact in speed and acceleration at its ends."""
    out = np.empty((K, 5))
    fill(np.ascontiguousarray(position.c), position.x, float(start), float(h), out)
    return out


@lean
def fill(c: FloatArray, x: FloatArray, start: float, h: float, out: FloatArray) -> None:
    """`coefficients` of the piecewise polynomial with c (degree + 1, pieces) and breakpoints x, into out."""
    low, high = 0, len(x) - 2
    while low < high:
        middle = (low + high + 1) // 2
        if x[middle] <= start:
            low = middle
        else:
            high = middle - 1
    p = v = a = 0.0
    for k in range(len(out) + 1):
        t = start + h * k
        while low < len(x) - 2 and t >= x[low + 1]:
            low += 1
        first_p, first_v, first_a = p, v, a
        p = v = a = 0.0
        for degree in range(len(c)):
            a = a * (t - x[low]) + 2.0 * v
            v = v * (t - x[low]) + p
            p = p * (t - x[low]) + c[degree, low]
        if k > 0:
            mean = (v - first_v) / h
            out[k - 1, 0], out[k - 1, 1], out[k - 1, 2] = first_p, first_v, first_a
            out[k - 1, 3] = (6.0 * mean - 4.0 * first_a - 2.0 * a) / h
            out[k - 1, 4] = 6.0 * (first_a + a - 2.0 * mean) / h**2


def of_motors(
    motion: Sequence[Sequence[PPoly]], starts: FloatArray, h: float, K: int, skews: FloatArray
) -> FloatArray:
    """Motion (T, X) of the motors on grids that begin at `starts` (T,), each looked up at grid time + skew (S, X) [s]:
    (S, T, K, X, 5)."""
    S, X = skews.shape
    out = np.empty((S, len(starts), K, X, 5))
    for x in range(X):
        levels, of = np.unique(skews[:, x], return_inverse=True)
        looked_up = np.empty((len(levels), len(starts), K, 5))
        for t, start in enumerate(starts):
            c, places = np.ascontiguousarray(motion[t][x].c), motion[t][x].x
            for u, skew in enumerate(levels):
                fill(c, places, float(start + skew), float(h), looked_up[u, t])
        out[:, :, :, x] = looked_up[of] if len(levels) > 1 else looked_up
    return out


def between(x: FloatArray, v: FloatArray, a: FloatArray, h: float) -> FloatArray:
    """Polynomials that have speed and acceleration at both ends of every interval: (…, K + 1) -> (…, K, 5)."""
    out = np.empty((*x.shape[:-1], x.shape[-1] - 1, 5))
    mean, first, last = np.diff(v, axis=-1) / h, a[..., :-1], a[..., 1:]
    out[..., 0], out[..., 1], out[..., 2] = x[..., :-1], v[..., :-1], first
    out[..., 3] = (6.0 * mean - 4.0 * first - 2.0 * last) / h
    out[..., 4] = 6.0 * (first + last - 2.0 * mean) / h**2
    return out


def along(value: FloatArray, slope: FloatArray, bow: FloatArray, points: FloatArray, h: float) -> FloatArray:
    """Motion (S, T, K, J) of what depends on the place, by its value and its first and second derivative (S, T, K + 1)
    at the grid points, see `grid_points`."""
    speed, rate = points[..., 1], points[..., 2]
    return between(value, slope * speed, slope * rate + bow * speed**2, h)


def grid_points(c: FloatArray, h: float) -> FloatArray:
    """Position, speed, acceleration at the K + 1 grid points: c (S, T, K, J) -> (S, T, K + 1, 3)."""
    last, powers = c[:, :, -1:], h ** np.arange(c.shape[-1]) / np.array([1.0, 1.0, 2.0, 6.0, 24.0])
    ends = [last[..., j:] @ powers[: c.shape[-1] - j] for j in range(3)]
    return np.concatenate((c[..., :3], np.stack(ends, axis=-1)), axis=2)


@lean
def add_error(c: FloatArray, axis: int, powers: FloatArray, origin: float, scale: float, h: float) -> None:
    """Add to the motions c (S, T, K, X, 5) of one axis an error that depends on the place, Σ powers_i·u^i [m] with
    u = scale·(x_mot − origin) − 1 and powers (S, I); exact in speed and acceleration at the ends of the intervals."""
    for s in range(c.shape[0]):
        absent = True
        for size in powers[s]:
            absent = absent and size == 0.0
        if absent:
            continue
        for t in range(c.shape[1]):
            add_error_to_step(c[s, t, :, axis], powers[s], origin, scale, h)


@within
def add_error_to_step(c: FloatArray, powers: FloatArray, origin: float, scale: float, h: float) -> None:
    """`add_error` for one step's motion c (K, 5)."""
    K = len(c)
    x = v = a = first_speed = first_rate = 0.0
    for k in range(K + 1):
        if k < K:
            x, v, a = c[k, 0], c[k, 1], c[k, 2]
        else:
            third, fourth = c[K - 1, 3], c[K - 1, 4]
            x += h * (v + h / 2.0 * (a + h / 3.0 * (third + h / 4.0 * fourth)))
            v += h * (a + h / 2.0 * (third + h / 3.0 * fourth))
            a += h * (third + h / 2.0 * fourth)
        u = scale * (x - origin) - 1.0
        error = slope = bow = 0.0
        for i in range(len(powers) - 1, -1, -1):
            bow = bow * u + 2.0 * slope
            slope = slope * u + error
            error = error * u + powers[i]
        speed, rate = scale * slope * v, scale * slope * a + scale**2 * bow * v**2
        if k > 0:
            mean = (speed - first_speed) / h
            c[k - 1, 3] += (6.0 * mean - 4.0 * first_rate - 2.0 * rate) / h
            c[k - 1, 4] += 6.0 * (first_rate + rate - 2.0 * mean) / h**2
        if k < K:
            c[k, 0] += error
            c[k, 1] += speed
            c[k, 2] += rate
        first_speed, first_rate = speed, rate
