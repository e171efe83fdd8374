"""Whether what was recorded can be what was commanded: sound samples, SI units, right signs, right sensor.

The commanded step is the yardstick: whatever the machine, the motor travels SL, and the load, flanks touching
for most of the move, accelerates as the motor does. A factor between them that a wrong unit would cause is named.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from service.backlash.results import Reason
from service.backlash.signals import AFTER, StepSignals, running_integral
from service.recording import Move, Recording, Trace

CHANNELS = ("motor_speed", "acceleration")

SLOWEST_RATE = 450.0
"""Lowest sampling rate of either channel [Hz]: 500 Hz, less the tolerance of a sensor's own clock."""

MOST_LOST = 0.03
"""Largest share of lost samples. Chosen between the 1 % at which most passes of ten steps are whole and the 5 % at
which hardly one is."""

TRAVEL_TOLERANCE = 0.1
"""Of the motor's travel over SL. Chosen: a controller's lag ends with the step; a wrong unit is a factor of 5."""

GAIN_TOLERANCE = 0.25
"""Of the load's acceleration over the motor's. Chosen: wider than any sensor's scale error, and than what the load's
own swinging adds; far below the factor of a wrong unit."""

LOWEST_CORRELATION = 0.8
"""Of the load's acceleration with the motor's over a move. Chosen, see test_plausibility."""

SPEED_UNITS = (
    (30.0 / np.pi, "rpm instead of rad/s"),
    (0.5 / np.pi, "revolutions per second instead of rad/s"),
    (180.0 / np.pi, "degrees per second instead of rad/s"),
)
ACCELERATION_UNITS = (
    (1.0 / 9.80665, "g instead of m/s²"),
    (1000.0 / 9.80665, "mg instead of m/s²"),
    (1000.0, "mm/s² instead of m/s²"),
)


class Refusal(NamedTuple):
    """Why no value is given: the reason, and in a sentence what was seen, the likely cause, what to do."""

    reason: Reason
    detail: str


def recorded(recording: Recording, axis: str) -> Refusal | None:
    """Refuse a recording without moves, or an axis whose two channels are not there, finite and fast enough."""
    if not recording.moves:
        return Refusal(
            Reason.NO_MOVES, "The recording names no diagnostic moves; record a run of jerk-limited steps."
        )
    for channel in CHANNELS:
        trace = recording.trace(axis, channel)
        if trace is None or len(trace) < 3:
            there = ", ".join(sorted(c for a, c in recording.traces if a == axis)) or "no channel"
            return Refusal(
                Reason.CHANNEL_MISSING,
                f"{channel} of {axis} was not recorded (found: {there}); the method compares motor speed and load "
                "acceleration: check the sensor's wiring, the drive's mapping and the channel's name.",
            )
        found = _unsound(trace, channel)
        if found:
            return found
    return None


def _unsound(trace: Trace, channel: str) -> Refusal | None:
    if not (np.all(np.isfinite(trace.value)) and np.all(np.isfinite(trace.time))):
        return Refusal(
            Reason.NOT_FINITE,
            f"{channel} holds NaN or infinite samples; a decoder or an export is at fault: mend it.",
        )
    steps = np.diff(trace.time)
    rate = 1.0 / float(np.median(steps))
    if rate < SLOWEST_RATE:
        return Refusal(
            Reason.RATE_TOO_LOW,
            f"{channel} was sampled at {rate:.0f} Hz; a gap of 50 µm is passed in 11 ms, which needs 500 Hz at least: "
            "raise the rate of the mapping or the sensor.",
        )
    lost = 1.0 - len(trace) / (1.0 + (trace.time[-1] - trace.time[0]) * rate)
    if lost > MOST_LOST:
        return Refusal(
            Reason.FRAME_LOSS,
            f"{lost:.1%} of the samples of {channel} are lost, so hardly a pass is whole; the bus is overloaded or "
            "disturbed, or the receiver's buffer too small: check bus load, termination and SO_RCVBUF.",
        )
    return None
