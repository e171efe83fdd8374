"""The paper's method as it stands, the readable reference: section III, eqs. (10) to (12), ten steps averaged.

Zenn, Keck, Beck, Herold, Melz: Automated backlash determination on rack-and-pinion drives, AIM 2023.

    signals      motor and load acceleration, forward, at the output; low-passed for the integration
    admission    whether they can be what was commanded, on the axis they are said to be of
    alignment    what the accelerometer's clock is late, how soft the drive is
    detection    t1 by gamma_t1, t2 by gamma_t2 = 0.5·max
    integration  b by eq. (10)
    averaging    ten steps, 95 % interval

The thresholds are several percent low on a single axis and worse on a gantry, where the partner's pull drives
motor and load apart before the flanks part. The interval says so: it reaches from the earliest to the latest
that t1 and t2 can be.

Symbols: t1, t2 the flanks part and meet; b the backlash; SL, j_lim length and jerk of the step.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from service.backlash.admission import admit, whole_steps
from service.backlash.alignment import LARGEST, SMALLEST, lag, softness
from service.backlash.averaging import FEWEST_STEPS, Average, StepValue, average, outlier, too_few, unsure
from service.backlash.detection import Pass, find_pass, run_noise
from service.backlash.integration import parted
from service.backlash.results import AxisResult, Reason, Refusal, StepResult
from service.backlash.signals import StepSignals, for_integration
from service.recording import Recording

METHOD = "paper"

KEPT_CLEAR = 0.005
"""No sample may be lost so close to the pass [s]: a lost one bends the filters' output around it. Chosen: the
half width of both filters at 500 Hz."""

LEAST_FREE = 0.25
"""b over j_lim·(t2 − t1)³/6, at least. Chosen: friction and a partner's pull leave a third and more of it."""

GANTRY_ACCURACY = 0.2
"""Accuracy that section V reports of the method on a gantry, relative; no interval of one is narrower."""


def paper(recording: Recording, axis: str) -> AxisResult:
    """Backlash of one axis [m] by the paper's thresholds with its 95 % interval, or a named refusal."""
    refusal = admit(recording, axis)
    if refusal:
        return _refused(axis, refusal)
    tau = _skew(recording, axis)
    if abs(tau) > LARGEST:
        return _refused(axis, _far_off(tau))
    return _judged(recording, axis, _values(recording, axis, tau), tau)


def _passes(steps: Mapping[int, StepSignals]) -> dict[int, Pass | Refusal]:
    """The pass of every step, by index; gamma_t1 is the same for the whole run."""
    noise = run_noise(list(steps.values()))
    return {index: find_pass(signals, noise) for index, signals in steps.items()}


def _skew(recording: Recording, axis: str) -> float:
    """τ [s] of the accelerometer's stamps: roughly, then without the passes; 0 where too small to be told."""
    tau = lag(list(whole_steps(recording, axis).values()))
    if abs(tau) > LARGEST:
        return tau
    steps = whole_steps(recording, axis, tau)
    tau += lag(list(steps.values()), {i: p for i, p in _passes(steps).items() if isinstance(p, Pass)})
    return tau if abs(tau) > SMALLEST else 0.0


def _values(recording: Recording, axis: str, tau: float) -> list[tuple[StepValue, Pass] | Refusal]:
    """b of every step with its pass, or why there is none; the drive's softness is that of the whole run."""
    steps = whole_steps(recording, axis, tau)
    passes = _passes(steps)
    c = softness([(steps[index], found) for index, found in passes.items() if isinstance(found, Pass)])
    gantry = recording.partner(axis) is not None
    return [
        _step(steps[index], passes[index], c, gantry) if index in steps else _incomplete()
        for index in range(len(recording.moves))
    ]


def _step(
    signals: StepSignals, found: Pass | Refusal, c: float, gantry: bool
) -> tuple[StepValue, Pass] | Refusal:
    """b of one step by eq. (10) with its bounds, and its pass; or why not."""
    if isinstance(found, Refusal):
        return found
    lost = _lost(signals, found)
    if lost:
        return lost
    value = _bounded(for_integration(signals), found, c, gantry)
    return _dragged(signals, found, value.b) or (value, found)


def _dragged(signals: StepSignals, found: Pass, b: float) -> Refusal | None:
    """Refuse a pass that is far too long for its b: a free load would have gained j_lim·T³/6."""
    free = signals.move.jerk * (found.t2 - found.t1) ** 3 / 6.0
    if b > LEAST_FREE * free:
        return None
    return Refusal(
        Reason.NO_RELEASE,
        f"Motor and load drift apart from {found.t1:.4f} s on, {b * 1e6:.1f} µm where a free load gains "
        f"{free * 1e6:.0f}: they drift before the flanks part, by a gantry partner's pull or a soft drive, and t1 "
        "cannot be told; an estimate that models the pull is needed.",
    )


