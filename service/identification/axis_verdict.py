"""From a selection of effects in the acceleration channel to the verdict: name, numbers, evidence, predictions."""

from __future__ import annotations

import numpy as np

from service.identification.axis_fit import Fit, errors, fit, jacobian, rms
from service.identification.axis_problem import AxisProblem
from service.identification.axis_search import judged, zeros_found
from service.identification.explanation import (
    AxisExplanation,
    ErrorReport,
    Finding,
    Parameter,
    Prediction,
    SeparatingMove,
)
from service.identification.selection import Selection, Trial
from service.recording import FloatArray

CLEAN = 1.3
EXPLAINED = 0.97
"""Share of the excess variance that the named effects must explain, unless the rest is near the noise."""
NEAR_NOISE = 2.0
"""Held-out RMS over the noise up to which a named effect counts as the explanation (chosen)."""
WIDENED = 3.0
"""By how much the fit's own standard deviation is widened: it knows nothing of structure and of other valleys."""


def verdict(
    train: AxisProblem, held_out: AxisProblem, selection: Selection[Fit]
) -> tuple[AxisExplanation, ...]:
    """One verdict per axis of the problem."""
    before, after = _states(train, held_out, selection.before), _states(train, held_out, selection.after)
    finding, effects = _finding(selection)
    if finding != "effect":
        after = before
    return tuple(
        AxisExplanation(
            axis=name,
            channel="acceleration",
            finding=finding,
            noise_rms=float(held_out.noise[a]),
            before=_report(before, a),
            after=_report(after, a),
            effects=effects,
            indistinguishable=selection.rivals if effects else (),
            separating_move=separating_move(selection, train) if effects and selection.rivals else None,
            candidates=selection.candidates,
            parameters=_parameters(after, a),
            evidence=_evidence(before, selection, finding, a),
            predictions=(_prediction("before", before, a), _prediction("after", after, a)),
        )
        for a, name in enumerate(held_out.axes)
    )


def _finding(selection: Selection[Fit]) -> tuple[Finding, tuple[str, ...]]:
    """``effect`` only when the named effects leave near nothing: a part of an unknown is not an explanation."""
    before, after = selection.before.validation_rms, selection.after.validation_rms
    if not selection.effects:
        return ("none" if before <= CLEAN else "unknown"), ()
    excess = (after**2 - 1.0) / max(before**2 - 1.0, 1e-12)
    if after <= NEAR_NOISE or excess <= 1.0 - EXPLAINED:
        return "effect", selection.effects
    return "unknown", ()


class _States:
    """A fitted model on train and on the held-out recording, with the covariance of its numbers."""

    def __init__(self, train: AxisProblem, held_out: AxisProblem, found: Fit) -> None:
        self.train, self.held_out = train, held_out
        same = len(found.offsets) == len(train.moves)
        self.fitted = found if same else fit(train, zeros_found(train, found.model), 2)
        self.judged = judged(held_out, found, train, 0.5)
        self.train_errors, self.errors = errors(train, self.fitted), errors(held_out, self.judged)
        n = len(found.model.z)
        r, J = jacobian(train, self.fitted, range(n))
        J = np.nan_to_num(J)
        spread = np.linalg.pinv(J.T @ J / max(1.0, rms(r) ** 2) + np.eye(J.shape[1]))
        self.std_z = WIDENED * np.sqrt(np.maximum(np.diag(spread)[:n], 0.0))

    def of_axis(self, problem: AxisProblem, values: FloatArray, axis: int) -> FloatArray:
        """The part of a residual that belongs to one axis, in m/s²."""
        edges = np.cumsum([0, *(len(s.time) for s in problem.samples)])
        return np.asarray(values[edges[axis] : edges[axis + 1]] * problem.noise[axis])


def _states(train: AxisProblem, held_out: AxisProblem, one: Trial[Fit]) -> _States:
    with np.errstate(all="ignore"):
        return _States(train, held_out, one.model)


