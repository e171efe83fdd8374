"""Whether what was recorded can be what was commanded: sound samples, SI units, right signs, right sensor.

The commanded step is the yardstick: whatever the machine, the motor travels SL, and the load, flanks touching
for most of the move, gains and loses speed as the motor does. A factor that a wrong unit makes is named.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from service.backlash.commanded import GAIN, followed, longest, unit_of
from service.backlash.results import Reason, Refusal
from service.backlash.signals import StepSignals
from service.recording import Recording, Trace

CHANNELS = ("motor_speed", "acceleration")

SLOWEST = 450.0
"""Lowest sampling rate of either channel [Hz]: 500 Hz, less the tolerance of a sensor's own clock."""

MOST_LOST = 0.03
"""Largest share of lost samples. Chosen: at 1 % most of ten steps are whole, at 5 % hardly one is."""

CLIPPED = 4
"""Equal samples in a row at the end of the range. Chosen: with noise of one LSB, never by chance in a move."""

ALIKE = 0.8
"""Least correlation of load speed and motor speed. Chosen: drift and a swinging body leave 0.9."""

SILENT = 0.05
"""Load speed over motor speed that counts as none. Chosen: half of what a sensor in g would show."""

STALE = 0.2
"""Share of a move over which the load's acceleration may read one value. Chosen: a quiet load that rests in the gap
at the start, or coasts through it, does so for at most a tenth."""

ACCELERATION_UNITS = (
    (1.0 / 9.80665, "g instead of m/s²"),
    (1e3 / 9.80665, "thousandths of g instead of m/s²"),
    (1e3, "mm/s² instead of m/s²"),
)


def recorded(recording: Recording, axis: str) -> Refusal | None:
    """Refuse a recording without moves, or an axis without its two channels, finite, fast and nearly whole."""
    if not recording.moves:
        return Refusal(
            Reason.NO_MOVES, "The recording names no diagnostic moves; record a run of jerk-limited steps."
        )
    for channel in CHANNELS:
        trace = recording.trace(axis, channel)
        if trace is None or len(trace) < 3:
            there = ", ".join(sorted(c for a, c in recording.traces if a == axis)) or "none"
            return Refusal(
                Reason.CHANNEL_MISSING,
                f"{channel} of {axis} was not recorded (channels found: {there}); the method compares motor speed "
                "and load acceleration: check the wiring, the drive's mapping and the channel's name.",
            )
        refusal = _samples(trace, channel) or _range(trace, channel)
        if refusal:
            return refusal
    return None


def _samples(trace: Trace, channel: str) -> Refusal | None:
    if not (np.all(np.isfinite(trace.value)) and np.all(np.isfinite(trace.time))):
        return Refusal(
            Reason.NOT_FINITE, f"{channel} holds NaN or infinite samples; a decoder or an export is at fault."
        )
    rate = 1.0 / float(np.median(np.diff(trace.time)))
    if rate < SLOWEST:
        return Refusal(
            Reason.RATE_TOO_LOW,
            f"{channel} was sampled at {rate:.0f} Hz; a gap of 50 µm is passed in 11 ms, which takes 500 Hz at "
            "least: raise the rate of the mapping or of the sensor.",
        )
    lost = 1.0 - len(trace) / (1.0 + (trace.time[-1] - trace.time[0]) * rate)
    if lost > MOST_LOST:
        return Refusal(
            Reason.FRAME_LOSS,
            f"{lost:.1%} of the samples of {channel} are lost, hardly a pass is whole; the bus is overloaded or "
            "disturbed, or the receiver too slow: check bus load, termination and the socket's buffer.",
        )
    return None


def _range(trace: Trace, channel: str) -> Refusal | None:
    """Refuse a channel that says nothing, or is cut off at the end of its range."""
    low, high = float(np.min(trace.value)), float(np.max(trace.value))
    if low == high:
        return Refusal(
            Reason.SENSOR_FLAT if channel == "acceleration" else Reason.TRAJECTORY_NOT_FOLLOWED,
            f"{channel} reads {low:g} throughout; the sensor is blocked or its frames are filled with a constant, "
            "or the drive did not move: check supply and wiring, and the drive's enable.",
        )
    if channel == "acceleration" and clipped(trace):
        return Refusal(
            Reason.SENSOR_CLIPPED,
            f"{channel} stays at the end of its range ({low:.1f} to {high:.1f} m/s²); the impact exceeds the "
            "sensor's range: choose a larger range, or step with a smaller jerk.",
        )
    return None


def clipped(trace: Trace) -> bool:
    """Whether a sensor's samples stay at an end of its range."""
    ends = (np.min(trace.value), np.max(trace.value))
    return max(longest(trace.value == end) for end in ends) >= CLIPPED


def moved(recording: Recording, axis: str, steps: Sequence[StepSignals]) -> Refusal | None:
    """Refuse a run in which the motor did not make the commanded steps, or the load not the motor's motion."""
    if not steps:
        return None
    return followed(recording, axis, steps) or _stale(steps) or _load(steps)


def _stale(steps: Sequence[StepSignals]) -> Refusal | None:
    """Refuse an accelerometer that repeats one value while the axis moves."""
    for step in steps:
        time, value = step.acceleration.time, step.acceleration.value
        inside = (time > step.move.start) & (time < step.move.end)
        lasting = step.acceleration.period * longest(np.diff(value[inside]) == 0.0)
        if lasting > STALE * step.move.duration:
            return Refusal(
                Reason.SENSOR_FLAT,
                f"The accelerometer repeats one value for {lasting * 1e3:.0f} ms of move {step.index}; it sends a "
                "stale value or has stopped: check its supply and its self-test.",
            )
    return None


def _load(steps: Sequence[StepSignals]) -> Refusal | None:
    """The load's speed against the motor's: integrated, the blows at the impacts hardly count."""
    pairs = [(step.speed.value[m], step.v_mas[m]) for step in steps for m in [step.within(0.0, 1.0)]]
    size = float(np.median([np.sqrt(np.sum(load**2) / np.sum(motor**2)) for motor, load in pairs]))
    gain = float(np.median([np.sum(motor * load) / np.sum(motor**2) for motor, load in pairs]))
    alike = gain / size if size > 0.0 else 0.0
    if size < SILENT:
        return Refusal(
            Reason.SENSOR_FLAT,
            f"The accelerometer shows {size:.1%} of the motor's motion; it is blocked, not mounted on the load, or "
            "sends a stale value: check mounting, supply and its self-test.",
        )
    if abs(alike) < ALIKE:
        return Refusal(
            Reason.SIGNALS_DISAGREE,
            f"Load and motor speed agree by {alike:.2f} only; the accelerometer measures across the travel, belongs "
            "to another axis, or its clock is far off: check its mounting and assignment.",
        )
    if abs(gain - 1.0) < GAIN:
        return None
    if gain < 0.0 and abs(gain + 1.0) < GAIN:
        return Refusal(
            Reason.WRONG_SIGN,
            "The load accelerates against the motor; the accelerometer is mounted the other way round: turn it, or "
            "its sign in the configuration.",
        )
    unit = unit_of(abs(gain), ACCELERATION_UNITS)
    return Refusal(
        Reason.IMPLAUSIBLE_MAGNITUDE,
        f"The load accelerates {gain:.3g} times as the motor does"
        + (f": {unit}?" if unit else "; the sensor's scale is wrong: check its range setting and LSB."),
    )
