"""From a selection of effects in the acceleration channel to the verdict: name, numbers, evidence, predictions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from service.backlash.moves_fit import Fitted
from service.dynamics.effects.driven_library import DRIVEN
from service.identification.axis_evidence import evidence_of, over_range, separating_move
from service.identification.axis_numbers import apart_in_time, backlash_of, deviations
from service.identification.explanation import (
    AxisExplanation,
    ErrorReport,
    Finding,
    Parameter,
    Prediction,
)
from service.identification.held_out import SEARCHED, SEEN_AT_REST, Explained, Held, overdamped, rms
from service.identification.moves_motors import CONTRADICTED, PLAINLY, left_by_motors, plainly_against
from service.identification.scene import Scene
from service.identification.selection import (
    CHANGED,
    LEFT,
    LEFT_BY_CLEAN,
    PART,
    UNKNOWN_NUMBERS,
    WHOLLY,
    Selection,
    Trial,
    distance,
    explained,
    gone,
    gone_from_all,
    left,
    shown,
    sole_fit,
)
from service.recording import FloatArray

LEFT_BY_ONE = 3.0
"""The same for an effect that explains nearly all by itself: what it leaves is how its law differs from the machine's
(chosen)."""
SMALL, MATTERS = 1.6, (1e-6, 0.02)
"""What leaves no more than this RMS without it, and changes the backlash by less than so many metres or such a share,
is an impurity too small to matter, as long as it, named or not, leaves next to nothing; but an effect that alone
explains more than this, if only in the moves that were not fitted, is a finding, and so is one that is in no sound
machine and alone explains what shows in all moves (chosen)."""


class Impurity(NamedTuple):
    """The number that says how much there is of something, the most that a sound machine has of it, the most where
    it is the whole explanation of more than impurities leave, and what it repeats in; of what repeats, that is a share
    of the period."""

    number: str
    most: float
    most_of_all: float
    period: str | None = None


COMMON: Mapping[str, Impurity] = {
    "transmission_ripple": Impurity("ripple_amplitude", np.inf, 1e-3, period="ripple_period"),
    "contact_nonlinearity": Impurity("bend", 0.2, 0.0),
    "hung_mass_mode": Impurity("hung_ratio", 0.02, 0.0),
    "machine_body_mode": Impurity("body_ratio", 0.02, 0.0),
    "constant_force": Impurity("constant_force", 0.02, 0.0),
}
"""What every rack, flank, carriage and bed has a little of, and what is therefore no finding where it does not change
the backlash. Steel on steel in line contact has a bend of 1/9; twice that is none. Hoses, chains and covers of a
fiftieth of the load hang elastically on every carriage, and a body fifty times as heavy hardly moves. A bed that
falls by 2 mm in a metre is level enough to run, and pulls with a fiftieth of a m/s². A mesh has no
limit by itself: a slow error may be large; a thousandth of the pitch is small. What repeats with the rack's teeth or
more slowly is of its mesh."""
OF_SOUND = 2.0
"""How many times as much as matters that must change the backlash which is no more than a sound machine has (chosen):
found as it is, it is no finding as long as the backlash hardly changes."""
TOOTH = 3e-3
"""Pitch of the finest rack [m]: that of module 1. What repeats in less comes from within the transmission."""
SURELY = 2.0
"""Standard deviations by which a number is beyond what a sound machine has."""
CLEARLY = 0.75
"""Share of the excess variance in the moves that were fitted and in those that were not that an effect explains by
itself which is in no sound machine, and shows in all moves; it leaves next to nothing, or there was more to explain
than impurities leave (chosen)."""


def verdict(
    scene: Scene,
    selection: Selection[Explained],
    accepted: tuple[str, ...] = (),
    absent: tuple[str, ...] = (),
) -> tuple[AxisExplanation, ...]:
    """One verdict per axis of the scene: on what is missing beyond the effects that were `accepted` before the search;
    those that the moves do not show are `absent`."""
    seen_at_rest = SEEN_AT_REST if scene.zero_wanders else ()
    finding, effects = finding_of(selection, seen_at_rest, LEFT if accepted else LEFT_BY_CLEAN)
    if scene.clipped:
        finding, effects = "unknown", ()
    model = "accepted" if accepted else "declared"
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
            evidence=(*over_range(scene, name), *evidence_of(before.held, selection, finding, a, model)),
            predictions=(_prediction("before", before.held, a), _prediction("after", after.held, a)),
            accepted=accepted,
            absent=absent,
        )
        for a, name in enumerate(scene.validate.axes)
    )


def finding_of(
    selection: Selection[Explained], seen_at_rest: tuple[str, ...] = (), sound: float = LEFT_BY_CLEAN
) -> tuple[Finding, tuple[str, ...]]:
    """``effect`` only when the named effects leave near nothing: a part of an unknown is not an explanation.

    What was `seen_at_rest`, beside all moves, is no impurity that a fit may imagine, and has its name where the moves
    that were fitted are described with it, however far from the others a chain is that is not known well. A model that
    leaves no more than `sound` may lack nothing, and one that leaves a little more only impurities, if nothing that is
    tried in their place changes the backlash, and if its channels need not be apart in time nor its chain be damped as
    none is, and neither the motors contradict it nor another channel hints at it, and no law that no such effect has
    explains what is missing. What another channel is the witness of has been judged by that.
    """
    before, after, effects = selection.before, selection.after, selection.effects
    if effects and effects == selection.witnessed:
        return "effect", effects
    sound = max(sound, SMALL) if _undisputed(selection) else sound
    usual = _in_time(before) and _usual(before) and not _contradicted(before)
    sound_enough = _little(before) and left(after) <= sound and usual
    of_library = not (selection.hinted or _of_no_library(selection))
    nothing: Finding = "none" if sound_enough and of_library else "unknown"
    if not effects or (_little(before) and _common_suffices(selection)):
        return nothing, ()
    if not _matters(selection):
        if _little(before) and not _clear(selection, seen_at_rest):
            return nothing, ()
        if _of_every_machine(selection):
            return "none", ()
    return ("effect", effects) if _explanation(selection, seen_at_rest) else ("unknown", ())


def _clear(selection: Selection[Explained], seen_at_rest: tuple[str, ...]) -> bool:
    """Whether what was found is a finding although little is missing and the backlash stays: it was seen at rest; alone
    it explains what shows in the moves that were fitted; or it is in no sound machine, explains all moves by itself,
    which show something or whose motors contradict the model without it, and nothing else does or comes near."""
    before, after, effects = selection.before, selection.after, selection.effects
    seen = shown(before) > SMALL
    if effects == seen_at_rest or (seen and _alone(selection)):
        return True
    clearly = gone_from_all(before, after, CLEARLY)
    whole = len(effects) == 1 and clearly and (seen or after.validation_rms <= LEFT_BY_CLEAN)
    uncommon = not _common(selection) and (left(before) > SEARCHED or _reconciles_motors(selection))
    if uncommon and whole and not _common_comes_as_near(selection):
        return True
    return _alone(selection) and _nothing_else_explains(selection)


def _reconciles_motors(selection: Selection[Explained]) -> bool:
    """Whether the motors contradict the model before, and no longer the one with what was found: what no sample of the
    moves that were fitted shows acts all the same."""
    before, after = (
        float(np.max(left_by_motors(t.model.fitted))) for t in (selection.before, selection.after)
    )
    return after <= CONTRADICTED < before


def _against_motors(selection: Selection[Explained]) -> bool:
    """Whether the moves that were not fitted are not described with what was found, and the motors speak against it."""
    foretold = selection.after.validation_rms <= LEFT_BY_CLEAN
    return not foretold and plainly_against(selection.before, selection.after)


def _of_every_machine(selection: Selection[Explained]) -> bool:
    """Whether what was found is what every sound machine has, and leaves next to nothing, also in the moves that were
    not fitted, or explains a part of what is missing there; if it explains nearly all by itself, no more than its law
    leaves that differs from the machine's."""
    before, after = selection.before, selection.after
    by_law = left(after) <= LEFT_BY_ONE and max(after.train_rms, after.validation_rms) <= CHANGED
    everything = before.validation_rms > CHANGED and shown(after) <= LEFT_BY_CLEAN
    foretold = shown(after) <= LEFT or explained(before, after, PART)
    whole = (_alone(selection) and by_law) or (left(after) <= LEFT and foretold)
    return whole and _common(selection, everything)


