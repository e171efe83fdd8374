"""The motor's measured motion as the model's input: polynomials on the accelerometer's grid.

The grid follows the accelerometer: one interval per sample, centred on its time stamp, so that the mean
acceleration over the interval is the difference of the model's speed at its ends. Lost samples leave the grid
as it is. The motor is looked up at grid time + skew.

Between its samples the motor is not simply smooth: at the impact its acceleration follows the contact force at
once. A spline through samples at 500 Hz cuts that corner, an error of the input that looks like a wrong
structure. So the motor's own equation (1), with the simulated force and the measured torque, is integrated and
only the difference to the measured speed is a spline.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline, CubicSpline, PPoly

from service.recording import FloatArray, Trace

EDGE_SAMPLES = 3
"""Speed samples beyond a step's grid that still hold the correction's spline; beyond them forces are held."""


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
    t = start + h * np.arange(K + 1)
    x, v, a = (np.asarray(position(t, nu)) for nu in range(3))
    mean, first, last = np.diff(v) / h, a[:-1], a[1:]
    bend = (6.0 * mean - 4.0 * first - 2.0 * last) / h
    return np.column_stack((x[:-1], v[:-1], first, bend, 6.0 * (first + last - 2.0 * mean) / h**2))


@dataclass(frozen=True)
class Balance:
    """Eq. (1) at the output as found in the recording: a_mot = −force·F + torque·τ + smooth rest.

    force : M over the motor's inertia at the output [1]; torque : [m/s² per N m]
    """

    force: float
    torque: float


def motor_balance(
    speed: Trace, transmission: float, loads: list[tuple[FloatArray, FloatArray]], torque: Trace | None
) -> Balance:
    """Least squares for the mean acceleration between neighbouring speed samples of all steps.

    Parameters
    ----------
    loads : per step the fine times [s] and the simulated force on the motor per moved mass [m/s²]

    Friction at the motor is a constant and a share of the speed. Without torque only what changes from one
    interval to the next is balanced, in which the impact stands out against the controller's smooth torque.
    """
    rows, right = [], []
    for time, force in loads:
        part = speed.between(float(time[0]), float(time[-1]))
        v, dt = part.value * transmission, np.diff(part.time)
        columns = [-mean_between(linear(time, force), part.time)]
        if torque is not None:
            columns.append(mean_between(linear(torque.time, torque.value), part.time))
        columns += [0.5 * (v[1:] + v[:-1]), np.sign(v[1:] + v[:-1])]
        block, acceleration = np.column_stack(columns), np.diff(v) / dt
        rows.append(block if torque is not None else np.diff(block, axis=0))
        right.append(acceleration if torque is not None else np.diff(acceleration))
    found = np.linalg.lstsq(np.vstack(rows), np.concatenate(right), rcond=None)[0]
    return Balance(float(found[0]), float(found[1]) if torque is not None else 0.0)


def linear(time: FloatArray, value: FloatArray) -> PPoly:
    """Straight lines between samples, held at the ends by extrapolating them."""
    return PPoly(np.vstack((np.diff(value) / np.diff(time), value[:-1])), time)


def mean_between(course: PPoly, time: FloatArray) -> FloatArray:
    """Mean of a course between neighbouring times: (n − 1,)."""
    return np.asarray(np.diff(course.antiderivative()(time)) / np.diff(time))


def reconstructed_motion(
    speed: Trace,
    transmission: float,
    load: tuple[FloatArray, FloatArray],
    torque: Trace | None,
    balance: Balance,
    plain: PPoly,
) -> PPoly:
    """Position [m] around one step: eq. (1) between the samples, a spline of the difference through them."""
    time, force = load
    margin = (EDGE_SAMPLES + 0.5) * float(np.median(np.diff(speed.time)))
    part = speed.between(float(time[0]) - margin, float(time[-1]) + margin)
    knots = np.unique(np.concatenate((time, part.time)))
    acceleration = -balance.force * np.interp(knots, time, force)
    if torque is not None:
        acceleration = acceleration + balance.torque * np.interp(knots, torque.time, torque.value)
    v = np.concatenate(([0.0], np.cumsum(0.5 * np.diff(knots) * (acceleration[1:] + acceleration[:-1]))))
    left = CubicSpline(part.time, part.value * transmission - np.interp(part.time, knots, v))
    position = CubicHermiteSpline(knots, v + left(knots), acceleration + left(knots, 1)).antiderivative()
    # The two motors of a gantry keep their distance from step to step: the position goes on from the whole run's.
    position.c[-1] += float(plain(knots[0]))
    return position
