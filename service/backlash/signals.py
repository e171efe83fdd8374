"""From the recorded channels to the signals of section III: motor and load acceleration of one step.

Both are seen along the direction of travel, at the output: forward is positive whichever way the step
goes, and the motor's speed stands multiplied by D_p/(2i).

The two channels have different rates and clocks. Nothing is resampled blindly: samples are placed by their
counter (`even`), and the comparison of eqs. (11) and (12) is made at the motor's own instants. There the
load's acceleration goes the same way as the motor's: integrated to a speed, then derived by the same
Savitzky-Golay filter. So both are averaged over the same time, the impact is delayed in neither, and what the
filter does to a smooth motion cancels in their difference.

Symbols
-------
a_mot, a_mas : ẍ̄_mot = D_p/(2i)·ẍ_mot and ẍ_mas, forward [m/s²]
v_mot, v_mas : their speeds, forward [m/s]
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, lfilter, savgol_coeffs, sosfiltfilt

from service.recording import FloatArray, Move, Recording, Trace

BoolArray = NDArray[np.bool_]

MARGIN = 0.08
"""Rest that is cut with a move, before it and after [s]. Chosen: shorter than a sensible pause, and several
periods of the low-pass, so that its ends do not reach into the move."""

SETTLING = 0.1
"""Time after a move that does not count as standstill [s]. Chosen: ten periods of a soft axis, 100 Hz."""

FEWEST_SAMPLES = 40
"""Fewest samples of one channel in a step, margins included: a tenth of what 500 Hz gives the paper's step."""

POLYNOMIAL_ORDER = 2
"""Of the Savitzky-Golay filter: the lowest that follows a ramp of the acceleration without delay."""

WIDEST = 9
"""Widest Savitzky-Golay window [samples]: at 1 kHz the pass of a gap of 15 µm lasts no longer. Chosen."""

LOUDEST = 0.05
"""Largest noise of the motor acceleration, as a share of the step's largest. Chosen: an impact kicks the motor
by about half of the largest acceleration, a tenth of that must be left for the noise."""

LOW_PASS_ORDER = 10
"""Of the Butterworth filter before the integration: section V."""

LOW_PASS_SHARE = 0.8
"""Corner of the low-pass over the Nyquist frequency of the slower channel: as much as it carries, less the
slope of the filter. Both channels get the same corner, so that their difference holds no one-sided ringing."""


@dataclass(frozen=True)
class Even:
    """Samples of one channel on an even grid: sample n was taken at start + n·period.

    Attributes
    ----------
    start, period : [s], by regression of the time stamps on the sample counter
    value : (n,) [channel's unit], straight lines over lost samples
    lost : (n,) bool, True where no sample arrived
    """

    start: float
    period: float
    value: FloatArray
    lost: BoolArray

    @property
    def time(self) -> FloatArray:
        """(n,) [s]."""
        return self.start + self.period * np.arange(len(self.value), dtype=np.float64)

    @property
    def integral(self) -> FloatArray:
        """∫ value dt (n,), zero at the first sample."""
        return running_integral(self.value, self.period)

    def lost_between(self, start: float, end: float) -> int:
        """Number of lost samples with start <= time <= end [s]."""
        time = self.time
        return int(np.count_nonzero(self.lost & (time >= start) & (time <= end)))


@dataclass(frozen=True)
class AxisSignals:
    """The two channels of a whole run, positive travel positive.

    Attributes
    ----------
    speed : v̄_mot at the output [m/s]
    load : ẍ_mas [m/s²], zero at standstill
    noise : standard deviation of one sample of the speed [m/s]
    """

    speed: Trace
    load: Trace
    noise: float


@dataclass(frozen=True)
class StepSignals:
    """One step of one axis, forward positive, at the motor's sampling instants.

    Attributes
    ----------
    index, move : which step
    time : (n,) [s] recording's clock
    a_mot, a_mas : (n,) [m/s²], both through the same Savitzky-Golay filter
    speed, acceleration : v_mot and ẍ_mas on their own grids [m/s], [m/s²]
    """

    index: int
    move: Move
    time: FloatArray
    a_mot: FloatArray
    a_mas: FloatArray
    speed: Even
    acceleration: Even

    @property
    def difference(self) -> FloatArray:
        """ẍ̄_mot − ẍ_mas (n,) [m/s²], left side of eqs. (11) and (12)."""
        return self.a_mot - self.a_mas

    @property
    def load_speed(self) -> FloatArray:
        """Speed of the load at the accelerometer's instants [m/s], zero on the mean before the move."""
        v = self.acceleration.integral
        return v - float(np.mean(v[self.acceleration.time < self.move.start]))

    @property
    def v_mas(self) -> FloatArray:
        """Speed of the load at the motor's instants (n,) [m/s]."""
        return np.interp(self.time, self.acceleration.time, self.load_speed)

    def within(self, first: float, last: float) -> BoolArray:
        """Samples between two shares of the move's duration, (n,) bool."""
        start, duration = self.move.start, self.move.duration
        return np.asarray((self.time > start + first * duration) & (self.time < start + last * duration))


def even(trace: Trace) -> Even:
    """Place the samples of a trace, at least 3, by their counter: time stamps regressed on it."""
    steps = np.diff(trace.time)
    ticks = np.maximum(1.0, np.round(steps / np.median(steps)))
    counter = np.concatenate(([0.0], np.cumsum(ticks)))
    first = float(trace.time[0])
    period, start = np.polyfit(counter, trace.time - first, 1)
    grid = np.arange(counter[-1] + 1.0)
    lost = np.ones(len(grid), bool)
    lost[counter.astype(int)] = False
    return Even(first + float(start), float(period), np.interp(grid, counter, trace.value), lost)


