"""From the recorded channels to the signals of section III: motor and load acceleration of one step.

Both are seen along the direction of travel, at the output: forward is positive whichever way the step goes,
and the motor's speed stands multiplied by D_p/(2i).

The two channels have different rates and clocks. Nothing is resampled blindly: samples are placed by their
counter (`even`), and the comparison of eqs. (11) and (12) is made at the motor's own instants. There the
load's acceleration goes the same way as the motor's: integrated to a speed, then derived by the same
Savitzky-Golay filter. So both are averaged over the same time, the sharp impact is delayed in neither, and the
filter's width cancels in their difference to first order.

Symbols
-------
a_mot, a_mas : ẍ̄_mot = D_p/(2i)·ẍ_mot and ẍ_mas, forward [m/s²]
v_mot, v_mas : their speeds, forward [m/s]
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, savgol_coeffs, sosfiltfilt

from service.recording import FloatArray, Move, Recording, Trace

BoolArray = NDArray[np.bool_]

BEFORE, AFTER = 0.08, 0.08
"""Rest that is cut with a move, before and after it [s]. Chosen: shorter than any sensible pause, and several
periods of the low-pass, so that its ends do not reach into the move."""

SETTLING = 0.1
"""Time after a move that does not count as standstill [s]. Chosen: ten periods of a soft axis, 100 Hz."""

POLYNOMIAL_ORDER = 2
"""Of the Savitzky-Golay filter: the lowest that follows a ramp of the acceleration without delay."""

WIDEST = 9
"""Widest Savitzky-Golay window [samples]. Chosen: at 1 kHz already the pass of a gap of 15 µm."""

SLOWEST_NOISE = 0.05
"""Largest noise of the motor acceleration, as a share of the step's largest acceleration. Chosen: a tenth of
the smallest motor kick at an impact, which is about half the largest acceleration."""

LOW_PASS_ORDER = 10
"""Of the Butterworth filter before the integration: section V."""

LOW_PASS_SHARE = 0.8
"""Corner of the low-pass over the motor speed's Nyquist frequency: what the slower channel can carry at all,
less the filter's own slope."""


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
        return self.start + self.period * np.arange(len(self.value))

    def lost_between(self, start: float, end: float) -> int:
        """Number of lost samples with start <= time <= end [s]."""
        time = self.time
        return int(np.count_nonzero(self.lost & (time >= start) & (time <= end)))