def _explanation(selection: Selection[Explained], seen_at_rest: tuple[str, ...]) -> bool:
    """Whether the effects leave near nothing, or predict nearly all that is missing in moves that nobody has fitted, or
    one of them alone describes those that were and predicts the others no worse; none whose numbers went to where no
    such effect is when its fit was ended, or that the motors speak against."""
    before, after, effects = selection.before, selection.after, selection.effects
    if after.at_limits or _against_motors(selection):
        return False
    alone, certain = _alone(selection), effects == seen_at_rest and explained(before, after, PART)
    if after.train_rms <= LEFT and (certain or (alone and explained(before, after, WHOLLY))):
        return True
    if effects == (_sole(selection),) and after.validation_rms <= min(CHANGED, before.validation_rms):
        return True
    error = left if len(effects) == 1 else shown
    exact = any(DRIVEN[name].exact for name in effects if name in DRIVEN)
    near = error(after) <= (LEFT_BY_ONE if alone and not exact else LEFT)
    near = near and max(after.train_rms, after.validation_rms) <= CHANGED
    return near and explained(before, after, PART) and _fitted_too(before, after)


def _sole(selection: Selection[Explained]) -> str | None:
    """The one effect that describes the moves that were fitted, where impurities leave more, and none else does."""
    trials = {trial.model.fitted.model.effects[-1].name: trial for trial in selection.tried}
    return sole_fit(selection.before, trials, SMALL)