def _report(state: _States, axis: int) -> ErrorReport:
    held = state.of_axis(state.held_out, state.errors, axis)
    b, std = _value(state, "backlash", axis)
    return ErrorReport(
        train_rms=rms(state.of_axis(state.train, state.train_errors, axis)),
        validation_rms=rms(held),
        normalised_rms=rms(held) / max(rms(state.held_out.samples[axis].value), 1e-300),
        whiteness=float(np.corrcoef(held[:-1], held[1:])[0, 1]),
        backlash=b,
        interval_95=(max(0.0, b - 1.96 * std), b + 1.96 * std),
    )


def _value(state: _States, name: str, axis: int) -> tuple[float, float]:
    """One number of the fitted model with its standard deviation."""
    model = state.fitted.model
    index = next(k for k in model.index(name) if model.coordinates[k].axis in (axis, None))
    c, z = model.coordinates[index], model.z[index]
    value = float(c.value(np.array([z]))[0])
    slope = value * c.spread if c.logarithmic else c.spread
    return value, abs(float(slope * state.std_z[index]))


def _parameters(state: _States, axis: int) -> dict[str, Parameter]:
    """Effects' own parameters first, then the declared model's; forces and stiffnesses per moved mass."""
    model = state.fitted.model
    own = [c for c in model.coordinates if c.axis in (axis, None)]
    declared = 9
    found = {}
    for c in [*own[declared:], *own[:declared]]:
        name = c.name + ("_s" if c.unit == "s" else "")
        found[name] = Parameter(*_value(state, c.name, axis), c.unit)
    return found


def _prediction(which: str, state: _States, axis: int) -> Prediction:
    samples = state.held_out.samples[axis]
    value = samples.value - state.of_axis(state.held_out, state.errors, axis)
    return Prediction("before" if which == "before" else "after", samples.time, value)


def _evidence(before: _States, selection: Selection[Fit], finding: Finding, axis: int) -> tuple[str, ...]:
    held = before.of_axis(before.held_out, before.errors, axis)
    samples = before.held_out.samples[axis]
    moves = before.held_out.moves
    direction = np.array([m.direction for m in moves])[samples.window]
    share = (samples.time - np.array([m.start for m in moves])[samples.window]) / np.array(
        [m.duration for m in moves]
    )[samples.window]
    worst = int(np.argmax([rms(held[(share >= k / 5) & (share < (k + 1) / 5)]) for k in range(5)]))
    lines = [
        f"residual of the declared model: {rms(held):.4g} m/s² against a noise of {before.held_out.noise[axis]:.4g}",
        f"largest between {20 * worst} and {20 * worst + 20} % of the move",
        *(f"{word} moves: {rms(held[direction == d]):.4g} m/s²" for word, d in (("positive", 1), ("negative", -1))
          if (direction == d).any()),
        "where the pinion stands in its gap is found again in the first half of every held-out move",
    ]  # fmt: skip
    if finding == "unknown" and selection.effects:
        lines.append(f"{', '.join(selection.effects)} explain a part, but not enough to be named")
    return tuple(lines)


def separating_move(selection: Selection[Fit], problem: AxisProblem) -> SeparatingMove:
    """The move that would tell the first pair of rivals apart, from the move that was made.

    What depends on speed or on time shows in another jerk, what depends on direction in two moves the same way,
    what depends on position in a longer travel.
    """
    move, pair = problem.moves[0], set(selection.rivals[0])
    text = f"{' and '.join(selection.rivals[0])} explain these moves alike; "
    if pair & {"position_dependent_force", "position_dependent_backlash", "transmission_ripple"}:
        return SeparatingMove(
            4 * move.length,
            move.jerk,
            1,
            "along the whole travel",
            text + "only one changes along the travel",
        )
    if pair <= {"constant_force", "asymmetric_friction"}:
        return SeparatingMove(
            move.length,
            move.jerk / 4,
            -1,
            "as before",
            text + "a slow reversal keeps a force and turns friction over",
        )
    return SeparatingMove(
        2 * move.length,
        move.jerk / 4,
        1,
        "as before",
        text + "a slower, longer move changes speed against acceleration",
    )
