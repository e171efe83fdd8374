"""From a selection of effects in the acceleration channel to the verdict: name, numbers, evidence, predictions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from service.backlash.moves import Moves
from service.backlash.moves_fit import Fitted
from service.dynamics.effects.driven_transmission import TYPICAL_PUSH
from service.identification.explanation import (
    AxisExplanation,
    ErrorReport,
    Finding,
    Parameter,
    Prediction,
    SeparatingMove,
)
from service.identification.held_out import Explained, Held, rms
from service.identification.scene import Scene
from service.identification.selection import Selection, Trial, explained, gone, left, shown
from service.recording import FloatArray

LEFT_BY_CLEAN = 1.25
"""RMS over what is expected up to which what is left may be next to nothing (chosen)."""
SEARCHED = 1.15
"""RMS that shows from which on what is missing is searched for (chosen)."""
LEFT = 1.6
"""Held-out RMS over the noise up to which the named effects count as the whole explanation (chosen)."""
LEFT_BY_ONE = 3.0
"""The same for an effect that explains nearly all by itself: what it leaves is how its law differs from the machine's
(chosen)."""
SMALL, MATTERS = 1.6, (1e-6, 0.02)
"""What leaves no more than this RMS without it, and changes the backlash by less than so many metres or such a share,
is an impurity too small to matter, as long as it, named or not, leaves next to nothing; but an effect that alone
explains more than this, if only in the moves that were not fitted, is a finding, and so is one that is in no sound
machine and alone explains what shows in all moves (chosen)."""
LAW = 0.5
"""Standard deviation of where a bent flank begins to push, over its bend and the depth at which its force is the
sensor's noise. Chosen: what the law of its force is at smaller depths no sample shows, and the stronger it is bent, the
farther from each other the laws that are alike above."""


class Impurity(NamedTuple):
    """The number that says how much there is of something, the most that a sound machine has of it, the most where
    it is the whole explanation of more than impurities leave, and what it repeats in."""

    number: str
    most: float
    most_of_all: float
    period: str | None = None


COMMON: Mapping[str, Impurity] = {
    "transmission_ripple": Impurity("ripple_amplitude", np.inf, 3e-6, period="ripple_period"),
    "contact_nonlinearity": Impurity("bend", 0.2, 0.0),
}
"""What every rack and every flank has a little of, and what is therefore no finding where it does not change the
backlash. Steel on steel in line contact has a bend of 1/9; twice that is none. A mesh has no limit by itself: a slow
error may be large; 3 µm [m] are small. What repeats with the rack's teeth or more slowly is of its mesh."""
TOOTH = 3e-3
"""Pitch of the finest rack [m]: that of module 1. What repeats in less comes from within the transmission."""
SURELY = 2.0
"""Standard deviations by which a number is beyond what a sound machine has."""
CLEARLY = 0.75
"""Share of the excess variance that an effect explains by itself which is in no sound machine, shows in all moves and
leaves next to nothing in those that were not fitted (chosen)."""
WHOLLY = 0.98
"""Share from which on an effect is named whatever it leaves: it has predicted moves that nobody has fitted, and what is
left is how its law differs from the machine's (chosen)."""
CHANGED = 4.0
"""Held-out RMS from which on the machine is not what it was in the train recordings, however well it fits these: what
impurities too small to matter leave there is less, and so does what has its right name (chosen)."""
PART = 0.5
"""Share of the excess variance that has to be explained for a name: less is a part of something else (chosen)."""
CROSSED = 0.6
"""Share of a move at which its gap is crossed, about: after the top speed, at two thirds of the braking."""
STRUCTURE = (0.11e-6, 1.2e-3)
"""Standard deviation of what the structure is worth: floor [m] and share of the backlash, as in the estimator."""

SEEN_AT_REST = ("sensor_bias",)
"""What a zero that wanders while the axis rests is."""

SPLIT = 0.25
"""Standard deviation of how two gaps in series divide what they are together, as a share of that. Chosen: the fit has a
valley every few micrometres of the split, and the deepest is not always found."""