def _alone(selection: Selection[Explained]) -> bool:
    """Whether one effect explains nearly all by itself."""
    return len(selection.effects) == 1 and explained(selection.before, selection.after)


def _fitted_too(before: Trial[Explained], after: Trial[Explained]) -> bool:
    """Whether as large a part is gone from the moves that were fitted, or next to nothing is left there, or little in
    all: what predicts other moves and leaves those that it was fitted to as they were is not what acts."""
    little = after.train_rms <= LEFT_BY_CLEAN or max(after.train_rms, after.validation_rms) <= LEFT
    return little or gone(before.train_rms, after.train_rms, PART)


def _common(selection: Selection[Explained], everything: bool = False) -> bool:
    """Whether all that was found is what every sound machine has, and as much as such a machine may have; less, and
    nothing quicker than teeth, where it explains `everything` of more than impurities leave."""
    if not COMMON.keys() >= set(selection.effects):
        return False
    numbers = deviations(selection.after.model.fitted)
    for effect in selection.effects:
        impurity = COMMON[effect]
        periods = [both for name, both in numbers.items() if name.rpartition(".")[2] == impurity.period]
        if everything and any(value + SURELY * std < TOOTH for value, std in periods):
            return False
        per = min((value for value, _ in periods), default=1.0)
        most = per * impurity.most_of_all if everything else impurity.most
        of_axes = [both for name, both in numbers.items() if name.rpartition(".")[2] == impurity.number]
        if any(abs(value) - SURELY * std > most for value, std in of_axes):
            return False
    return True


def _common_comes_as_near(selection: Selection[Explained]) -> bool:
    """Whether something that every sound machine has, as much as one may have, comes as near to all moves as what was
    found: then that is the likelier explanation."""
    near = (trial for trial in selection.tried if distance(trial) <= distance(selection.after))
    return any(_is_common(selection, trial) for trial in near)


def _common_suffices(selection: Selection[Explained]) -> bool:
    """Whether beside an effect whose law has many valleys, and imitates much, something that every sound machine has,
    as much as one may have, leaves next to nothing in all moves: then nothing else need be there."""
    if not any(DRIVEN[name].many_valleys for name in selection.effects if name in DRIVEN):
        return False
    return any(
        max(trial.train_rms, trial.validation_rms) <= LEFT_BY_CLEAN
        and not trial.at_limits
        and explained(selection.before, trial, PART)
        and _is_common(selection, trial)
        for trial in selection.tried
    )


def _is_common(selection: Selection[Explained], trial: Trial[Explained]) -> bool:
    """Whether the effect of a trial is what every sound machine has, and as much as one may have."""
    return _common(_of(selection, trial))


def _of(selection: Selection[Explained], trial: Trial[Explained]) -> Selection[Explained]:
    """The selection as if one that was tried had been taken, and nothing else."""
    return replace(selection, effects=(trial.model.fitted.model.effects[-1].name,), after=trial)


