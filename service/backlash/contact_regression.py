"""Backlash by linear regression over the contact phases: closed form, no start value, always available.

While a flank touches, the load follows the motor up to half the backlash and the wind-up of the drive,

    D(t) = x̄_mot − x_mas = ± s·b/2 + c·a + d·ȧ + e·ä + f·v + x0,

+ before the release, − after the impact, where c = M/k, d the damping's share, e the inertia between motor
and rack, f viscous friction and the time between the two streams (D moves by v·dt). x0 belongs to each step:
where the pinion rested is not known. c to f are shared by all steps. The integration starts at rest, and its
drift, noise integrated twice, is weighed by its covariance (generalised least squares): it takes the
place of the load's speed at t1, which eq. (10) sets to the motor's. One solve gives everything; what happens
inside the gap is not used, so that neither t1 nor t2 need be sharp.

Symbols as in contact_steps.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.polynomial.chebyshev import chebvander
from numpy.typing import NDArray
from scipy.linalg import solve_triangular
from scipy.signal import savgol_filter

from service.backlash.contact_steps import REST_BEFORE, ContactStep, contact_step, output_speed
from service.backlash.interval import half_width_95, robust_mean
from service.backlash.results import AxisResult, Reason, StepResult
from service.recording import FloatArray, Recording

BoolArray = NDArray[np.bool_]

METHOD = "contact_regression"

START_FRACTION = 0.3
"""Part of the move left out at its start: the gap that the axis rested in must be crossed and rung out."""

MARGINS = ((0.002, 0.003), (0.002, 0.0015), (0.001, 0.0005))
"""Time kept clear before t1 and after t2 [s]; the first is used, the others are its rivals. Chosen: the
slack of the detection in `contact_steps`, see test_contact_regression."""

FLOOR = 0.3e-6
"""White error of D [m] beside the integrated noise: interpolated speed, what the equation lacks. Chosen."""

TYPICAL_C = 4e-6
"""Size of c = M/k [s²] with which the sensor's noise enters through the regressor a: 400 kg on 1e8 N/m."""

STRUCTURE = 0.02
"""Standard deviation of what the equation is worth, as a share of the backlash: a contact that hardens bends c·a.
Chosen from our own machines with impurities, see tests/benchmarks/accuracy.py."""

DEGREE = 7
"""Degree of the smooth course of one phase in `instruments`: the contact swings some periods after the impact."""

MIN_STEPS = 4
"""Fewer steps than this say nothing about their own scatter."""


@dataclass(frozen=True)
class Solution:
    """b : (steps,) [m] backlash of each step; shared : (4,) c, d, e, f of the module's equation."""

    b: FloatArray
    shared: FloatArray


def contact_masks(step: ContactStep, margin: tuple[float, float]) -> tuple[BoolArray, BoolArray]:
    """Samples surely in contact before the release and after the impact, (n,) bool each."""
    t0, end = step.time[0], step.time[-1]
    before = (step.time > t0 + START_FRACTION * (end - t0)) & (step.time < step.t1 - margin[0])
    after = (step.time > step.t2 + margin[1]) & (step.time < end - 0.06 * (end - t0))
    return before, after


def sampling_period(step: ContactStep) -> float:
    """Of the step's grid [s]."""
    return float(np.median(np.diff(step.time)))


def derivative_width(step: ContactStep) -> int:
    """Samples of the local parabola from which the load's derivatives come: 3 ms, an odd number."""
    return max(5, round(0.003 / sampling_period(step)) | 1)


def regressors(step: ContactStep, mask: BoolArray, order: int) -> FloatArray:
    """The shared regressors of one contact phase: (n, 2 + order), columns v, a, ȧ, ä.

    a is taken as measured: smoothing it would smear the steep rise after the impact, and its noise, times c
    of some 1e-6 s², is far below D's. The derivatives come from a local parabola over 3 ms inside the phase.
    """
    a, dt, width = step.a_mas[mask], sampling_period(step), derivative_width(step)
    slopes = [savgol_filter(a, width, 2, deriv=d, delta=dt) for d in range(1, order + 1)]
    return np.column_stack([step.v_mot[mask], a, *slopes])