def verdict(scene: Scene, selection: Selection[Explained]) -> tuple[AxisExplanation, ...]:
    """One verdict per axis of the scene."""
    finding, effects = finding_of(selection, seen_at_rest=SEEN_AT_REST if scene.zero_wanders else ())
    if scene.clipped:
        finding, effects = "unknown", ()
    before = selection.before.model
    after = selection.after.model if finding == "effect" else before
    return tuple(
        AxisExplanation(
            axis=name,
            channel="acceleration",
            finding=finding,
            noise_rms=float(scene.validate.noise[a]),
            before=_report(before, a),
            after=_report(after, a),
            effects=effects,
            indistinguishable=selection.rivals if effects else (),
            separating_move=separating_move(selection, scene.validate)
            if effects and selection.rivals
            else None,
            candidates=tuple(
                replace(c, validation_rms=c.validation_rms * float(scene.validate.noise[a]))
                for c in selection.candidates
            ),
            parameters=_parameters(after.fitted, a),
            evidence=(*_over_range(scene, name), *_evidence(before.held, selection, finding, a)),
            predictions=(_prediction("before", before.held, a), _prediction("after", after.held, a)),
        )
        for a, name in enumerate(scene.validate.axes)
    )


def finding_of(
    selection: Selection[Explained], seen_at_rest: tuple[str, ...] = ()
) -> tuple[Finding, tuple[str, ...]]:
    """``effect`` only when the named effects leave near nothing: a part of an unknown is not an explanation. What was
    `seen_at_rest`, beside all moves, is no impurity that a fit may imagine."""
    before, after, effects = selection.before, selection.after, selection.effects
    nothing: Finding = "none" if _little(before) and left(after) <= LEFT_BY_CLEAN else "unknown"
    if not effects:
        return nothing, ()
    alone = len(effects) == 1 and explained(before, after)
    if not _matters(selection):
        seen = max(before.train_rms, before.validation_rms) > SMALL
        uncommon = not _common(selection) and left(before) > SEARCHED
        clearly = after.validation_rms <= LEFT_BY_CLEAN and explained(before, after, CLEARLY)
        clear = effects == seen_at_rest or (uncommon and len(effects) == 1 and clearly)
        if _little(before) and not (alone and seen) and not clear:
            return nothing, ()
        everything = before.validation_rms > CHANGED and shown(after) <= LEFT_BY_CLEAN
        if _common(selection, everything) and (alone or left(after) <= LEFT):
            return "none", ()
    error = left if len(effects) == 1 else shown
    near = error(after) <= (LEFT_BY_ONE if alone else LEFT) and after.validation_rms <= CHANGED
    wholly = alone and after.train_rms <= LEFT and explained(before, after, WHOLLY)
    if wholly or (near and explained(before, after, PART) and _fitted_too(before, after)):
        return "effect", effects
    return "unknown", ()


def _fitted_too(before: Trial[Explained], after: Trial[Explained]) -> bool:
    """Whether as large a part is gone from the moves that were fitted, or little is left there: what predicts other
    moves and leaves those that it was fitted to as they were is not what acts."""
    return gone(before.train_rms, after.train_rms, PART) or after.train_rms <= LEFT


def _common(selection: Selection[Explained], everything: bool = False) -> bool:
    """Whether all that was found is what every sound machine has, and as much as such a machine may have; less, and
    nothing quicker than teeth, where it explains `everything` of more than impurities leave."""
    if not COMMON.keys() >= set(selection.effects):
        return False
    numbers = _deviations(selection.after.model.fitted)
    for effect in selection.effects:
        impurity = COMMON[effect]
        periods = [both for name, both in numbers.items() if name.rpartition(".")[2] == impurity.period]
        if everything and any(value + SURELY * std < TOOTH for value, std in periods):
            return False
        most = impurity.most_of_all if everything else impurity.most
        of_axes = [both for name, both in numbers.items() if name.rpartition(".")[2] == impurity.number]
        if any(abs(value) - SURELY * std > most for value, std in of_axes):
            return False
    return True


def _matters(selection: Selection[Explained]) -> bool:
    """Whether what was found changes the backlash."""
    before, after = selection.before.model.fitted, selection.after.model.fitted
    floor, share = MATTERS
    return any(
        abs((now := backlash_of(after, axis)[0]) - backlash_of(before, axis)[0]) > max(floor, share * now)
        for axis in range(len(before.model.axes))
    )