@dataclass(frozen=True)
class StepSignals:
    """One step of one axis, forward positive, at the motor's sampling instants.

    Attributes
    ----------
    index, move : which step
    time : (n,) [s] recording's clock
    a_mot, a_mas : (n,) [m/s²], both through the same Savitzky-Golay filter
    speed, acceleration : the two channels low-passed for the integration, on their own grids [m/s], [m/s²]
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


def even(trace: Trace) -> Even:
    """Place the samples of a trace by their counter: time stamps regressed on it (at least 3 samples)."""
    period = float(np.median(np.diff(trace.time)))
    counter = np.concatenate(([0], np.cumsum(np.maximum(1, np.round(np.diff(trace.time) / period))))).astype(
        int
    )
    rate = np.polynomial.Polynomial.fit(counter, trace.time, 1).convert().coef
    grid = np.arange(counter[-1] + 1)
    lost = np.ones(len(grid), bool)
    lost[counter] = False
    return Even(float(rate[0]), float(rate[1]), np.interp(grid, counter, trace.value), lost)


def at_standstill(trace: Trace, moves: tuple[Move, ...]) -> BoolArray:
    """Which samples of a trace (n,) were taken while nothing was commanded and all had settled."""
    still = np.ones(len(trace), bool)
    for move in moves:
        still &= (trace.time < move.start) | (trace.time > move.end + SETTLING)
    return still


def bias(trace: Trace, moves: tuple[Move, ...]) -> float:
    """What the accelerometer reads at standstill [m/s²]: zero error and tilt; median over the whole run."""
    still = trace.value[at_standstill(trace, moves)]
    return float(np.median(still)) if len(still) else 0.0


def window_width(noise: float, period: float, a_max: float) -> int:
    """Samples of the shortest Savitzky-Golay window quiet enough for a motor speed of that noise [m/s].

    The derivative's noise is noise/(period·√Σk²) with k = −(w−1)/2 … (w−1)/2. Short is better: the window
    smears the impact, and t2 is of first order in b.
    """
    for width in range(3, WIDEST, 2):
        k = np.arange(width) - width // 2
        if noise / (period * np.sqrt(np.sum(k**2))) <= SLOWEST_NOISE * a_max:
            return width
    return WIDEST


def derivative(value: FloatArray, period: float, width: int) -> FloatArray:
    """Savitzky-Golay derivative (n,), the first and last half window held."""
    kernel = savgol_coeffs(width, POLYNOMIAL_ORDER, deriv=1, delta=period)
    inside = np.convolve(value, kernel, "valid")
    return np.pad(inside, width // 2, mode="edge")


def low_passed(samples: Even, corner: float) -> Even:
    """Butterworth low-pass of order 10, second-order sections, run forth and back: no phase, corner [Hz]."""
    sections = butter(LOW_PASS_ORDER, corner, fs=1.0 / samples.period, output="sos")
    return Even(samples.start, samples.period, sosfiltfilt(sections, samples.value), samples.lost)


def running_integral(value: FloatArray, period: float) -> FloatArray:
    """∫ value dt (n,) by trapezoids, zero at the first sample."""
    return np.concatenate(([0.0], np.cumsum(0.5 * period * (value[1:] + value[:-1]))))


def speed_noise(speed: Trace, moves: tuple[Move, ...], transmission: float) -> float:
    """Noise of one sample of the motor's speed at the output [m/s]: at standstill, and of its rounding.

    A motor at rest may read exactly zero, so that only the step of the rounding, LSB/√12, remains.
    """
    steps = np.diff(np.unique(speed.value))
    rounding = float(np.min(steps)) / np.sqrt(12.0) if len(steps) else 0.0
    still = speed.value[at_standstill(speed, moves)]
    seen = 1.4826 * float(np.median(np.abs(np.diff(still)))) / np.sqrt(2.0) if len(still) > 1 else 0.0
    return transmission * max(rounding, seen)


def step_signals(recording: Recording, axis: str, index: int, skew: float = 0.0) -> StepSignals | None:
    """Cut and prepare one step; None when its samples do not reach over the whole move.

    Parameters
    ----------
    skew : time by which the accelerometer's stamps are late against the drive's [s]
    """
    move, description = recording.moves[index], recording.axis(axis)
    speed, load = recording.trace(axis, "motor_speed"), recording.trace(axis, "acceleration")
    if speed is None or load is None:
        return None
    start, end = move.start - BEFORE, move.end + AFTER
    speed_cut, load_cut = speed.between(start, end), load.between(start + skew, end + skew)
    if not (_reaches(speed_cut, move, 0.0) and _reaches(load_cut, move, skew)):
        return None
    motor, mass = even(speed_cut), even(load_cut)
    forward = move.direction * description.transmission
    motor = Even(motor.start, motor.period, forward * motor.value, motor.lost)
    zero = bias(load, recording.moves)
    mass = Even(mass.start - skew, mass.period, move.direction * (mass.value - zero), mass.lost)
    noise = speed_noise(speed, recording.moves, description.transmission)
    return _compared(index, move, motor, mass, noise)


def _reaches(trace: Trace, move: Move, shift: float) -> bool:
    few = 20
    return len(trace) >= few and trace.time[0] < move.start + shift and trace.time[-1] > move.end + shift


def _compared(index: int, move: Move, motor: Even, mass: Even, noise: float) -> StepSignals:
    """Both accelerations at the motor's instants, and both channels low-passed alike."""
    time = motor.time
    v_mas = np.interp(time, mass.time, running_integral(mass.value, mass.period))
    width = window_width(noise, motor.period, float(np.max(np.abs(mass.value))))
    corner = LOW_PASS_SHARE * 0.5 / max(motor.period, mass.period)
    return StepSignals(
        index=index,
        move=move,
        time=time,
        a_mot=derivative(motor.value, motor.period, width),
        a_mas=derivative(v_mas, motor.period, width),
        speed=low_passed(motor, corner),
        acceleration=low_passed(mass, corner),
    )