def standstill(trace: Trace, moves: tuple[Move, ...]) -> BoolArray:
    """Which samples of a trace (n,) were taken while nothing was commanded and all had settled."""
    still = np.ones(len(trace), bool)
    for move in moves:
        still &= (trace.time < move.start) | (trace.time > move.end + SETTLING)
    return still


def bias(trace: Trace, moves: tuple[Move, ...]) -> float:
    """What the accelerometer reads at standstill [m/s²]: zero error and tilt; median over the whole run."""
    still = trace.value[standstill(trace, moves)]
    return float(np.median(still)) if len(still) else 0.0


def speed_noise(speed: Trace, moves: tuple[Move, ...]) -> float:
    """Noise of one sample of the motor's speed [rad/s]: seen at standstill, or of its rounding.

    A motor at rest may read exactly zero; then only the noise of the rounding is known, LSB/√12.
    """
    levels = np.diff(np.unique(speed.value))
    rounding = float(np.min(levels)) / np.sqrt(12.0) if len(levels) else 0.0
    still = np.diff(speed.value[standstill(speed, moves)])
    seen = 1.4826 * float(np.median(np.abs(still))) / np.sqrt(2.0) if len(still) else 0.0
    return max(rounding, seen)


def window_width(noise: float, period: float, a_max: float) -> int:
    """Samples of the shortest Savitzky-Golay window quiet enough for a speed of that noise [m/s].

    The derivative's noise is noise/(period·√Σk²), k = −(w−1)/2 … (w−1)/2. Short is better: the window smears
    the impact, and an error of t2 is of first order in b.
    """
    for width in range(3, WIDEST, 2):
        k = np.arange(width) - width // 2
        if noise / (period * np.sqrt(np.sum(k**2))) <= LOUDEST * a_max:
            return width
    return WIDEST


def derivative(value: FloatArray, period: float, width: int) -> FloatArray:
    """Savitzky-Golay derivative (n,); the first and last half window repeat their neighbour."""
    kernel = savgol_coeffs(width, POLYNOMIAL_ORDER, deriv=1, delta=period)
    return np.pad(np.convolve(value, kernel, "valid"), width // 2, mode="edge")


def for_integration(step: StepSignals) -> StepSignals:
    """The step with its speed and acceleration low-passed alike, as section V asks before the integration."""
    corner = LOW_PASS_SHARE * 0.5 / max(step.speed.period, step.acceleration.period)
    return replace(
        step, speed=_low_passed(step.speed, corner), acceleration=_low_passed(step.acceleration, corner)
    )


def _low_passed(samples: Even, corner: float) -> Even:
    """Butterworth low-pass of order 10, second-order sections, run forth and back: no phase; corner [Hz]."""
    sections = butter(LOW_PASS_ORDER, corner, fs=1.0 / samples.period, output="sos")
    return replace(samples, value=np.asarray(sosfiltfilt(sections, samples.value)))


def running_integral(value: FloatArray, period: float) -> FloatArray:
    """∫ value dt (n,) by trapezoids, zero at the first sample."""
    steps = 0.5 * period * (value[1:] + value[:-1])
    return np.concatenate((np.zeros(1), np.cumsum(steps)))


def summed(r: FloatArray, kept: float) -> FloatArray:
    """Residuals (…, K) summed up, of which `kept` is left after each; white ones of 1 stay 1."""
    return np.asarray(lfilter([np.sqrt(1.0 - kept**2)], [1.0, -kept], r, axis=-1))


def axis_signals(recording: Recording, axis: str) -> AxisSignals | None:
    """The two channels of one axis, referred to the output; None when one of them was not recorded."""
    transmission = recording.axis(axis).transmission
    speed, load = recording.trace(axis, "motor_speed"), recording.trace(axis, "acceleration")
    if speed is None or load is None:
        return None
    return AxisSignals(
        speed=Trace(speed.time, transmission * speed.value),
        load=Trace(load.time, load.value - bias(load, recording.moves)),
        noise=transmission * speed_noise(speed, recording.moves),
    )


def step_signals(signals: AxisSignals, index: int, move: Move, skew: float = 0.0) -> StepSignals | None:
    """Cut and prepare one step; None when its samples do not reach over the whole move.

    Parameters
    ----------
    skew : time by which the accelerometer's stamps are late against the drive's [s]
    """
    motor, mass = _cut(signals.speed, move, 0.0), _cut(signals.load, move, skew)
    if motor is None or mass is None:
        return None
    motor = replace(motor, value=move.direction * motor.value)
    mass = replace(mass, value=move.direction * mass.value)
    a_mot, a_mas = compared(motor, mass, move.jerk * move.duration / 4.0, signals.noise)
    return StepSignals(index, move, motor.time, a_mot, a_mas, motor, mass)


def _cut(trace: Trace, move: Move, late: float) -> Even | None:
    """The samples around a move, their stamps set back by `late` [s]; None when they do not reach over it."""
    part = trace.between(move.start - MARGIN + late, move.end + MARGIN + late)
    if len(part) < FEWEST_SAMPLES or part.time[0] > move.start + late or part.time[-1] < move.end + late:
        return None
    placed = even(part)
    return replace(placed, start=placed.start - late)


def compared(motor: Even, mass: Even, a_max: float, noise: float) -> tuple[FloatArray, FloatArray]:
    """Acceleration of motor and load at the motor's instants, (n,) each [m/s²]; a_max is the largest of the motion,
    noise that of the speed [m/s]."""
    v_mas = np.interp(motor.time, mass.time, mass.integral)
    width = window_width(noise, motor.period, a_max)
    return derivative(motor.value, motor.period, width), derivative(v_mas, motor.period, width)
