"""The motor's motion between its samples: an impact moves the motor faster than the drive reports its speed.

Eq. (1) at the output, a_mot = -alpha F + beta tau - friction, with the simulated force F on the motor and the
measured torque tau: its coefficients by least squares over the mean acceleration between speed samples, its
integral between the samples, and a spline of the difference through them. An error here is an input error,
which looks like a wrong structure, so it is settled before any effect is looked for.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.interpolate import CubicSpline

from service.identification.axis_fit import Fit
from service.identification.axis_problem import AxisProblem
from service.identification.axis_simulation import MotorMotion, simulate
from service.recording import FloatArray, Recording, Trace


def refined(problem: AxisProblem, fitted: Fit, recording: Recording) -> AxisProblem:
    """The problem with the motors' motion reconstructed between the samples by the present model's force."""
    motion, model = problem.motion, fitted.model
    K, W, A = motion.position.shape
    force = np.empty((K, 1, W, A))
    simulate(motion, model.values(model.z[None]), model.effects, fitted.offsets[None], force)
    position, speed = np.empty((K, W, A)), np.empty((K, W, A))
    for column, axis in enumerate(problem.axes):
        speed[:, :, column] = _speed(recording, axis, motion, force[:, 0, :, column])
    position = cumulative_trapezoid(speed, dx=motion.h, axis=0, initial=0.0)
    return replace(problem, motion=replace(motion, position=position, speed=speed))


def _speed(recording: Recording, axis: str, motion: MotorMotion, force: FloatArray) -> FloatArray:
    """Reconstructed speed (K, W) [m/s] of one motor."""
    trace = recording.traces[axis, "motor_speed"]
    measured = Trace(trace.time, trace.value * recording.axis(axis).transmission)
    torque = recording.trace(axis, "motor_torque")
    K, W = force.shape
    times = [start + motion.h * np.arange(K) for start in motion.start]
    drives = [_impulse(time, force[:, w], torque) for w, time in enumerate(times)]
    coefficients = _balance(measured, times, drives)
    speed = np.empty((K, W))
    for w, (time, drive) in enumerate(zip(times, drives, strict=True)):
        fast = drive @ coefficients
        part = measured.between(time[0], time[-1])
        left = CubicSpline(part.time, part.value - np.interp(part.time, time, fast))
        speed[:, w] = fast + left(np.clip(time, part.time[0], part.time[-1]))
    return speed


def _impulse(time: FloatArray, force: FloatArray, torque: Trace | None) -> FloatArray:
    """Integrals over time of the force and of the torque (n, 1 or 2)."""
    h = float(time[1] - time[0])
    columns = [cumulative_trapezoid(force, dx=h, initial=0.0)]
    if torque is not None:
        value = np.interp(time, torque.time, torque.value)
        columns.append(cumulative_trapezoid(value, dx=h, initial=0.0))
    return np.column_stack(columns)


def _balance(measured: Trace, windows: list[FloatArray], drives: list[FloatArray]) -> FloatArray:
    """Coefficients of force and torque; the second difference of the speed leaves only what is fast."""
    rows, right = [], []
    for time, drive in zip(windows, drives, strict=True):
        part = measured.between(time[0], time[-1])
        at = np.column_stack([np.interp(part.time, time, column) for column in drive.T])
        rows.append(np.diff(at, n=2, axis=0))
        right.append(np.diff(part.value, n=2))
    X, y = np.vstack(rows), np.concatenate(right)
    return np.asarray(np.linalg.lstsq(X, y, rcond=None)[0])