def _little(trial: Trial[Explained]) -> bool:
    """Whether what the declared model leaves may be an impurity too small to matter."""
    return left(trial) <= SMALL and trial.validation_rms <= CHANGED


def _report(one: Explained, axis: int) -> ErrorReport:
    held, noise = one.held, float(one.held.moves.noise[axis])
    errors = held.errors[:, axis] * noise
    lagged = errors[:, :-1] * errors[:, 1:]
    train = _train_errors(one.fitted, axis)
    b, std = backlash_of(one.fitted, axis)
    std *= max(1.0, rms(held.weighed[:, axis]))
    return ErrorReport(
        train_rms=rms(train) * noise,
        validation_rms=rms(errors),
        normalised_rms=rms(errors)
        / max(rms(np.where(held.moves.used, held.moves.measured, np.nan)[:, axis]), 1e-300),
        whiteness=float(np.nanmean(lagged) / max(float(np.nanmean(errors**2)), 1e-300)),
        backlash=b,
        interval_95=(max(0.0, b - 1.96 * std), b + 1.96 * std),
    )


def _train_errors(found: Fitted, axis: int) -> FloatArray:
    """Residuals over the noise of one axis in all train recordings."""
    first, out = 0, []
    for part in found.moves:
        count = int(np.sum(part.used))
        of_axis = np.nonzero(part.used)[1] == axis
        over_noise = found.r[first : first + count] * part.expected[part.used]
        out.append(over_noise[of_axis])
        first += count
    return np.concatenate(out)


def covariance(found: Fitted) -> FloatArray:
    """(P, P) of the shared coordinates, robust against coloured residuals: moves are taken as the independent
    blocks (the sandwich of Huber and White), but never less than by white noise."""
    P = len(found.model.parameters)
    J = found.slopes.dense()
    H = np.linalg.inv(J.T @ J + np.eye(J.shape[1]))
    scores, first = [], 0
    for part in found.moves:
        move_of = np.nonzero(part.used)[0]
        rows = slice(first, first + len(move_of))
        weighted = J[rows] * found.r[rows, None]
        scores += [weighted[move_of == t].sum(axis=0) for t in range(len(part.grids))]
        first += len(move_of)
    meat = np.stack(scores).T @ np.stack(scores) * len(scores) / max(1, len(scores) - 1)
    sandwich, plain = (H @ meat @ H)[:P, :P], H[:P, :P] * max(1.0, found.rms**2)
    size = np.sqrt(np.maximum(np.diag(plain), np.diag(sandwich)) / np.maximum(np.diag(plain), 1e-300))
    return np.asarray(plain * np.outer(size, size))


def _deviations(found: Fitted) -> Mapping[str, tuple[float, float]]:
    """Value and standard deviation of every parameter in its unit."""
    spread = np.sqrt(np.diag(covariance(found)))
    names = [p.name for p in found.model.parameters]
    return {n: (found.value(n), abs(slope_of(found, k)) * float(spread[k])) for k, n in enumerate(names)}


def backlash_of(found: Fitted, axis: int) -> tuple[float, float]:
    """Backlash of an axis where its moves crossed the gap, and its standard deviation [m]."""
    name = found.model.axes[axis]
    names = [p.name for p in found.model.parameters]
    k, gradient = names.index(f"{name}.backlash"), np.zeros(len(names))
    b, gradient[k] = found.value(names[k]), slope_of(found, k)
    if f"{name}.gap_slope" in names:  # the gap is then that of the place where the recording began
        k, place = names.index(f"{name}.gap_slope"), crossing(found, axis)
        b, gradient[k] = b + found.value(names[k]) * place, slope_of(found, k) * place
    floor, share = STRUCTURE
    laws = (SPLIT * clearance_beside(found, axis)) ** 2 + (LAW * unseen_depth(found, axis)) ** 2
    variance = float(gradient @ covariance(found) @ gradient) + laws
    return b, float(np.hypot(np.sqrt(variance), max(1.0, found.rms) * np.hypot(floor, share * b)))


