"""Whether what was recorded can be what was commanded: sound samples, SI units, right signs, right sensor.

The commanded step is the yardstick: whatever the machine, the motor travels SL, and the load, flanks touching
for most of the move, gains and loses speed as the motor does. A factor that a wrong unit makes is named.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from service.backlash.results import Reason, Refusal
from service.backlash.signals import BoolArray, StepSignals
from service.recording import Move, Recording, Trace

CHANNELS = ("motor_speed", "acceleration")

SLOWEST = 450.0
"""Lowest sampling rate of either channel [Hz]: 500 Hz, less the tolerance of a sensor's own clock."""

MOST_LOST = 0.03
"""Largest share of lost samples. Chosen: at 1 % most of ten steps are whole, at 5 % hardly one is."""

CLIPPED = 4
"""Equal samples in a row at the end of the range. Chosen: with noise of one LSB, never by chance in a move."""

TRAVEL = 0.1
"""Tolerance of the motor's travel over SL. Chosen: the lag of a controller ends with the step."""

PEAK = 0.1
"""Tolerance of the motor's largest speed over 2·SL/duration, what a step without a constant speed reaches."""

GAIN = 0.2
"""Tolerance of the load's speed over the motor's. Chosen: more than the scale error of any sensor."""

ALIKE = 0.8
"""Least correlation of load speed and motor speed. Chosen: drift and a swinging body leave 0.9."""

SILENT = 0.05
"""Load speed over motor speed that counts as none. Chosen: half of what a sensor in g would show."""

RISING = 0.75
"""Least mean acceleration around its largest, over the nominal largest. Jerk-limited it is 0.9, constant 0.5."""

PURE = 0.03
"""Tolerance of a move's duration over that of a step that no other limit shapes: drives round it to a cycle."""

STALE = 0.2
"""Share of a move over which the load's acceleration may read one value. Chosen: a quiet load that rests in the gap
at the start, or coasts through it, does so for at most a tenth."""

SPEED_UNITS = (
    (30.0 / np.pi, "rpm instead of rad/s"),
    (0.5 / np.pi, "revolutions per second instead of rad/s"),
    (180.0 / np.pi, "degrees per second instead of rad/s"),
    (1e-3, "the length of the move in millimetres, or the speed a thousandth"),
    (1e3, "the transmission in millimetres per radian"),
)
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
    if (
        channel == "acceleration"
        and max(_longest(trace.value == low), _longest(trace.value == high)) >= CLIPPED
    ):
        return Refusal(
            Reason.SENSOR_CLIPPED,
            f"{channel} stays at the end of its range ({low:.1f} to {high:.1f} m/s²); the impact exceeds the "
            "sensor's range: choose a larger range, or step with a smaller jerk.",
        )
    return None


def _longest(flags: BoolArray) -> int:
    """Length of the longest run of True."""
    ends = np.flatnonzero(np.diff(np.concatenate(([0], flags.astype(int), [0]))))
    return int(np.max(ends[1::2] - ends[::2], initial=0))


def moved(steps: Sequence[StepSignals]) -> Refusal | None:
    """Refuse a run in which the motor did not make the commanded steps, or the load not the motor's motion."""
    return (_motor(steps) or _profile(steps) or _stale(steps) or _load(steps)) if steps else None


def _stale(steps: Sequence[StepSignals]) -> Refusal | None:
    """Refuse an accelerometer that repeats one value while the axis moves."""
    for step in steps:
        time, value = step.acceleration.time, step.acceleration.value
        inside = (time > step.move.start) & (time < step.move.end)
        lasting = step.acceleration.period * _longest(np.diff(value[inside]) == 0.0)
        if lasting > STALE * step.move.duration:
            return Refusal(
                Reason.SENSOR_FLAT,
                f"The accelerometer repeats one value for {lasting * 1e3:.0f} ms of move {step.index}; it sends a "
                "stale value or has stopped: check its supply and its self-test.",
            )
    return None


def _motor(steps: Sequence[StepSignals]) -> Refusal | None:
    travel = float(np.median([s.speed.integral[-1] / s.move.length for s in steps]))
    peak = float(np.median([np.max(s.speed.value) * s.move.duration / (2 * s.move.length) for s in steps]))
    if abs(travel + 1.0) < TRAVEL:
        return Refusal(
            Reason.WRONG_SIGN,
            "The motor speed says the opposite of the commanded direction; the sign of the drive's speed or of the "
            "moves is reversed: positive is positive travel throughout.",
        )
    if abs(travel - 1.0) >= TRAVEL:
        unit = _unit(travel, SPEED_UNITS)
        return Refusal(
            Reason.IMPLAUSIBLE_MAGNITUDE if unit else Reason.TRAJECTORY_NOT_FOLLOWED,
            f"By its speed the motor travels {travel:.3g} times the commanded step"
            + (
                f": {unit}?"
                if unit
                else "; it was stopped or disturbed, or the transmission is wrong: check both."
            ),
        )
    if peak >= 1.0 + PEAK:
        return Refusal(
            Reason.TRAJECTORY_NOT_FOLLOWED,
            f"The motor is {peak:.2f} times as fast as the commanded step at its fastest; the controller overshoots or "
            "the drive follows another profile: check its gains, 0x6086 and 0x60A4.",
        )
    if peak <= 1.0 - PEAK:
        return Refusal(
            Reason.EXCITATION,
            f"The largest motor speed is {peak:.2f} times that of a step without constant speed; the drive has no "
            "jerk-limited profile or a lower speed limit: t0 is not one clear time. Check 0x6086, 0x60A4, 0x6081.",
        )
    return None


def _profile(steps: Sequence[StepSignals]) -> Refusal | None:
    """Refuse a step with constant instead of rising acceleration: from 0.2 to 0.3 it has half of j_lim·T/4.

    Only where neither a_lim nor v_lim shaped the step, T = 4·(SL/(2 j_lim))^(1/3): there a_max is known.
    """
    shares = [_acceleration_share(step) for step in steps if _is_pure(step.move)]
    if not shares or float(np.median(shares)) > RISING:
        return None
    return Refusal(
        Reason.EXCITATION,
        f"At its strongest the motor accelerates with {float(np.median(shares)):.0%} of what the jerk-limited step "
        "needs; the drive follows another profile (constant acceleration): check 0x6086 = 2 and 0x60A4.",
    )


def _is_pure(move: Move) -> bool:
    return bool(abs(move.duration / (4.0 * np.cbrt(move.length / (2.0 * move.jerk))) - 1.0) < PURE)


def _acceleration_share(step: StepSignals) -> float:
    move = step.move
    ends = move.start + move.duration * np.array([0.2, 0.3])
    gained = float(np.diff(np.interp(ends, step.speed.time, step.speed.value))[0])
    return gained / (0.1 * move.duration) / (move.jerk * move.duration / 4.0)


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
    unit = _unit(abs(gain), ACCELERATION_UNITS)
    return Refusal(
        Reason.IMPLAUSIBLE_MAGNITUDE,
        f"The load accelerates {gain:.3g} times as the motor does"
        + (f": {unit}?" if unit else "; the sensor's scale is wrong: check its range setting and LSB."),
    )


def _unit(factor: float, units: Sequence[tuple[float, str]]) -> str | None:
    return next((name for size, name in units if abs(factor / size - 1.0) < GAIN), None)
