"""Whether the motor made the commanded steps: travel, largest speed, no constant speed, jerk-limited profile.

The drive's controller is none of our business: loops without feed-forward fall short, ring and creep to the
target, and every method here sees the motor's real motion. Refused is what no controller makes of the
commanded step: another unit, another sign, another profile, a stop.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from service.backlash.results import Reason, Refusal
from service.backlash.signals import BoolArray, StepSignals
from service.recording import FloatArray, Move, Recording, Trace

TRAVEL = (0.5, 1.2)
"""Range of the motor's travel over SL, when it rests again. Chosen: where friction asks for more than a soft position
loop gives, the motor stops up to a third short and waits for the integrator; a gap is passed all the same. That the
transmission is another one shows in the load's speed over the motor's."""

SETTLED = 0.3
"""Time after a move within which its travel ends [s], or with the next move. Chosen: a shorter rest than is usual."""

PEAK = (0.5, 1.4)
"""Range of the motor's largest speed over 2·SL/duration, what a step without a constant speed reaches. Chosen: loops
without feed-forward overshoot by a fifth and fall short by a third, and the methods see the motor's real motion."""

RESTING, AT_REST = 0.1, 0.02
"""Share of the move over which the motor may move with hardly any of its greatest speed, while it is to move fast."""

PLATEAU, HARDLY = 0.25, 0.15
"""Share of the move over which the motor may accelerate with hardly any of its greatest: a step without constant speed
passes zero in a fifteenth, friction and blows included in an eighth."""

CONSTANT = 3.0
"""Residual of the motor's speed against the jerk-limited step over that against constant acceleration, each at its best
delay and scale. Chosen: a loop that rings follows the first up to twice as badly, a drive without jerk limit far
worse."""

DELAYS = np.arange(-0.02, 0.4, 0.01)
"""Delays of the motor against the command that are tried, in durations of the move."""

PURE = 0.03
"""Tolerance of a move's duration over that of a step that no other limit shapes: drives round it to a cycle."""

GAIN = 0.2
"""Tolerance of the load's speed over the motor's. Chosen: more than the scale error of any sensor."""

SPEED_UNITS = (
    (30.0 / np.pi, "rpm instead of rad/s"),
    (0.5 / np.pi, "revolutions per second instead of rad/s"),
    (180.0 / np.pi, "degrees per second instead of rad/s"),
    (1e-3, "the length of the move in millimetres, or the speed a thousandth"),
    (1e3, "the transmission in millimetres per radian"),
)


def followed(recording: Recording, axis: str, steps: Sequence[StepSignals]) -> Refusal | None:
    """Refuse a run in which the motor did not make the commanded steps; at least one whole step is needed."""
    return _travelled(recording, axis) or _stopped(steps) or _motor(steps) or _profile(steps)


def _travelled(recording: Recording, axis: str) -> Refusal | None:
    """Refuse a motor that did not travel SL by the time it rests again: its sign, its unit, or a stop."""
    speed, transmission = recording.traces[axis, "motor_speed"], recording.axis(axis).transmission
    travel = float(np.median([_travel(speed, recording.moves, k) for k in range(len(recording.moves))]))
    travel *= transmission
    if TRAVEL[0] < travel < TRAVEL[1]:
        return None
    if TRAVEL[0] < -travel < TRAVEL[1]:
        return Refusal(
            Reason.WRONG_SIGN,
            "The motor speed says the opposite of the commanded direction; the sign of the drive's speed or of the "
            "moves is reversed: positive is positive travel throughout.",
        )
    unit = unit_of(travel, SPEED_UNITS)
    return Refusal(
        Reason.IMPLAUSIBLE_MAGNITUDE if unit else Reason.TRAJECTORY_NOT_FOLLOWED,
        f"By its speed the motor travels {travel:.3g} times the commanded step"
        + (
            f": {unit}?"
            if unit
            else "; it was stopped or disturbed, or the transmission is wrong: check both."
        ),
    )


def _travel(speed: Trace, moves: Sequence[Move], index: int) -> float:
    """Angle of the motor from the start of a move until it rests, forward, over SL [rad/m]."""
    move = moves[index]
    rest = move.end + SETTLED
    end = min(rest, moves[index + 1].start) if index + 1 < len(moves) else rest
    part = speed.between(move.start, end)
    return move.direction * float(np.trapezoid(part.value, part.time)) / move.length


