"""From a selection of effects in the acceleration channel to the verdict: name, numbers, evidence, predictions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from service.dynamics.effects.driven_library import DRIVEN
from service.identification.axis_common import (
    COMMON,
    LEFT_BY_ONE,
    SURELY,
    by_itself,
    common,
    common_comes_as_near,
    common_suffices,
    indistinguishable,
    of_every_machine,
    taken_instead,
)
from service.identification.axis_evidence import evidence_of, over_range, separating_move
from service.identification.axis_numbers import apart_in_time, backlash_of
from service.identification.axis_report import parameters, prediction, report
from service.identification.explanation import AxisExplanation, Finding
from service.identification.held_out import SEARCHED, SEEN_AT_REST, Explained, overdamped
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
    left,
    most_left,
    shown,
    sole_fit,
)

SMALL, MATTERS = 1.6, (1e-6, 0.02)
"""What leaves no more than this RMS without it, and changes the backlash by less than so many metres or such a share,
is an impurity too small to matter, as long as it, named or not, leaves next to nothing; but an effect that alone
explains more than this, if only in the moves that were not fitted, is a finding, and so is one that is in no sound
machine and alone explains what shows in all moves (chosen)."""
OF_SOUND = 2.0
"""How many times as much as matters that must change the backlash which is no more than a sound machine has (chosen):
found as it is, it is no finding as long as the backlash hardly changes."""
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
            before=report(before, a),
            after=report(after, a),
            effects=effects,
            indistinguishable=selection.rivals if effects else (),
            separating_move=separating_move(selection, scene.validate)
            if effects and selection.rivals
            else None,
            candidates=tuple(
                replace(c, validation_rms=c.validation_rms * float(scene.validate.noise[a]))
                for c in selection.candidates
            ),
            parameters=parameters(after.fitted, a),
            evidence=(*over_range(scene, name), *evidence_of(before.held, selection, finding, a, model)),
            predictions=(prediction("before", before.held, a), prediction("after", after.held, a)),
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
    explains what is missing; a model that is all this with what every sound machine has lacks only that, and so does
    one with what nothing tells from it. What another channel is the witness of has been judged by that.
    """
    before, after, effects = selection.before, selection.after, selection.effects
    if effects and effects == selection.witnessed:
        return "effect", effects
    sound = max(sound, SMALL) if _undisputed(selection) else sound
    usual = _in_time(before) and _usual(before) and not _contradicted(before)
    sound_enough = little(before) and left(after) <= sound and usual
    of_library = not (selection.hinted or _of_no_library(selection))
    nothing: Finding = "none" if sound_enough and of_library else "unknown"
    if not effects or (little(before) and common_suffices(selection)):
        return nothing, ()
    if not _matters(selection):
        if little(before) and not _clear(selection, seen_at_rest):
            return ("none" if of_library and _as_sound(selection) else nothing), ()
        if of_every_machine(selection) or any(
            of_every_machine(other) and not _matters(other) for other in indistinguishable(selection)
        ):
            return "none", ()
    return ("effect", effects) if _explanation(selection, seen_at_rest) else ("unknown", ())


def _clear(selection: Selection[Explained], seen_at_rest: tuple[str, ...]) -> bool:
    """Whether what was found is a finding although little is missing and the backlash stays: it was seen at rest; alone
    it explains what shows in the moves that were fitted; or it is in no sound machine, explains all moves by itself,
    which show something, or those that were not fitted, whose motors contradict the model without it and not with it,
    and nothing else does or comes near."""
    before, after, effects = selection.before, selection.after, selection.effects
    seen = shown(before) > SMALL
    if effects == seen_at_rest or (seen and by_itself(selection)):
        return True
    reconciled = _reconciles_motors(selection)
    clearly = explained(before, after, CLEARLY) and (
        gone(before.train_rms, after.train_rms, CLEARLY)
        or (reconciled and after.train_rms <= before.train_rms)
    )
    whole = len(effects) == 1 and clearly and (seen or after.validation_rms <= LEFT_BY_CLEAN)
    uncommon = not common(selection) and (left(before) > SEARCHED or reconciled)
    if uncommon and whole and not common_comes_as_near(selection):
        return True
    return by_itself(selection) and _nothing_else_explains(selection)


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


