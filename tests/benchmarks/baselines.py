"""The paper's predecessors, for comparison only: what each assumes of the load while the gap is passed.

The paper's section I sorts the direct methods by how they get the load's motion between the two flanks:

output_at_rest          its refs. [9] and [10]: the load stands still
constant_output_speed   its ref. [11]: the load goes on at the speed at which the flanks parted
speed_curves            its ref. [3]: an accelerometer says how the load moves; begin and end from the speeds

All were published for gearboxes, whose output stands or turns evenly. Here they are applied to the same
recordings as our own methods, at the part of the move that each was made for, as its description says and
without repairs; t1 and t2 are the paper's names for begin and end of the pass. A step's b is averaged over the
steps; the interval holds the steps' scatter, which is all that these methods know of their error.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from service.backlash.admission import admit, whole_steps
from service.backlash.interval import half_width_95, robust_mean
from service.backlash.results import AxisResult, Reason, Refusal
from service.backlash.signals import StepSignals, even, running_integral
from service.recording import FloatArray, Move, Recording, Trace

FEWEST = 3
"""Steps that an average needs."""

STARTED = 0.02
"""Share of the step's greatest speed at which the motor is said to move. Chosen: above the speed's noise."""

BLOW_AFTER, BLOW_BEFORE = 0.02, 0.75
"""Where after t0 an impact is looked for: shares of the move's duration after t0, and of the move. At three quarters
the jerk changes its sign, which a motor's speed does not tell from a blow."""


@dataclass(frozen=True)
class Found:
    """Pass of one step: begin and end [s], backlash [m]."""

    t1: float
    t2: float
    b: float


Baseline = Callable[[Recording, str], AxisResult]


def output_at_rest(recording: Recording, axis: str) -> AxisResult:
    """Refs. [9], [10]: b is how far the drive travels from its change of direction until its torque rises.

    Assumes that the pinion rests on the flank of the last move when the drive turns round, and that the load
    stands still until the other flank is reached; the re-engagement is where the motor's torque rises
    fastest. Needs the torque (or current) and a change of direction between moves. Where the pinion comes to
    rest somewhere inside the gap, as on a rack with friction in its guide, only a part of b is passed.
    """
    torque = recording.trace(axis, "motor_torque")
    if torque is None:
        return _refused(
            "output_at_rest", axis, Refusal(Reason.CHANNEL_MISSING, "the motor's torque was not recorded")
        )
    steps = {k: s for k, s in _steps(recording, axis).items() if _turns_round(recording.moves, k)}
    found = {k: _from_reversal(s, torque) for k, s in steps.items()}
    return _averaged("output_at_rest", recording, axis, found)


def constant_output_speed(recording: Recording, axis: str) -> AxisResult:
    """Ref. [11]: the load keeps the speed that the motor has when it begins to brake, at t1 = t0.

    Assumes that the flanks part the moment the motor brakes and that nothing slows the load; the end of the
    pass is where the motor's speed is pushed on by the impact. Needs the motor's speed only. Friction in the
    guide and the compliance of the drive, whose wind-up parts the flanks later than t0, are not in it.
    """
    return _averaged(
        "constant_output_speed",
        recording,
        axis,
        {k: _with_constant_speed(s) for k, s in _steps(recording, axis).items()},
    )


def speed_curves(recording: Recording, axis: str) -> AxisResult:
    """Ref. [3]: b is the area between the load's and the motor's speed from t0 until the impact.

    The load's speed is the integrated accelerometer, equal to the motor's at t1 = t0, where the motor begins
    to brake; at t2 the speeds are furthest apart, since from the impact on the flank brings them together.
    Assumes, as [11] does, that the flanks part at t0. Needs the accelerometer.
    """
    return _averaged(
        "speed_curves", recording, axis, {k: _from_speeds(s) for k, s in _steps(recording, axis).items()}
    )


BASELINES: Mapping[str, Baseline] = {
    "output_at_rest": output_at_rest,
    "constant_output_speed": constant_output_speed,
    "speed_curves": speed_curves,
}


def _steps(recording: Recording, axis: str) -> dict[int, StepSignals]:
    """The steps that were recorded whole; none of a recording that no method may answer."""
    return {} if admit(recording, axis) else whole_steps(recording, axis)