def _bounded(signals: StepSignals, found: Pass, c: float, gantry: bool) -> StepValue:
    """b by eq. (10), and the bounds that three independent unknowns leave it, each at either end of its range.

    t2 between its change of sign and its peak; t1 from the change of sign on, for a gantry up to half the way
    down, where the partner's pull may have begun the fall; the speed c·j_lim by which the load can be ahead of
    the motor at t1 already.
    """
    b = parted(signals, found.t1, found.t2)
    late = b - parted(signals, found.t1_range[1], found.t2) if gantry else 0.0
    early = parted(signals, found.t1_range[0], found.t2) - b
    first = b - parted(signals, found.t1, found.t2_range[0])
    last = parted(signals, found.t1, found.t2_range[1]) - b
    unwinding = c * signals.move.jerk * (found.t2 - found.t1)
    return StepValue(b, b - float(np.hypot(late, first)), b + float(np.linalg.norm((early, last, unwinding))))


def _lost(signals: StepSignals, found: Pass) -> Refusal | None:
    """Refuse a step with samples lost in the pass. Where there is no pass, a few lost samples are not why."""
    start, end = found.t1 - KEPT_CLEAR, found.t2 + KEPT_CLEAR
    lost = signals.speed.lost_between(start, end) + signals.acceleration.lost_between(start, end)
    if not lost:
        return None
    return Refusal(
        Reason.FRAME_LOSS,
        f"{lost} samples are lost around the pass ({start:.4f} to {end:.4f} s); a frame was lost on the bus: "
        "check bus load, termination and shield if it happens often.",
    )


def _incomplete() -> Refusal:
    return Refusal(
        Reason.STEP_INCOMPLETE,
        "The samples do not reach over the whole move; the recording was cut short or begins too late: record "
        "0.1 s before the first and after the last move.",
    )


def _far_off(tau: float) -> Refusal:
    return Refusal(
        Reason.SIGNALS_DISAGREE,
        f"The accelerometer lags the drive by {tau * 1e3:.1f} ms; its samples were placed by arrival, or a filter "
        "delays them: place them by their counter, check the sensor's filter setting.",
    )


def _judged(
    recording: Recording, axis: str, found: Sequence[tuple[StepValue, Pass] | Refusal], tau: float
) -> AxisResult:
    """The axis' result from its steps: averaged, and refused where they are too few or disagree."""
    values = [item[0] for item in found if not isinstance(item, Refusal)]
    mean = average(values) if values else None
    kept = iter(mean.kept if mean else ())
    items = [item if isinstance(item, Refusal) or next(kept) else outlier(item[0]) for item in found]
    steps = tuple(
        _step_result(index, move.direction, item)
        for index, (move, item) in enumerate(zip(recording.moves, items, strict=True))
    )
    if mean is None or sum(mean.kept) < FEWEST_STEPS:
        return _refused(axis, too_few(steps), steps)
    refusal = unsure(mean)
    if refusal:
        return _refused(axis, refusal, steps)
    interval = _interval(mean, recording.partner(axis) is not None)
    note = (
        f"The accelerometer's stamps are {tau * 1e3:.2f} ms late against the drive's; corrected."
        if tau
        else None
    )
    return AxisResult(axis, "ok", METHOD, None, note, mean.b, interval, steps)


def _interval(mean: Average, gantry: bool) -> tuple[float, float]:
    """The 95 % interval [m]: not below zero, and of a gantry no narrower than section V found."""
    lower, upper = mean.interval_95
    if gantry:
        lower, upper = min(lower, (1 - GANTRY_ACCURACY) * mean.b), max(upper, (1 + GANTRY_ACCURACY) * mean.b)
    return max(lower, 0.0), upper


def _step_result(index: int, direction: int, item: tuple[StepValue, Pass] | Refusal) -> StepResult:
    if isinstance(item, Refusal):
        return StepResult(index, direction, "refused", item.reason, item.detail)
    value, found = item
    return StepResult(index, direction, "ok", backlash=value.b, t1=found.t1, t2=found.t2)


def _refused(axis: str, refusal: Refusal, steps: tuple[StepResult, ...] = ()) -> AxisResult:
    return AxisResult(axis, "refused", METHOD, refusal.reason, refusal.detail, steps=steps)