def covariance(step: ContactStep, time: FloatArray) -> FloatArray:
    """Covariance of D's error at `time` (n,): (n, n) [m²].

    White noise of density q = σ²·dt integrated twice from rest, cov = q·(u³/3 + u²·(w − u)/2) for u < w, the
    mean removed at rest being itself uncertain, and a white floor for what the regressors carry.
    """
    dt = float(np.median(np.diff(step.time)))
    t = time - step.time[0]
    u, w = np.minimum.outer(t, t), np.maximum.outer(t, t)
    walk = step.noise**2 * dt * (u**3 / 3.0 + 0.5 * u**2 * (w - u))
    bias = step.noise**2 * dt / REST_BEFORE * np.multiply.outer(0.5 * t**2, 0.5 * t**2)
    return np.asarray(walk + bias + (FLOOR**2 + (TYPICAL_C * step.noise) ** 2) * np.eye(len(t)))


def instruments(step: ContactStep, before: BoolArray, after: BoolArray) -> FloatArray:
    """What moves with the regressors but does not carry the sensor's noise: (n, 2·(DEGREE + 1) + 2).

    The sensor's noise is in a and in D alike, which would pull c towards zero. The motor's speed and
    acceleration and a smooth course of time in each phase, the same in every step but for its sign, are free of it.
    """
    motor = np.gradient(step.v_mot, step.time)
    courses = []
    for mask in (before, after):
        t = step.time[mask]
        x = np.zeros((len(step.time), DEGREE + 1))
        x[mask] = step.s * chebvander(2.0 * (t - t[0]) / (t[-1] - t[0]) - 1.0, DEGREE)
        courses.append(x)
    return np.column_stack((step.v_mot, motor, *courses))[before | after]


def step_rows(step: ContactStep, margin: tuple[float, float], order: int) -> tuple[FloatArray, ...]:
    """Whitened rows of one step: own columns (n, 2) for b, x0; shared (n, 2 + order); instruments; D (n,)."""
    before, after = contact_masks(step, margin)
    side = np.where(before, 0.5, -0.5)[before | after] * step.s
    own = np.column_stack((side, np.ones(len(side))))
    X = np.vstack([regressors(step, mask, order) for mask in (before, after)])
    Z = instruments(step, before, after)
    root = np.linalg.cholesky(covariance(step, step.time[before | after]))
    parts = (own, X, Z, step.D[before | after])
    return tuple(solve_triangular(root, part, lower=True) for part in parts)


def usable(step: ContactStep, margin: tuple[float, float] = MARGINS[0]) -> bool:
    """Whether both contact phases of the step hold enough samples for the solve and for its derivatives."""
    least = max(10, derivative_width(step))
    return bool(np.isfinite(step.t1)) and all(
        int(np.sum(mask)) >= least for mask in contact_masks(step, margin)
    )


def solve(steps: Sequence[ContactStep], margin: tuple[float, float] = MARGINS[0], order: int = 2) -> Solution:
    """Solve for every step's b and x0 and the shared coefficients at once.

    The steps' own columns are projected out first (each step's problem is small); what is left is one
    two-stage least-squares problem for the shared coefficients: regressors on instruments, D on the result.
    """
    rows = [step_rows(step, margin, order) for step in steps]
    bases = [np.linalg.qr(own)[0] for own, *_ in rows]
    X, Z, D = (
        np.concatenate([row[k] - Q @ (Q.T @ row[k]) for Q, row in zip(bases, rows, strict=True)])
        for k in (1, 2, 3)
    )
    first_stage = Z @ np.linalg.lstsq(Z, X, rcond=1e-9)[0]
    shared = np.linalg.lstsq(first_stage, D, rcond=None)[0]
    b = [np.linalg.lstsq(own, D - X @ shared, rcond=None)[0][0] for own, X, _, D in rows]
    return Solution(np.array(b), shared)


def refused(axis: str, reason: Reason, detail: str, steps: tuple[StepResult, ...] = ()) -> AxisResult:
    """An axis without a value, and why."""
    return AxisResult(axis, "refused", METHOD, reason, detail, steps=steps)