def _nothing_else_explains(selection: Selection[Explained]) -> bool:
    """Whether one effect that is in no sound machine predicts all that is missing in the held-out moves, or leaves
    nothing that would be searched for, and nothing else that was tried predicts a part of it: impurities are explained
    in part by much."""
    before, after, effects = selection.before, selection.after, selection.effects
    others = [t for t in selection.tried if t.model.fitted.model.effects[-1].name not in effects]
    predicted = explained(before, after, WHOLLY) or shown(after) <= SEARCHED
    whole = max(after.train_rms, after.validation_rms) <= LEFT_BY_CLEAN and predicted
    if _common(selection) or not whole or before.validation_rms <= UNKNOWN_NUMBERS:
        return False
    return bool(others) and not any(explained(before, other, PART) for other in others)


def _matters(selection: Selection[Explained]) -> bool:
    """Whether what was found changes the backlash, and clearly so if a sound machine may have as much of it."""
    before, after = selection.before.model.fitted, selection.after.model.fitted
    limited = all(np.isfinite(COMMON[name].most) for name in selection.effects if name in COMMON)
    times = OF_SOUND if limited and _common(selection) else 1.0
    floor, share = MATTERS
    return any(
        abs((now := backlash_of(after, axis)[0]) - backlash_of(before, axis)[0])
        > times * max(floor, share * now)
        for axis in range(len(before.model.axes))
    )


def _of_no_library(selection: Selection[Explained]) -> bool:
    """Whether what explains nearly all that is missing in the held-out moves, leaves next to nothing in all, and
    changes the backlash, is no such effect by the limits that its numbers are at: something acts that no library has,
    however little of it shows in the moves that were fitted."""
    before = selection.before
    return any(
        trial.at_limits
        and max(trial.train_rms, trial.validation_rms) <= LEFT_BY_CLEAN
        and explained(before, trial)
        and _matters(_of(selection, trial))
        for trial in selection.tried
    )


def _undisputed(selection: Selection[Explained]) -> bool:
    """Whether all models that were tried and come as near to all moves say the same backlash, as far as it matters and
    they know."""
    floor, share = MATTERS
    near = [t for t in selection.tried if distance(t) <= distance(selection.before)]
    for axis in range(len(selection.before.model.fitted.model.axes) if near else 0):
        b = backlash_of(selection.before.model.fitted, axis)[0]
        for other, std in (backlash_of(t.model.fitted, axis) for t in near):
            if abs(other - b) > max(floor, share * b) + SURELY * std:
                return False
    return bool(near)


def _little(trial: Trial[Explained]) -> bool:
    """Whether what the declared model leaves may be an impurity too small to matter."""
    return left(trial) <= SMALL and trial.validation_rms <= CHANGED


def _in_time(trial: Trial[Explained]) -> bool:
    """Whether no channels need be apart in time for it, more than those of a measurement are."""
    found = trial.model.fitted
    return not any(apart_in_time(found, axis) for axis in range(len(found.model.axes)))


def _contradicted(trial: Trial[Explained]) -> bool:
    """Whether a model leaves more of other moves than numbers do that are not known well, and the motors contradict it
    plainly: one that is wrong may describe the moves that it was fitted to."""
    by_motors = float(np.max(left_by_motors(trial.model.fitted)))
    return shown(trial) > LEFT and by_motors > PLAINLY * max(1.0, trial.train_rms)


def _usual(trial: Trial[Explained]) -> bool:
    """Whether no chain need be damped for it as none is, or it leaves next to nothing."""
    return left(trial) <= LEFT_BY_CLEAN or not overdamped(trial.model.fitted)


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
        expected_rms=float(one.announced[axis]) * noise,
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


def _parameters(found: Fitted, axis: int) -> dict[str, Parameter]:
    """Effects' own parameters first, then the declared model's; forces and stiffnesses per moved mass."""
    values, units = deviations(found), {p.name: p.unit for p in found.model.parameters}
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
    for t, (grid, move) in enumerate(zip(moves.grids, moves.made, strict=True)):
        part = trace.between(move.start, move.end)
        at = np.clip(np.floor((part.time - grid.start) / grid.h).astype(int), 0, moves.samples - 1)
        times.append(part.time)
        values.append(held.predicted[t, axis, at] + moves.bias[t, axis])
    return Prediction(
        "before" if which == "before" else "after", np.concatenate(times), np.concatenate(values)
    )