def clearance_beside(found: Fitted, axis: int) -> float:
    """The backlash and a second gap in series with it together [m]; 0 where there is none."""
    name = found.model.axes[axis]
    if f"{name}.clearance" not in {p.name for p in found.model.parameters}:
        return 0.0
    return found.value(f"{name}.backlash") + found.value(f"{name}.clearance")


def unseen_depth(found: Fitted, axis: int) -> float:
    """How deep a bent flank is pressed [m] until its force is the sensor's noise, times its bend; 0 where it is not
    bent."""
    name = found.model.axes[axis]
    if f"{name}.bend" not in {p.name for p in found.model.parameters}:
        return 0.0
    bend, k = found.value(f"{name}.bend"), found.value(f"{name}.contact_stiffness")
    noise = float(found.moves[0].noise[axis])
    return abs(bend) * TYPICAL_PUSH / k * float((noise / TYPICAL_PUSH) ** (1.0 / (1.0 + bend)))


def crossing(found: Fitted, axis: int) -> float:
    """Where the gap is crossed [m] from where the recording began, on average: at CROSSED of a move's duration."""
    places = []
    for part in found.moves:
        for grid in part.grids:
            move = part.recording.moves[grid.index]
            places.append(float(part.plain[axis](move.start + CROSSED * move.duration)))
    return float(np.mean(places))


def slope_of(found: Fitted, k: int) -> float:
    """Derivative of a parameter with respect to its coordinate."""
    p, u = found.model.parameters[k], found.at.shared[k]
    return float((p.value(u + 1e-4) - p.value(u - 1e-4)) / 2e-4)


def _parameters(found: Fitted, axis: int) -> dict[str, Parameter]:
    """Effects' own parameters first, then the declared model's; forces and stiffnesses per moved mass."""
    values, units = _deviations(found), {p.name: p.unit for p in found.model.parameters}
    own = [p.name for effect in found.model.effects[1:] for p in effect.parameters]
    other = [name for name in values if name not in own]
    out = {}
    for name in (*own, *other):
        of, _, short = name.rpartition(".")
        if of in ("", found.model.axes[axis]):
            unit = units[name]
            out[short + ("_s" if unit == "s" else "")] = Parameter(*values[name], unit)
    return out


def _prediction(which: str, held: Held, axis: int) -> Prediction:
    """At the capture's own time stamps: every sample of a move lies in one interval of the grid."""
    moves, times, values = held.moves, [], []
    trace = moves.recording.traces[moves.axes[axis], "acceleration"]
    for t, grid in enumerate(moves.grids):
        move = moves.recording.moves[grid.index]
        part = trace.between(move.start, move.end)
        at = np.clip(np.floor((part.time - grid.start) / grid.h).astype(int), 0, moves.samples - 1)
        times.append(part.time)
        values.append(held.predicted[t, axis, at] + moves.bias[t, axis])
    return Prediction(
        "before" if which == "before" else "after", np.concatenate(times), np.concatenate(values)
    )


def _over_range(scene: Scene, axis: str) -> tuple[str, ...]:
    """What says that an accelerometer was over its range, if this one was."""
    if axis not in scene.clipped:
        return ()
    return (
        "the accelerometer stays at an end of its range: the steps are harder than it can measure, and nothing was "
        "searched for. Choose a larger range, or step with a smaller jerk, and record again",
    )


def _shares(moves: Moves) -> FloatArray:
    """(T, K) how far each sample's move has gone."""
    out = []
    for grid in moves.grids:
        move = moves.recording.moves[grid.index]
        out.append((grid.time[:-1] + 0.5 * grid.h - move.start) / move.duration)
    return np.stack(out)


