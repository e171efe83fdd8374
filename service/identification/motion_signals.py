"""Position, speed and acceleration of the driven side, from what was measured, as smooth functions of time.

Differentiation is by local polynomials (Savitzky and Golay 1964, Anal. Chem. 36), which have zero phase and,
unlike a filter run back and forth, stay exact up to the first and last sample.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.interpolate import CubicSpline, interp1d
from scipy.signal import butter, savgol_filter, sosfiltfilt

from service.recording import FloatArray, Recording, Trace

POLYNOMIAL = 4
"""Order of the local polynomial: the acceleration stays unbiased by the change of the jerk."""


@dataclass(frozen=True)
class Drive:
    """The driven side at chosen times, in output units: (n,) arrays; ``torque`` is referred to the output.

    ``speed_scale`` is the speed below which the direction of motion is not told, one hundredth of the
    largest speed: well above an encoder's noise, well below any speed at which a friction law is read.
    """

    time: FloatArray
    position: FloatArray
    speed: FloatArray
    acceleration: FloatArray
    torque: FloatArray | None
    speed_scale: float

    @property
    def direction(self) -> FloatArray:
        """Direction of motion, -1 to 1, zero at rest."""
        return np.tanh(self.speed / self.speed_scale)


@dataclass(frozen=True)
class DriveSignals:
    """Interpolants of the driven side's measured motion; ``at`` evaluates them."""

    start: float
    end: float
    position: interp1d
    speed: interp1d
    acceleration: interp1d
    torque: interp1d | None
    speed_scale: float

    def at(self, time: FloatArray) -> Drive:
        """The driven side at the given times (n,) [s], held at the recording's ends."""
        t = np.clip(time, self.start, self.end)
        torque = None if self.torque is None else self.torque(t)
        return Drive(time, self.position(t), self.speed(t), self.acceleration(t), torque, self.speed_scale)


def uniform(trace: Trace) -> Trace:
    """The trace on a uniform grid of its median sample distance; short holes are bridged by a cubic."""
    count = round(float(np.ptp(trace.time)) / float(np.median(np.diff(trace.time)))) + 1
    time = np.linspace(trace.time[0], trace.time[-1], count)
    return Trace(time, CubicSpline(trace.time, trace.value)(time))


def derivative(values: FloatArray, step: float, order: int, cutoff: float) -> FloatArray:
    """Derivative of the given order of uniform samples (n,), low-pass at ``cutoff`` [Hz], zero phase.

    Half-width of the polynomial's window after Schafer 2011 (IEEE Signal Processing Magazine 28):
    f_c = (N + 1) / (3.2 M - 4.6) of the Nyquist frequency.
    """
    half = max(POLYNOMIAL, round(((POLYNOMIAL + 1) * 0.5 / step / cutoff + 4.6) / 3.2))
    half = min(half, (len(values) - 1) // 2)
    filtered = savgol_filter(values, 2 * half + 1, POLYNOMIAL, deriv=order, delta=step, mode="interp")
    return np.asarray(filtered, dtype=np.float64)


def drive_signals(recording: Recording, axis: str, cutoff: float, with_torque: bool) -> DriveSignals | None:
    """The driven side's motion from motor position, or from motor speed where no position was recorded."""
    description = recording.axis(axis)
    source = recording.trace(axis, "motor_position") or recording.trace(axis, "motor_speed")
    if source is None:
        return None
    even = uniform(source)
    step = even.time[1] - even.time[0]
    values = even.value * description.transmission
    if recording.trace(axis, "motor_position") is None:
        values = cumulative_trapezoid(values, even.time, initial=0.0)
    position, speed, acceleration = (derivative(values, step, order, cutoff) for order in range(3))
    torque = recording.trace(axis, "motor_torque") if with_torque else None
    output = None if torque is None else CubicSpline(torque.time, torque.value / description.transmission)
    return DriveSignals(
        start=float(even.time[0]),
        end=float(even.time[-1]),
        position=CubicSpline(even.time, position),
        speed=CubicSpline(even.time, speed),
        acceleration=CubicSpline(even.time, acceleration),
        torque=output,
        speed_scale=0.01 * float(np.abs(speed).max()),
    )


def low_pass(values: FloatArray, step: float, cutoff: float) -> FloatArray:
    """Zero-phase Butterworth low-pass of order four along the first axis; ``values`` are (n,) or (n, k)."""
    sos = butter(4, cutoff * 2.0 * step, output="sos")
    return np.asarray(sosfiltfilt(sos, values, axis=0), dtype=np.float64)


def standstill(drive: Drive) -> FloatArray:
    """Mask (n,) of the samples before the first motion, 1.0 or 0.0; all zero when it starts moving at once."""
    moving = np.abs(drive.speed) > drive.speed_scale
    first = int(np.argmax(moving)) if moving.any() else len(moving)
    mask = np.zeros(len(moving))
    mask[:first] = 1.0
    return mask