def contact_steps(recording: Recording, axis: str) -> list[ContactStep]:
    """Every step of the axis whose two contact phases can be told apart."""
    speed = recording.trace(axis, "motor_speed")
    if speed is None or len(speed) < 4:
        return []
    v_mot = output_speed(speed, recording.axis(axis).transmission)
    cut = (contact_step(recording, axis, i, v_mot) for i in range(len(recording.moves)))
    return [step for step in cut if step is not None and usable(step)]


def contact_regression(recording: Recording, axis: str) -> AxisResult:
    """Backlash of one axis of a run in closed form, with a 95 % interval; refused when no gap is crossed.

    The interval holds the scatter of the steps and the spread over rival margins and regressors.
    """
    if not recording.moves:
        return refused(
            axis, Reason.NO_MOVES, "The recording holds no diagnostic step; command a run of steps."
        )
    for channel in ("motor_speed", "acceleration"):
        if recording.trace(axis, channel) is None:
            return refused(
                axis, Reason.CHANNEL_MISSING, f"The channel {channel} of {axis} was not recorded; map it."
            )
    if recording.partner(axis) is not None:
        return refused(
            axis,
            Reason.INTERVAL_TOO_WIDE,
            f"The pull of {recording.partner(axis)} over the bridge is not in this closed form and may pass for half "
            "the gap; take the joint fit of both axes (model_fit).",
        )
    steps = contact_steps(recording, axis)
    if len(steps) < min(MIN_STEPS, len(recording.moves)):
        return refused(
            axis,
            Reason.NO_RELEASE,
            f"Release and impact were found in {len(steps)} of {len(recording.moves)} steps; the load may not "
            "be driven by this motor, or the step is too slow for the gap: check the axis' wiring and the plan.",
        )
    return judged(axis, recording, steps)


def judged(axis: str, recording: Recording, steps: Sequence[ContactStep]) -> AxisResult:
    """Value, interval and step results from the steps that could be used."""
    found = solve(steps)
    value, error, kept = robust_mean(found.b)
    rivals = [robust_mean(solve(steps, m, order).b)[0] for m, order in zip(MARGINS, (1, 2, 2), strict=True)]
    half = half_width_95(float(np.hypot(error, STRUCTURE * value)), int(np.sum(kept)) - 1, rivals, value)
    results = step_results(recording, steps, found.b, kept)
    if value <= 0.0 or value < half:
        return refused(
            axis,
            Reason.GAP_NOT_CROSSED,
            f"Motor and load part by {value * 1e6:.1f} ± {half * 1e6:.1f} µm, not distinguishable from no gap; "
            "the flanks may stay in contact (brake, blocked carriage, preloaded drive): check that the axis "
            "moves freely.",
            results,
        )
    return AxisResult(
        axis, "ok", METHOD, backlash=value, interval_95=(value - half, value + half), steps=results
    )


def step_results(
    recording: Recording, steps: Sequence[ContactStep], b: FloatArray, kept: BoolArray
) -> tuple[StepResult, ...]:
    """One result per move of the recording, in order."""
    by_index = {step.index: k for k, step in enumerate(steps)}
    return tuple(
        one_step(i, move.direction, steps[by_index[i]], float(b[by_index[i]]), bool(kept[by_index[i]]))
        if i in by_index
        else StepResult(
            i,
            move.direction,
            "refused",
            Reason.NO_RELEASE,
            "No release and impact could be told apart in this step.",
        )
        for i, move in enumerate(recording.moves)
    )


def one_step(index: int, direction: int, step: ContactStep, b: float, kept: bool) -> StepResult:
    """The result of one step; an outlier among the steps is refused and leaves the mean alone."""
    if kept:
        return StepResult(index, direction, "ok", backlash=b, t1=step.t1, t2=step.t2)
    detail = f"{b * 1e6:.1f} µm lies far from the other steps; a disturbance during this step is likely."
    return StepResult(index, direction, "refused", Reason.STEPS_DISAGREE, detail)
