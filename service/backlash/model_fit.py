"""Backlash by output-error fit of the load acceleration, driven by the measured motor motion (estimator.md nos. 2-5).

The axis' whole model, eqs. (2)-(7) and for a gantry (9), is simulated from the measured motion of the motor and
compared with the accelerometer; the backlash is one of its parameters. Both axes of a gantry are fitted together:
the partner's pull is part of the model. The value stands or falls with how well the model explains the
recording, so the misfit to the noise at standstill is judged, and the interval holds what the fit's own
covariance does not know: the misfit, the noise of the input, the scatter of the steps and the spread over starts.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from service.backlash.by_products import by_products
from service.backlash.interval import half_width_95
from service.backlash.model_fit_beside import Beside
from service.backlash.model_fit_data import Measured, measure
from service.backlash.model_fit_gantry import gantry_fit
from service.backlash.model_fit_impurity_sizes import (
    by_and_by,
    by_evidence,
    likeliest_width,
    without_impurities,
)
from service.backlash.model_fit_input_noise import input_variance
from service.backlash.model_fit_interval import (
    Linearised,
    difference,
    disagreement,
    linearised,
    noise_variance,
    repeating,
    structure_variance,
)
from service.backlash.model_fit_motion import with_following_motors
from service.backlash.model_fit_profile import widened
from service.backlash.model_fit_single import single_fit
from service.backlash.model_fit_stages import (
    HOPELESS,
    Effort,
    Outcome,
    Staged,
    backlashes,
    following_force,
    lowest,
)
from service.backlash.model_fit_start import closed_form
from service.backlash.model_fit_whole_moves import Estimate, estimate, together, unsure, whole_moves
from service.backlash.moves_fit import Fitted
from service.backlash.results import AxisResult, Reason, Refusal, StepResult
from service.dynamics.driven_model import Model
from service.recording import FloatArray, Recording

METHOD = "model_fit"

MIN_STEPS = 4

SINGLE = Effort(tried=8, starts=2)

GANTRY = Effort(
    candidates=1500,
    starts=6,
    tried=24,
    brief=8,
    rounds=(8, 6, 6),
    heavier=(6,) * 6,
    refine=(5,) * 5,
    following=(4, 4),
)

DEGREES = 60
"""Of freedom of the standard error: some dozens of residuals' lengths of correlation hold its influence."""

SMALLEST = 1e-6
"""A gap below this [m] is refused. Chosen, about a tenth of the smallest that the method is meant for: where the flanks
never part, a fit may take how their force turns over for a gap of some tenths of a micrometre, and be sure of it."""

MISFIT_LIMIT, NEARLY = 1.5, 3.0
"""Misfit that a sound machine has at most, and that of a fit from which on no sound one is looked for near by: it would
explain less."""

UNEXPLAINED, UNEXPLAINED_ALONE = 0.02, 0.04
"""Refused where the misfit is above that of a sound machine and its excess over the noise is more than this share of
the acceleration: of a gantry, and of a single axis, whose interval takes in what repeats. The interval grows with the
misfit; beyond this, what the model lacks is no small addition to it."""

LACKED = 8.0
"""Share of the backlash that is in doubt over the share of the acceleration that repeats and is not the model's.
Chosen: of ten axes whose partner nobody declared, and that were not refused for it, nine were off by less."""

DIRECTIONS_DIFFER = 4.0
"""Difference of the two directions over its standard error from which on something else moves the load: by chance
in one of 250 runs of ten steps."""

DIRECTIONS_MATTER = (1e-6, 0.02)
"""Difference of the directions [m], or share of the backlash, up to which it is no reason to refuse: no more than the
accuracy that is asked of an axis with small impurities, and in the interval (chosen)."""

FAR_OUT = 3.5
"""How many of its prior's standard deviations a mesh error or a bent contact may reach in a sound machine."""

TOO_WIDE = 0.2
"""Half width over the value beyond which there is none: what the paper's section V reached on a machine."""


def refused(axis: str, reason: Reason, detail: str, steps: tuple[StepResult, ...] = ()) -> AxisResult:
    """An axis without a value, and why."""
    return AxisResult(axis, "refused", METHOD, reason, detail, steps=steps)


def model_fit(recording: Recording, axis: str) -> AxisResult:
    """Backlash of one axis; a gantry's axis is fitted with its partner (use `model_fit_axes` to get both at once)."""
    return model_fit_axes(recording, axis)[axis]