def _evidence(held: Held, selection: Selection[Explained], finding: Finding, axis: int) -> tuple[str, ...]:
    noise = held.moves.noise[axis]
    errors, share = held.errors[:, axis] * noise, _shares(held.moves)
    parts = [rms(errors[(share >= k / 5) & (share < (k + 1) / 5)]) for k in range(5)]
    worst = int(np.argmax(parts))
    lines = [
        f"residual of the declared model: {rms(errors):.4g} m/s² against a noise of {noise:.4g}",
        f"largest between {20 * worst} and {20 * worst + 20} % of the move ({parts[worst]:.4g} m/s²)",
    ]
    for word, d in (("positive", 1.0), ("negative", -1.0)):
        if np.any(held.moves.s == d):
            of = errors[held.moves.s == d]
            lines.append(f"{word} moves: {rms(of):.4g} m/s², mean {float(np.nanmean(of)):.3g}")
    lines.append(f"strongest frequency in the residual: {_frequency(errors, held.moves.h):.0f} Hz")
    if len(held.moves.axes) == 2:
        other = held.errors[:, 1 - axis] * held.moves.noise[1 - axis]
        known = np.isfinite(errors) & np.isfinite(other)
        tie = float(np.corrcoef(errors[known], other[known])[0, 1])
        lines.append(f"correlation with the partner's residual: {tie:.2f}")
    lines.append(
        "where the pinion stands in its gap, and what swings there, is found again in the first 45 % of every held-out "
        "move; the sensor's zero at rest, or as the mean of the recording where something swings in the rests"
    )
    if selection.before.model.fitted.model.bridge and len(held.moves.axes) == 2:
        lines.append(
            "where the two motors stand to each other when the bridge pulls on neither side is one number of a "
            "recording, found again in four whole held-out moves"
        )
    if finding == "effect":
        after = selection.after.model.held
        lines.append(
            f"residual with {' and '.join(selection.effects)}: {rms(after.errors[:, axis]) * noise:.4g} m/s²; "
            f"{announced(after, axis) * noise:.4g} is to be expected of the right model, by the noise of both sensors "
            "and by what the moves that were fitted do not tell of its numbers"
        )
    both = clearance_beside(selection.after.model.fitted, axis)
    if finding == "effect" and both:
        lines.append(
            f"the two gaps are {1e6 * both:.1f} µm together; how they divide between flanks and gearbox these moves "
            "hardly tell: hold the motor and turn the pinion by hand to measure the gearbox alone"
        )
    if finding == "unknown" and selection.effects:
        lines.append(f"{', '.join(selection.effects)} explain a part, but not enough to be named")
    return tuple(lines)


def announced(held: Held, axis: int) -> float:
    """RMS over the sensor's noise that is expected of the errors in the held-out moves of an axis if the model is
    right: the noise of the motor's speed moves the load, too, and numbers are known as well as the moves tell them."""
    expected = held.moves.expected[:, axis] * np.hypot(1.0, held.doubted[:, axis])
    return rms(np.where(held.moves.used[:, axis], expected, np.nan))


def _frequency(errors: FloatArray, h: float) -> float:
    """Frequency [Hz] of the strongest line in the residuals of all moves (T, K)."""
    clean = np.nan_to_num(errors)
    power = np.sum(np.abs(np.fft.rfft(clean * np.hanning(clean.shape[1]), 4096, axis=1)) ** 2, axis=0)
    return float(np.fft.rfftfreq(4096, h)[1:][np.argmax(power[1:])])


def separating_move(selection: Selection[Explained], moves: Moves) -> SeparatingMove:
    """The move that would tell the first pair of rivals apart, from the move that was made.

    What depends on speed or on time shows in another jerk, what depends on direction in two moves the same way,
    what depends on position in a longer travel.
    """
    move, pair = moves.recording.moves[0], set(selection.rivals[0])
    text = f"{' and '.join(selection.rivals[0])} explain these moves alike; "
    if pair & {"position_dependent_force", "position_dependent_backlash", "transmission_ripple"}:
        why = text + "only one changes along the travel"
        return SeparatingMove(4 * move.length, move.jerk, 1, "along the whole travel", why)
    if pair <= {"constant_force", "asymmetric_friction"}:
        why = text + "a slow reversal keeps a force and turns friction over"
        return SeparatingMove(move.length, move.jerk / 4, -1, "as before", why)
    if pair <= {"sensor_latency", "speed_filter"}:
        why = text + "a sharper step is delayed by both, and flattened by a filter only"
        return SeparatingMove(move.length, 2 * move.jerk, 1, "as before", why)
    why = text + "a slower, longer move changes speed against acceleration"
    return SeparatingMove(2 * move.length, move.jerk / 4, 1, "as before", why)
