"""Effects of the measurement on the driven model: clocks, scales and zeros of the channels."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from scipy.signal import cont2discrete, lfilter, lfilter_zi

from service.dynamics.driven_effect import Case, DrivenEffect
from service.dynamics.driven_parameters import Parameter, Values
from service.recording import FloatArray

LATE = {"latency": 1.0, "filter_delay": 1.0, "filter_time": -1.0}
"""What makes the accelerometer late against the drive's speed, by number; of slow motion a filter is a delay."""


def lateness(values: Mapping[str, float], axes: Sequence[str]) -> dict[str, float]:
    """That time [s] by axis, of all effects in `values`; none of an axis without them."""
    return {
        axis: sum(share * values.get(f"{axis}.{name}", 0.0) for name, share in LATE.items())
        for axis in axes
        if any(f"{axis}.{name}" in values for name in LATE)
    }


@dataclass(frozen=True)
class DrivenLatency(DrivenEffect):
    """The accelerometer's samples are stamped too late: the declared model's skew, which is held at zero, released."""

    name: ClassVar[str] = "sensor_latency"
    means: ClassVar[str] = "the accelerometer's samples are late against the drive's"
    exact: ClassVar[bool] = True
    own: ClassVar[tuple[Parameter, ...]] = (
        Parameter("latency", "s", 0.0, 1e-3, logarithmic=False, low=-8e-3, high=8e-3, dose=1e-4),
    )
    nearly: ClassVar[tuple[str, ...]] = ("sensor_filter", "speed_filter")

    def instead(self, values: Mapping[str, float]) -> Mapping[str, float]:
        return {f"{axis}.latency": late for axis, late in lateness(values, self.axes).items()}

    def restate(self, values: Values) -> Values:
        return {**values, **{f"{a}.skew": -values[f"{a}.latency"] for a in self.axes}}


@dataclass(frozen=True)
class DrivenGain(DrivenEffect):
    """A wrong scale, or a sensor mounted askew."""

    name: ClassVar[str] = "sensor_gain"
    means: ClassVar[str] = "the accelerometer's scale is wrong, or it is mounted askew"
    exact: ClassVar[bool] = True
    own: ClassVar[tuple[Parameter, ...]] = (
        Parameter("gain_error", "1", 0.0, 0.2, logarithmic=False, low=-0.6, high=0.6, dose=0.02),
    )

    def measure(self, predicted: FloatArray, case: Case) -> FloatArray:
        out = predicted.copy()
        for _, axis, x in self.each(case.model):
            out[:, :, x] *= 1.0 + case.values[f"{axis}.gain_error"][:, None, None]
        return out


@dataclass(frozen=True)
class DrivenBias(DrivenEffect):
    """A zero that drifts with time or temperature; a constant one is taken off at rest before any fit.

    What a straight drift does not follow, a warm-up, is a zero found again in every step.
    """

    name: ClassVar[str] = "sensor_bias"
    means: ClassVar[str] = "the accelerometer's zero wanders: it warms up or drifts"
    own: ClassVar[tuple[Parameter, ...]] = (
        Parameter("bias_drift", "m/s³", 0.0, 0.2, logarithmic=False, dose=0.01),
    )
    own_nuisance: ClassVar[tuple[Parameter, ...]] = (
        Parameter("zero", "m/s²", 0.0, 0.3, logarithmic=False, found_again=True),
    )

    def measure(self, predicted: FloatArray, case: Case) -> FloatArray:
        out = predicted.copy()
        time = case.start[:, None] + case.h * (np.arange(out.shape[-1]) + 0.5)
        for k, axis, x in self.each(case.model):
            drift = case.values[f"{axis}.bias_drift"][:, None, None] * time
            out[:, :, x] += drift + case.nuisance[:, :, k, None]
        return out


@dataclass(frozen=True)
class DrivenSensorFilter(DrivenEffect):
    """The accelerometer's own low-pass of second order, 1 / (1 + T s + (T s / 2 ζ)²): slow motion is late by T, quick
    motion is smaller besides. Overdamped, it is one of first order."""

    name: ClassVar[str] = "sensor_filter"
    means: ClassVar[str] = "the accelerometer's own low-pass is slow"
    own: ClassVar[tuple[Parameter, ...]] = (
        Parameter("filter_delay", "s", 0.0, 1e-3, logarithmic=False, low=0.0, high=1e-2, dose=1e-4),
        Parameter("filter_damping", "1", 0.7, 0.7, low=0.2, high=10.0),
    )
    nearly: ClassVar[tuple[str, ...]] = ("sensor_latency", "speed_filter")

    def instead(self, values: Mapping[str, float]) -> Mapping[str, float]:
        return {f"{axis}.filter_delay": max(0.0, late) for axis, late in lateness(values, self.axes).items()}

    def measure(self, predicted: FloatArray, case: Case) -> FloatArray:
        out = predicted.copy()
        for _, axis, x in self.each(case.model):
            delay, damping = (case.values[f"{axis}.{p.name}"] for p in self.own)
            for one in np.unique(np.stack((delay, damping), axis=1), axis=0):
                sets = (delay == one[0]) & (damping == one[1])
                out[sets, :, x] = low_passed(out[sets, :, x], one[0] / case.h, one[1])
        return out


def low_passed(course: FloatArray, delay: float, damping: float) -> FloatArray:
    """Courses (S, T, K) behind a low-pass of second order that delays slow motion by `delay` samples: straight from
    sample to sample, and before the first as there."""
    if not delay:
        return course
    squared = (delay / (2.0 * damping)) ** 2
    b, a, _ = cont2discrete(([1.0], [squared, delay, 1.0]), 1.0, "foh")
    begun = course[..., :1] * lfilter_zi(b[0], a)
    return np.asarray(lfilter(b[0], a, course, zi=begun)[0])


@dataclass(frozen=True)
class DrivenSpeedFilter(DrivenEffect):
    """The drive reports a speed behind a first-order filter; the true motion is the inversely filtered one."""

    name: ClassVar[str] = "speed_filter"
    means: ClassVar[str] = "the drive filters its speed value before it sends it"
    own: ClassVar[tuple[Parameter, ...]] = (
        Parameter("filter_time", "s", 0.0, 1e-3, logarithmic=False, low=0.0, high=1e-2, dose=1e-4),
    )
    own_errors: ClassVar[bool] = True
    nearly: ClassVar[tuple[str, ...]] = ("sensor_latency", "sensor_filter")

    def instead(self, values: Mapping[str, float]) -> Mapping[str, float]:
        return {f"{axis}.filter_time": max(0.0, -late) for axis, late in lateness(values, self.axes).items()}

    def drive(self, c: FloatArray, case: Case) -> FloatArray:
        out = c.copy()
        for _, axis, x in self.each(case.model):
            tau = case.values[f"{axis}.filter_time"][:, None, None, None]
            out[:, :, :, x, :-1] += tau * c[:, :, :, x, 1:]
        return out

    def lag(self, values: Mapping[str, float], axis: str) -> float:
        return values[f"{axis}.filter_time"]