def model_fit_axes(recording: Recording, axis: str) -> dict[str, AxisResult]:
    """Results of the axis and, on a gantry, of its partner, from one joint fit."""
    partner = recording.partner(axis)
    axes = (axis,) if partner is None else tuple(a.name for a in recording.axes if a.name in (axis, partner))
    lacking = unfit_for_use(recording, axis, axes if partner is None else (axis, partner))
    if lacking is not None:
        return {axis: lacking}
    measured = measure(recording, axes, range(len(recording.moves)))
    if len(axes) == 1:  # of a gantry, the closed form would mistake the partner's pull for the gap
        staged = single_fit(measured, {axis: closed_form(recording, axis)}, SINGLE)
    else:
        staged = gantry_fit(measured, GANTRY)
    best = staged.best
    if best.fit.misfit < NEARLY and far_out(best.problem.model, best.fit.point.shared):
        staged = sound(measured, staged)
    best = staged.best
    linear = linearised(best.problem, best.fit.point)
    width = likeliest_width(linear, best.fit.misfit)
    beside = Beside(best, linear, width, lowest(staged.ends))
    moves = None
    if len(axes) == 1 and unsure(linear, best.fit.misfit, coordinate(best, 0)):
        moves = whole_moves(recording, best)
    return {name: judged(recording, measured, staged, beside, x, moves) for x, name in enumerate(axes)}


def sound(measured: Measured, staged: Staged) -> Staged:
    """A sound machine near by that explains the recording as well as one has to; where there is none, what was found.

    A mesh's slope and a bow of it together may lie along a valley with the backlash, and a fit far out in it: what else
    they had bent may hold it there where they are taken away at once.
    """
    motors = following_force if len(measured.axes) == 1 else with_following_motors
    ends = without_impurities(measured, staged.best, motors)
    if lowest(ends).fit.misfit >= MISFIT_LIMIT:
        ends += by_and_by(measured, staged.best, motors)
    best = lowest(ends)
    return replace(staged, best=best, ends=ends) if best.fit.misfit < MISFIT_LIMIT else staged


def unfit_for_use(recording: Recording, axis: str, axes: tuple[str, ...]) -> AxisResult | None:
    """The refusal of a recording that does not hold what a fit needs, None when it does."""
    if len(recording.moves) < MIN_STEPS:
        reason = Reason.TOO_FEW_STEPS if recording.moves else Reason.NO_MOVES
        return refused(
            axis,
            reason,
            f"{len(recording.moves)} steps recorded, {MIN_STEPS} needed; run the whole plan.",
        )
    for name in axes:
        for channel in ("motor_speed", "acceleration"):
            if recording.trace(name, channel) is None and name == axis:
                return refused(
                    axis, Reason.CHANNEL_MISSING, f"The channel {channel} of {axis} was not recorded; map it."
                )
            if recording.trace(name, channel) is None:
                detail = f"{axis} is moved by {name} too, its {channel} is missing; record both axes of the gantry."
                return refused(axis, Reason.GANTRY_PARTNER_MISSING, detail)
            lost = recording.moves_without(name, channel)
            if lost:
                detail = (
                    f"Step {lost[0] + 1} has hardly any {channel} of {name}: the recording broke off there. "
                    "Check the bus and the sensor's connector, then run the check again."
                )
                return refused(axis, Reason.FRAME_LOSS, detail)
    return None


def unexplained(measured: Measured, outcome: Outcome) -> float:
    """What of the acceleration is neither the model's nor the noise, as a share of its RMS."""
    excess = np.sqrt(max(0.0, outcome.fit.misfit - 1.0)) * np.mean(measured.noise)
    return float(excess / size_of_signal(outcome))


def size_of_signal(outcome: Outcome) -> float:
    """RMS of the acceleration that is compared [m/s²]."""
    used = np.stack([grid.used for grid in outcome.problem.grids])
    signal = np.stack([grid.measured for grid in outcome.problem.grids])[used]
    return float(np.sqrt(np.mean(signal**2)))


def far_out(model: Model, shared: FloatArray) -> str | None:
    """The impurity, in words, that no sound machine has so much of, by a model's coordinates (P,). On a gantry that of
    either axis: what one motion bends to follow the recording, the other axis' value is bent with."""
    for parameter, u in zip(model.parameters, shared, strict=True):
        axis, _, name = parameter.name.rpartition(".")
        if abs(u) > FAR_OUT and name == "bend":
            return f"the force of {axis}'s flanks is far from proportional to their depth"
        if abs(u) > FAR_OUT and name.startswith("mesh_"):
            return f"the mesh of {axis} runs with an error of many micrometres"
    return None