def _stopped(steps: Sequence[StepSignals]) -> Refusal | None:
    """Refuse a motor that rests while it is commanded to move fast."""
    resting = float(np.median([_rest(step) for step in steps]))
    if resting < RESTING:
        return None
    return Refusal(
        Reason.TRAJECTORY_NOT_FOLLOWED,
        f"The motor stands still for {resting:.0%} of the commanded step; it was stopped: look for an obstacle, "
        "a limit or a fault of the drive.",
    )


def _rest(step: StepSignals) -> float:
    """Longest share of the move's middle over which the motor hardly moves."""
    speed = np.abs(step.speed.value[step.within(0.2, 0.85)])
    return longest(speed < AT_REST * np.max(step.speed.value)) * step.speed.period / step.move.duration


def _motor(steps: Sequence[StepSignals]) -> Refusal | None:
    peak = float(np.median([np.max(s.speed.value) * s.move.duration / (2 * s.move.length) for s in steps]))
    if peak >= PEAK[1]:
        return Refusal(
            Reason.TRAJECTORY_NOT_FOLLOWED,
            f"The motor is {peak:.2f} times as fast as the commanded step at its fastest; the controller overshoots or "
            "the drive follows another profile: check its gains, 0x6086 and 0x60A4.",
        )
    if peak <= PEAK[0] or float(np.median([_plateau(step) for step in steps])) > PLATEAU:
        return Refusal(
            Reason.EXCITATION,
            f"The motor reaches {peak:.0%} of the speed of a step without constant speed, then goes on evenly; the "
            "drive has no jerk-limited profile or a lower speed limit: t0 is not one clear time. "
            "Check 0x6086, 0x60A4 and 0x6081.",
        )
    return None


def _plateau(step: StepSignals) -> float:
    """Longest share of the move's middle over which the motor accelerates with hardly any of its greatest."""
    most = float(np.max(step.a_mot[step.within(0.0, 1.0)]))
    even = np.abs(step.a_mot[step.within(0.2, 0.9)]) < HARDLY * most
    return longest(even) * step.speed.period / step.move.duration


def _profile(steps: Sequence[StepSignals]) -> Refusal | None:
    """Refuse a drive that follows a step of constant acceleration more closely than a jerk-limited one.

    Only where neither a_lim nor v_lim shaped the step, T = 4·(SL/(2 j_lim))^(1/3): there its shape is known.
    """
    pure = [step for step in steps if _is_pure(step.move)]
    if (
        not pure
        or float(np.median([_residual(s, _jerk_limited) / _residual(s, _constant) for s in pure])) < CONSTANT
    ):
        return None
    return Refusal(
        Reason.EXCITATION,
        "The motor's speed rises and falls along straight lines, not as the jerk-limited step does; the drive follows "
        "another profile (constant acceleration): check 0x6086 = 2 and 0x60A4.",
    )


def _residual(step: StepSignals, shape: Callable[[FloatArray], FloatArray]) -> float:
    """What a shape leaves of the motor's speed [m/s], at its best delay and scale."""
    inside = step.within(-0.2, 1.3)
    share, v = (step.time[inside] - step.move.start) / step.move.duration, step.speed.value[inside]
    shapes = np.stack([shape(np.clip(share - delay, 0.0, 1.0)) for delay in DELAYS])
    explained = (shapes @ v) ** 2 / np.sum(shapes**2, axis=1)
    return float(np.sqrt(np.maximum(np.sum(v**2) - np.max(explained), 1e-12 * np.sum(v**2))))


def _jerk_limited(u: FloatArray) -> FloatArray:
    """Speed of the pure jerk-limited step over the share of its duration (n,), any scale."""
    w = np.minimum(u, 1.0 - u)
    return np.where(w < 0.25, w**2, 0.125 - (0.5 - w) ** 2)


def _constant(u: FloatArray) -> FloatArray:
    """Speed of a step of constant acceleration over the share of its duration (n,), any scale."""
    return np.minimum(u, 1.0 - u)


def _is_pure(move: Move) -> bool:
    return bool(abs(move.duration / (4.0 * np.cbrt(move.length / (2.0 * move.jerk))) - 1.0) < PURE)


def longest(flags: BoolArray) -> int:
    """Length of the longest run of True."""
    ends = np.flatnonzero(np.diff(np.concatenate(([0], flags.astype(int), [0]))))
    return int(np.max(ends[1::2] - ends[::2], initial=0))


def unit_of(factor: float, units: Sequence[tuple[float, str]]) -> str | None:
    return next((name for size, name in units if abs(factor / size - 1.0) < GAIN), None)