def _explanation(selection: Selection[Explained], seen_at_rest: tuple[str, ...]) -> bool:
    """Whether the effects leave near nothing, or predict nearly all that is missing in moves that nobody has fitted, or
    one of them alone describes those that were and predicts the others no worse; none whose numbers went to where no
    such effect is when its fit was ended, or that the motors speak against."""
    before, after, effects = selection.before, selection.after, selection.effects
    if after.at_limits or _against_motors(selection):
        return False
    alone, certain = by_itself(selection), effects == seen_at_rest and explained(before, after, PART)
    if after.train_rms <= LEFT and (certain or (alone and explained(before, after, WHOLLY))):
        return True
    if effects == (_sole(selection),) and after.validation_rms <= min(CHANGED, before.validation_rms):
        return True
    error = left if len(effects) == 1 else shown
    exact = any(DRIVEN[name].exact for name in effects if name in DRIVEN)
    near = error(after) <= (LEFT_BY_ONE if alone and not exact else LEFT)
    near = near and most_left(after) <= CHANGED
    return near and explained(before, after, PART) and _fitted_too(before, after)


def _sole(selection: Selection[Explained]) -> str | None:
    """The one effect that describes the moves that were fitted, where impurities leave more, and none else does."""
    trials = {trial.model.fitted.model.effects[-1].name: trial for trial in selection.tried}
    return sole_fit(selection.before, trials, SMALL)


def _fitted_too(before: Trial[Explained], after: Trial[Explained]) -> bool:
    """Whether as large a part is gone from the moves that were fitted, or next to nothing is left there, or little in
    all: what predicts other moves and leaves those that it was fitted to as they were is not what acts."""
    described = after.train_rms <= LEFT_BY_CLEAN or most_left(after) <= LEFT
    return described or gone(before.train_rms, after.train_rms, PART)


def _nothing_else_explains(selection: Selection[Explained]) -> bool:
    """Whether one effect that is in no sound machine predicts all that is missing in the held-out moves, or leaves
    nothing that would be searched for, and nothing else that was tried predicts a part of it: impurities are explained
    in part by much."""
    before, after, effects = selection.before, selection.after, selection.effects
    others = [t for t in selection.tried if t.model.fitted.model.effects[-1].name not in effects]
    predicted = explained(before, after, WHOLLY) or shown(after) <= SEARCHED
    whole = most_left(after) <= LEFT_BY_CLEAN and predicted
    if common(selection) or not whole or before.validation_rms <= UNKNOWN_NUMBERS:
        return False
    return bool(others) and not any(explained(before, other, PART) for other in others)


def _matters(selection: Selection[Explained]) -> bool:
    """Whether what was found changes the backlash, and clearly so if a sound machine may have as much of it."""
    before, after = selection.before.model.fitted, selection.after.model.fitted
    limited = all(np.isfinite(COMMON[name].most) for name in selection.effects if name in COMMON)
    times = OF_SOUND if limited and common(selection) else 1.0
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
        and most_left(trial) <= LEFT_BY_CLEAN
        and explained(before, trial)
        and _matters(taken_instead(selection, trial))
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


def little(trial: Trial[Explained]) -> bool:
    """Whether what the declared model leaves may be an impurity too small to matter."""
    return left(trial) <= SMALL and trial.validation_rms <= CHANGED


def _as_sound(selection: Selection[Explained]) -> bool:
    """Whether with no more than every sound machine has, in numbers that there are, next to nothing is left of all
    moves, no channels need be apart in time, and the motors say nothing else."""
    after = selection.after
    described = most_left(after) <= LEFT_BY_CLEAN and not after.at_limits
    return described and of_every_machine(selection) and _in_time(after) and not _spoken_against(after)


def _in_time(trial: Trial[Explained]) -> bool:
    """Whether no channels need be apart in time for it, more than those of a measurement are."""
    found = trial.model.fitted
    return not any(apart_in_time(found, axis) for axis in range(len(found.model.axes)))


def _contradicted(trial: Trial[Explained]) -> bool:
    """Whether a model leaves more of other moves than numbers do that are not known well, and the motors contradict it
    plainly: one that is wrong may describe the moves that it was fitted to."""
    return shown(trial) > LEFT and _spoken_against(trial)


def _spoken_against(trial: Trial[Explained]) -> bool:
    """Whether the motors plainly leave more than the moves that were fitted do."""
    by_motors = float(np.max(left_by_motors(trial.model.fitted)))
    return by_motors > PLAINLY * max(1.0, trial.train_rms)


def _usual(trial: Trial[Explained]) -> bool:
    """Whether no chain need be damped for it as none is, or it leaves next to nothing."""
    return left(trial) <= LEFT_BY_CLEAN or not overdamped(trial.model.fitted)