@dataclass(frozen=True)
class StepValues:
    """b : (T,) each step's own backlash [m], other parameters held; t1, t2 : (T,) [s], NaN where there is none."""

    b: FloatArray
    t1: FloatArray
    t2: FloatArray


def step_values(outcome: Outcome, fit: Linearised, x: int) -> StepValues:
    """What each step says by itself, from one linearised solve for b and its initial state."""
    problem, k = outcome.problem, coordinate(outcome, x)
    parameter, u = problem.model.parameters[k], fit.at.shared[k]
    half = 0.5 * float(parameter.value(u))
    b, t1, t2 = [], [], []
    for t, (grid, step) in enumerate(zip(problem.grids, fit.steps, strict=True)):
        moved = np.linalg.lstsq(np.column_stack((step.shared[:, k], step.own)), -step.r, rcond=None)[0][0]
        b.append(float(parameter.value(u + np.clip(moved, -1.0, 1.0))))
        crossing = grid.s * outcome.fit.response.relative[0, t, x]
        t1.append(first_time(grid.time, crossing < half))
        t2.append(first_time(grid.time, crossing < -half))
    return StepValues(np.array(b), np.array(t1), np.array(t2))


def coordinate(outcome: Outcome, x: int) -> int:
    """Which of the model's parameters is the backlash of axis x."""
    model = outcome.problem.model
    return [p.name for p in model.parameters].index(f"{model.axes[x]}.backlash")


def first_time(time: FloatArray, happened: FloatArray) -> float:
    """The first time at which something holds, NaN if it never does."""
    return float(time[np.argmax(happened)]) if np.any(happened) else float("nan")


def interval_half_width(
    staged: Staged, fit: Linearised, x: int, steps: StepValues, beyond: float = 0.0
) -> float:
    """Half width of the 95 % interval [m] of axis x: what moves the fit's value, and the spread over its passes.

    Passes count that the data do not tell from the best: within two of the logarithm of the likelihood, the residuals
    being as large as they are.
    """
    best, k = staged.best, coordinate(staged.best, x)
    value = float(backlashes(best.problem, best.fit)[x])
    crossed = np.where(np.isfinite(steps.t2), steps.b, np.nan)
    variance = beyond + noise_variance(fit, k) + structure_variance(fit, k, best.fit.misfit)
    variance += disagreement(crossed, best.problem.s)
    as_good = best.fit.cost + 2.0 * max(1.0, best.fit.misfit)
    near = [float(backlashes(o.problem, o.fit)[x]) for o in staged.ends if o.fit.cost < as_good]
    return half_width_95(float(np.sqrt(variance)), DEGREES, near, value)


def judged(
    recording: Recording,
    measured: Measured,
    staged: Staged,
    beside: Beside,
    x: int,
    moves: Fitted | None = None,
) -> AxisResult:
    """Verdict, value and interval of axis x of the fit, and of one of whole moves where there is one."""
    best, name = staged.best, staged.best.problem.model.axes[x]
    k = coordinate(best, x)
    fit, spread = by_evidence(beside.linear, best.fit.misfit)
    variance = float(spread[k, k]) * fit.slope(k) ** 2 + input_variance(measured, best, fit.influence(k))
    value = float(best.problem.model.parameters[k].value(fit.at.shared[k]))
    if len(best.problem.model.axes) == 1:
        lacked = np.sqrt(repeating(fit)) * float(measured.noise[x]) / size_of_signal(best)
        variance += (LACKED * lacked * value / 1.96) ** 2
    steps = step_values(best, fit, x)
    results = tuple(one_step(recording, steps, t) for t in range(len(recording.moves)))
    doubted = doubt(measured, best, x, steps, moves)
    if doubted:
        return refused(name, *doubted, results)
    half = interval_half_width(staged, fit, x, steps, variance)
    if moves is not None:
        of_moves = estimate(moves, DEGREES)
        strange = far_out(best.problem.model, best.fit.point.shared)
        taken = of_moves if strange else together(Estimate(value, half), of_moves)
        value, half = taken.value, taken.half
    if len(best.problem.model.axes) == 2 and half < TOO_WIDE * value:
        # Where a partner holds the load a flank may be reached only just, in some steps, or in one direction.
        value, half = widened(partial(beside.rise, k), value, half, best.fit.misfit)
    held = best.problem.s if len(best.problem.model.axes) == 2 else None
    refusal = wanting(value, half, steps, held)
    if refusal:
        return refused(name, *refusal, results)
    return AxisResult(
        name,
        "ok",
        METHOD,
        backlash=value,
        interval_95=(value - half, value + half),
        steps=results,
        by_products=by_products(best.fit, beside.linear, x),
    )