def _turns_round(moves: tuple[Move, ...], index: int) -> bool:
    return index > 0 and moves[index].direction != moves[index - 1].direction


def _from_reversal(step: StepSignals, torque: Trace) -> Found | None:
    """From the first motion of the motor until its torque rises fastest, in the first quarter of the move."""
    move, speed = step.move, step.speed
    moving = np.flatnonzero((speed.time > move.start) & (speed.value > STARTED * np.max(speed.value)))
    if len(moving) == 0:
        return None
    t1 = float(speed.time[moving[0]])
    part = torque.between(t1, move.start + 0.25 * move.duration)
    if len(part) < 3:
        return None
    rise = even(Trace(part.time, move.direction * part.value))
    t2 = float(rise.time[int(np.argmax(np.diff(rise.value))) + 1])
    return Found(t1, t2, _travel(step, move.start, t2))


def _with_constant_speed(step: StepSignals) -> Found | None:
    t1 = braking_begins(step)
    window = None if t1 is None else _after(step, t1)
    if t1 is None or window is None:
        return None
    jerk = np.gradient(step.a_mot, step.time)
    t2 = float(step.time[window][np.argmax(jerk[window])])
    v = float(np.interp(t1, step.speed.time, step.speed.value))
    return Found(t1, t2, v * (t2 - t1) - _travel(step, t1, t2))


def _from_speeds(step: StepSignals) -> Found | None:
    t1 = braking_begins(step)
    window = None if t1 is None else _after(step, t1)
    if t1 is None or window is None:
        return None
    ahead = step.v_mas - step.speed.value
    ahead = ahead - float(np.interp(t1, step.time, ahead))
    t2 = float(step.time[window][np.argmax(ahead[window])])
    area = running_integral(ahead, step.speed.period)
    return Found(t1, t2, float(np.interp(t2, step.time, area) - np.interp(t1, step.time, area)))


def braking_begins(step: StepSignals) -> float | None:
    """t0 [s]: the motor's acceleration changes its sign, between the middle half of the move; None if it does not."""
    inside = np.flatnonzero(step.within(0.25, 0.75))
    a = step.a_mot[inside]
    falls = np.flatnonzero((a[:-1] > 0.0) & (a[1:] <= 0.0))
    if len(falls) == 0:
        return None
    k = inside[falls[0]]
    share = step.a_mot[k] / (step.a_mot[k] - step.a_mot[k + 1])
    return float(step.time[k] + share * (step.time[k + 1] - step.time[k]))


def _after(step: StepSignals, t1: float) -> FloatArray | None:
    """Indices of the samples in which the impact is looked for (n,), None where there are none."""
    move = step.move
    first, last = t1 + BLOW_AFTER * move.duration, move.start + BLOW_BEFORE * move.duration
    inside = np.flatnonzero((step.time > first) & (step.time < last))
    return inside if len(inside) > 1 else None


def _travel(step: StepSignals, start: float, end: float) -> float:
    """Distance of the motor at the output between two times [m]."""
    x = step.speed.integral
    return float(np.interp(end, step.speed.time, x) - np.interp(start, step.speed.time, x))


def _averaged(method: str, recording: Recording, axis: str, found: Mapping[int, Found | None]) -> AxisResult:
    """Mean of the steps with the scatter's interval, or a refusal where too few gave anything."""
    refusal = admit(recording, axis)
    if refusal:
        return _refused(method, axis, refusal)
    values = np.array([f.b for f in found.values() if f is not None])
    if len(values) < FEWEST:
        return _refused(
            method, axis, Refusal(Reason.TOO_FEW_STEPS, f"a pass was found in {len(values)} steps")
        )
    b, error, kept = robust_mean(values)
    if b <= 0.0:
        return _refused(method, axis, Refusal(Reason.GAP_NOT_CROSSED, f"{b * 1e6:.1f} µm is no gap"))
    half = half_width_95(error, int(np.sum(kept)) - 1, (), b)
    return AxisResult(axis, "ok", method, backlash=b, interval_95=(max(b - half, 0.0), b + half))


def _refused(method: str, axis: str, refusal: Refusal) -> AxisResult:
    return AxisResult(axis, "refused", method, refusal.reason, refusal.detail)