def doubt(
    measured: Measured, best: Outcome, x: int, steps: StepValues, moves: Fitted | None = None
) -> Refusal | None:
    """Why the model cannot be that of the machine, None where it can. How large its impurities are, whole moves say
    better where they were fitted."""
    share = unexplained(measured, best)
    if not best.fit.misfit < HOPELESS:
        return Refusal(
            Reason.MISFIT,
            "No fit came near the recording from any of its starts: the model is far from the machine, or the channels "
            "do not belong together. Look at the recording; if it looks like any other, please report it.",
        )
    alone = len(best.problem.model.axes) == 1
    if best.fit.misfit > MISFIT_LIMIT and share > (UNEXPLAINED_ALONE if alone else UNEXPLAINED):
        return Refusal(
            Reason.MISFIT,
            f"The model leaves {share:.1%} of the acceleration unexplained, {np.sqrt(best.fit.misfit):.1f} times the "
            "noise at rest; the axis does something that the model lacks (another axis pulls, loose part, second gap, "
            "collision), or the channels do not belong together: look at the residual.",
        )
    shared = best.fit.point.shared if moves is None else moves.at.shared
    strange = far_out(best.problem.model if moves is None else moves.model, shared)
    if strange:
        return Refusal(
            Reason.MISFIT,
            f"Only where {strange} does the model follow; the axis does something that the model lacks, or a tooth is "
            "damaged: look at the residual.",
        )
    crossed = np.where(np.isfinite(steps.t2), steps.b, np.nan)
    differ = difference(crossed, best.problem.s)
    least, share_of_b = DIRECTIONS_MATTER
    matters = abs(differ.mean) > max(least, share_of_b * float(np.nanmean(steps.b)))
    sure = abs(differ.mean) > DIRECTIONS_DIFFER * differ.error
    # A declared gantry's mesh errors pull one side against the other; there the difference widens the interval only.
    if alone and sure and matters:
        return Refusal(
            Reason.STEPS_DISAGREE,
            f"The two directions differ by {differ.mean * 1e6:+.1f} µm, {abs(differ.mean) / differ.error:.0f} times "
            "their scatter, and the gap is the same both ways; another axis that was not declared, a spring or a cable "
            "pulls at the load: declare the gantry, look for what pulls.",
        )
    return None


def wanting(
    value: float, half: float, steps: StepValues, directions: FloatArray | None = None
) -> Refusal | None:
    """Why the fit says nothing about the gap, None where it does; `directions` (T,) of a gantry's steps.

    A single axis' gap that is crossed in one direction is still what the load travels between two contacts. On a
    gantry the distance of the two axes' zeros pulls at the bridge too, and only crossing both ways tells the two apart.
    """
    crossed = np.isfinite(steps.t2)
    if not np.any(crossed):
        return Refusal(
            Reason.GAP_NOT_CROSSED,
            "The flanks changed sides in no step; the step is too short or slow for the gap or the load is held.",
        )
    if directions is not None and set(directions[crossed]) != set(directions):
        return Refusal(
            Reason.GAP_NOT_CROSSED,
            "The flanks changed sides in one direction only; the partner holds the load against one flank in the "
            "other, and where the gap ends there is not to be told from where the two axes' zeros lie: align the "
            "axes, or choose a longer or faster step.",
        )
    if value < SMALLEST:
        return Refusal(
            Reason.GAP_NOT_CROSSED,
            f"A gap of {value * 1e6:.2f} µm is not to be told from flanks that did not part: the step is too slow, "
            "friction holds the load, or the pinion is preloaded; choose a faster step.",
        )
    if half > TOO_WIDE * value:
        return Refusal(
            Reason.INTERVAL_TOO_WIDE,
            f"{value * 1e6:.1f} ± {half * 1e6:.1f} µm says nothing; lower the noise, lengthen the step, or look at the "
            "residual where it is above the noise.",
        )
    return None


def one_step(recording: Recording, steps: StepValues, t: int) -> StepResult:
    """The result of one step; refused where the gap was not crossed in it."""
    direction = recording.moves[t].direction
    if np.isfinite(steps.t2[t]):
        return StepResult(
            t, direction, "ok", backlash=float(steps.b[t]), t1=float(steps.t1[t]), t2=float(steps.t2[t])
        )
    detail = "The flanks did not change sides in this step; the partner or friction held the load."
    return StepResult(t, direction, "refused", Reason.GAP_NOT_CROSSED, detail)
