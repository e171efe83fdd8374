"""Explain the acceleration channel of an axis with diagnostic moves: from recordings to the verdict."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from service.dynamics.driven_model import DrivenEffect
from service.dynamics.effects.driven_library import DRIVEN
from service.dynamics.effects.driven_sensors import DrivenBias
from service.dynamics.work import counted, given_up, up_to
from service.identification.axis_pairs import refused, with_another, with_bias_seen, with_hidden, with_two
from service.identification.axis_selected import BEYOND, FURTHER, LIMITS, MATERIAL, WITNESSED, selected
from service.identification.axis_verdict import finding_of, little, verdict
from service.identification.explanation import Accepted, AxisExplanation, Candidate
from service.identification.given_effects import as_accepted, names_of, with_effects_of
from service.identification.held_out import DESCRIBED, SEARCHED, Explained, overdamped, trial_of
from service.identification.moves_carried import SECOND
from service.identification.moves_end import SOUND, declared_end, ended
from service.identification.moves_finals import describes_all
from service.identification.moves_hidden import Near, as_heard_by_motors, hidden, leads, swinging
from service.identification.moves_motors import (
    CONTRADICTED,
    PLAINLY,
    left_by_motors,
    nothing_left,
    reconciled,
)
from service.identification.moves_repeated import pure_error
from service.identification.moves_search import SEARCH, challenged, propose
from service.identification.moves_sound import with_impurities
from service.identification.moves_starts import TOO_MUCH
from service.identification.scene import Scene, declared_fits, scene_of
from service.identification.selection import (
    EXPLAINED,
    LEFT,
    Limits,
    Selection,
    Trial,
    distance,
    gone,
    gone_from_all,
    left,
    shown,
)
from service.recording import Recording

HIDDEN = tuple(kind for kind in DRIVEN.values() if kind.many_valleys)
"""What the declared model may hide in the moves that are fitted: it makes one gap of two in series, as wide as both.
Asked for by the motors, and where no torque was recorded and the other moves are not described as well, although
numbers that are not known could do that, too."""
SWINGING = tuple(kind for kind in DRIVEN.values() if kind.free_swing is not None)
"""What swings, and is asked for at all frequencies where nothing else is found with which the motors agree."""

WHOLE, OF_TWO = 5e10, 3.0
"""What is simulated of one axis, in squared states at grid points, until nothing is searched any more (chosen:
five minutes of one core beside other work; of the right names that took longest none took more than 2e10, and a
clean machine of which nothing was found took 3e10); and how much more of two axes that move together."""
FIRST, TOGETHER, LAST = 0.4, 0.85, 1.0
"""Shares of it after which what may be hidden is not searched before all else, after which two effects together are
not, and after which nothing is (chosen)."""
CUT_SHORT = (
    "the search was ended after what takes some minutes: not every effect was followed to its end, or not all was "
    "asked for that might be hidden; flankwatch explain --patience 5 with the recordings' files goes on longer"
)


def explain_axes(
    train: Sequence[Recording],
    validate: Recording,
    axes: Sequence[str],
    tell: Callable[[str], None] = lambda _message: None,
    accepted: Mapping[str, Accepted] | None = None,
    patience: float = 1.0,
) -> tuple[AxisExplanation, ...]:
    """The verdicts on one axis, or on the two that move together, in the acceleration channel.

    What they are `accepted` to have, by axis, is in the model before anything is searched, if the moves show it. Of a
    search that takes more than `WHOLE` times `patience` the rest is left out, and the evidence says so.
    """
    expected, there = names_of(accepted or {}, axes), tuple[str, ...]()
    tell(f"{' and '.join(axes)}: fitting the declared model")
    whole = patience * WHOLE * (OF_TWO if len(axes) > 1 else 1.0)
    # A random machine may be unstable; its cost counts as infinite.
    with np.errstate(all="ignore"), counted(whole):
        library = tuple(DRIVEN.values())
        scene = scene_of(train, validate, tuple(axes), tuple(axes) in validate.gantry, library)
        before = ended(scene, trial_of(scene, declared_end(declared_fits(scene), 12, scene.smooth_left)))
        tell(f"declared model: RMS {before.train_rms:.3f}, held out {before.validation_rms:.3f} of the noise")
        if expected and accepted:
            tell(f"fitting the accepted model: {', '.join(expected)}")
            revised = as_accepted(scene, before, accepted)
            if distance(revised) < (1.0 - MATERIAL) * distance(before):
                before, there, scene = revised, expected, with_effects_of(scene, revised)
            tell(
                f"accepted model: {revised.train_rms:.3f}, held out {revised.validation_rms:.3f} of the noise"
            )
        # Every fit holds moves of its own; those of the scene would only keep the large answers of their motors.
        scene = replace(scene, train=())
        absent = () if there else expected
        if scene.clipped:  # what is cut off looks like many an effect: nothing is named that was fitted to it
            tell(f"the accelerometer of {' and '.join(scene.clipped)} was over its range")
            return verdict(scene, nothing_beyond(before), there, absent)
        found = missing_in(scene, before, there, tell)
        found = up_to(LAST, partial(with_bias_seen, scene, found, tell), found)
        found = up_to(LAST, partial(with_hidden, scene, found, HIDDEN, tell), found)
        cut_short = given_up() > 0
        if cut_short and not found.effects:
            found = replace(found, hinted=True)
        note = (CUT_SHORT,) if cut_short else ()
        explained = verdict(scene, found, there, absent)
        return tuple(replace(one, evidence=(*one.evidence, *note)) for one in explained)


def nothing_beyond(trial: Trial[Explained]) -> Selection[Explained]:
    """The outcome where nothing was searched."""
    return Selection(trial, trial, (), (), ())


def beyond_motion(before: Trial[Explained]) -> Selection[Explained]:
    """The outcome where what is missing does not follow the motion: every effect that does is refused for that."""
    held = {effect.name for effect in before.model.fitted.model.effects} | {DrivenBias.name}
    why = "follows the motion, while moves that are alike differ from one another"
    refused = tuple(Candidate(name, before.held_rms, 1.0, False, why) for name in DRIVEN if name not in held)
    return replace(nothing_beyond(before), candidates=refused)


def missing_in(
    scene: Scene, before: Trial[Explained], accepted: Sequence[str], tell: Callable[[str], None]
) -> Selection[Explained]:
    """What is missing in the model that is declared, or that was accepted. A zero that is seen to wander at rest is
    asked for first; nothing else is where most of it differs between moves that are alike, which no effect explains.
    Where little is, what every sound machine has may be all, unless the motors contradict it and what may be hidden
    comes nearer to a few moves; where all smooth effects suffice, or a bent contact, these are searched before what may
    be hidden. The motors are asked where their equations of motion do not hold; where they hold, what may be hidden
    between motor and load is asked for last, if all else ends unknown. Where no torque was recorded and only numbers
    may do it that are not known, nothing is asked for but what may be hidden. What accepted effects leave is the next
    one's only where it is more than a law leaves that differs a little from the machine's, as after a first effect."""
    if scene.zero_wanders and DrivenBias.name not in accepted:
        tell("the accelerometer's zero wanders while the axis rests")
        found = searched(scene, before, tell, WITNESSED, first=(DrivenBias,))
        if found.effects:
            return found
    alike = pure_error(before.model.fitted)
    if alike.beyond_any_effect:
        tell(f"moves that are alike differ by {alike.apart:.1f} of the noise: no effect of motion does that")
        return beyond_motion(before)
    if accepted:
        beyond = left(before) > FURTHER[1]
        return searched(scene, before, tell, BEYOND) if beyond else nothing_beyond(before)
    by_motors = float(np.max(left_by_motors(before.model.fitted)))
    contradict = by_motors > CONTRADICTED and before.train_rms < TOO_MUCH
    if contradict:
        tell(f"the motors' equations of motion leave {by_motors:.1f} of the noise")
    plainly = by_motors > PLAINLY * before.train_rms and not suffices(before, scene.smooth_left)
    near: Near = {}
    if asked_of_impurities(scene, before) and (contradict or shown(before) > SEARCHED):
        found = with_impurities(scene, before, tell)
        sound = only_impurities(found)
        if sound and (
            not contradict or describes_motors(before, sound.after) or not leads(scene, before, HIDDEN, near)
        ):
            return sound
        plainly = plainly and not any(suffices(before, one.train_rms) for one in found.tried)
    if contradict:
        return contradicted(scene, before, plainly, tell, near)
    if shown(before) <= SEARCHED and before.validation_rms > DESCRIBED and not by_motors:
        return searched(scene, before, tell, WITNESSED, first=HIDDEN)
    content = 0.0 < by_motors <= CONTRADICTED
    found = searched(scene, before, tell, LIMITS, but=HIDDEN if content else ())
    return beyond_motors(scene, before, found, tell, near) if content else found


def beyond_motors(
    scene: Scene,
    before: Trial[Explained],
    found: Selection[Explained],
    tell: Callable[[str], None],
    near: Near,
) -> Selection[Explained]:
    """What was found; or where that is unknown what may be hidden between motor and load, though the motors do not
    contradict the model: one much heavier than what it meets feels little of it."""
    unknown = finding_of(found)[0] == "unknown" and before.train_rms < TOO_MUCH
    if not (unknown and leads(scene, before, HIDDEN, near)):
        return found
    nothing = nothing_beyond(before)
    told = up_to(LAST, lambda: hidden(scene, before, HIDDEN, len(DRIVEN), tell, near), nothing)
    taken = told if told.effects and describes_motors(before, told.after) else found
    return replace(taken, candidates=found.candidates + told.candidates)


def suffices(before: Trial[Explained], left_with: float) -> bool:
    """Whether next to all that shows in the moves that were fitted is gone with what leaves so much of them: then that
    is more likely than what is hidden, of which the motors say more than the samples."""
    return before.train_rms > DESCRIBED and gone(before.train_rms, left_with, EXPLAINED)


def asked_of_impurities(scene: Scene, before: Trial[Explained]) -> bool:
    """Whether what every sound machine has is asked for first: where little is missing, and all smooth effects, of
    which it is none, do not suffice."""
    return little(before) and not suffices(before, scene.smooth_left)


def only_impurities(found: Selection[Explained]) -> Selection[Explained] | None:
    """What every sound machine has, where it describes all moves and is no finding."""
    return found if found.effects and finding_of(found)[0] == "none" else None


def contradicted(
    scene: Scene, before: Trial[Explained], plainly: bool, tell: Callable[[str], None], near: Near
) -> Selection[Explained]:
    """What is missing where the motors contradict the model. If nothing is found with which their equations of motion
    hold, what swings is asked for at all frequencies, and taken if they hold with it; then what may be hidden: it has
    its name if the other moves are described with it, too, or if nothing else is found that describes them better, or
    nothing with which the motors agree as they do with it, and is a hint otherwise, as where it describes neither the
    fitted moves nor the motors. Where they speak `plainly`, while the moves that were fitted are nearly described, as
    one gap describes two, or whatever they say where these are described, so that nothing else shows in them, and it
    comes nearer to a few moves, this is asked for first, and nothing else if all moves and their motors are described
    with it, or nothing is left of those that were fitted and of their motors; nor what swings, if the motors are
    described with this or with what else was found. Where what was asked for first only led to a machine on which the
    model before comes nearer, all is asked anew from there, unless the motors contradict that model there, too, and
    with what was found nothing is left. What may be hidden goes on from what was begun `near` by."""
    witnessed = as_heard_by_motors(before).validation_rms > 0.0
    imitated = before.train_rms < SOUND if plainly else before.train_rms <= DESCRIBED
    asked_first = witnessed and imitated and leads(scene, before, HIDDEN, near)
    nothing = nothing_beyond(before)

    def asked(share: float) -> Selection[Explained]:
        return up_to(share, lambda: hidden(scene, before, HIDDEN, len(DRIVEN), tell, near), nothing)

    first = asked(FIRST) if asked_first else None
    if first and first.effects:
        elsewhere = challenged(scene, before, first.after)
        needed = nothing_left(first.after.model.fitted) and not reconciled(before, elsewhere)
        if not needed and distance(elsewhere) < SECOND * distance(before):
            tell(f"the model before comes nearer on another machine: RMS {elsewhere.train_rms:.3f}")
            return missing_in(scene, elsewhere, (), tell)
        if nothing_left(first.after.model.fitted) or describes_motors(before, first.after):
            return first
    beside = searched(scene, before, tell, LIMITS, but=HIDDEN if witnessed else ())
    if beside.effects and describes_motors(before, beside.after):
        return beside
    told = [one for one in (first, beside) if one and one.effects and reconciled(before, one.after)]
    if witnessed and not told:
        swung = selected(
            scene,
            before,
            lambda _, taken: (
                {} if taken else up_to(LAST, partial(swinging, scene, before, SWINGING, tell), {})
            ),
            tell,
            LIMITS,
        )
        if swung.effects and describes_motors(before, swung.after):
            again = {candidate.effect for candidate in swung.candidates}
            others = tuple(one for one in beside.candidates if one.effect not in again)
            return replace(swung, candidates=others + swung.candidates)
    found = first or asked(LAST)
    told_of = bool(found.effects) and tells_of_it(before, found.after)
    if told_of and not (finding_of(beside)[0] == "effect" and describes_better(before, beside, found)):
        return found
    hinted = found.hinted or bool(found.effects)
    return replace(beside, candidates=beside.candidates + found.candidates, hinted=hinted)


def tells_of_it(before: Trial[Explained], trial: Trial[Explained]) -> bool:
    """Whether what may be hidden describes the moves that were fitted, or the motors agree with it: what something else
    does between motor and load, such as a film of oil, a gap takes a part of from both."""
    return trial.train_rms <= DESCRIBED or reconciled(before, trial)


def describes_better(
    before: Trial[Explained], beside: Selection[Explained], found: Selection[Explained]
) -> bool:
    """Whether the moves that were not fitted are described better with what was found beside what may be hidden, and
    with that not well, unless the motors agree with what may be hidden only."""
    if found.after.validation_rms <= max(LEFT, beside.after.validation_rms):
        return False
    return reconciled(before, beside.after) or not reconciled(before, found.after)


def describes_motors(before: Trial[Explained], trial: Trial[Explained]) -> bool:
    """Whether a model describes the moves that were fitted and the others, and what the motors say."""
    return describes_all(before, trial) and reconciled(before, trial)


def searched(
    scene: Scene,
    before: Trial[Explained],
    tell: Callable[[str], None],
    limits: Limits,
    first: Sequence[type[DrivenEffect]] = (),
    but: Sequence[type[DrivenEffect]] = (),
) -> Selection[Explained]:
    """What is found in the library, `but` for some, one after the other, or two that are found together only,
    where it ends unknown or with more left than how a law differs; with `first`, of which there is other evidence,
    begun with nothing else and however little is missing. Where it ends unknown, what every sound machine has may be
    all, if that was not asked before. Where the effects were not all followed to their ends, since that took more than
    a search may, one has its name only if it describes all moves."""
    held = {effect.name for effect in before.model.fitted.model.effects} | {kind.name for kind in but}
    library = tuple(kind for kind in DRIVEN.values() if kind.name not in held)
    cut_short = False

    def proposed(present: Trial[Explained], taken: tuple[str, ...]) -> Mapping[str, Trial[Explained]]:
        nonlocal cut_short
        if taken:
            return up_to(SEARCH, partial(propose, scene, library, present, taken, tell), {})
        before_this = given_up()
        trials = propose(scene, first or library, present, taken, tell)
        cut_short = given_up() > before_this
        return trials

    found = selected(
        scene,
        before,
        proposed,
        tell,
        replace(limits, enough=0.0) if first else limits,
    )
    if cut_short and not describes_all(before, found.after):
        found = unnamed(found)
    if first:
        return found
    found = up_to(TOGETHER, partial(with_another, scene, found, library, tell), found)
    if finding_of(found)[0] != "unknown" and left(found.after) <= FURTHER[1]:
        return found
    if left(before) > FURTHER[1]:
        found = up_to(TOGETHER, partial(with_two, scene, before, found, library, tell), found)
    if finding_of(found)[0] != "unknown":
        return found
    found = up_to(TOGETHER, partial(in_company, scene, before, found, library, tell), found)
    if asked_of_impurities(scene, before) or finding_of(found)[0] != "unknown":
        return found
    return up_to(LAST, lambda: only_impurities(with_impurities(scene, before, tell)), None) or found


def unnamed(found: Selection[Explained]) -> Selection[Explained]:
    """The outcome without the effects that were found, where others were not followed to their ends."""
    why = "not all others were followed to their ends"
    candidates = tuple(refused(one, why) for one in found.candidates)
    return replace(found, after=found.before, effects=(), candidates=candidates, rivals=())


def in_company(
    scene: Scene,
    before: Trial[Explained],
    found: Selection[Explained],
    library: Sequence[type[DrivenEffect]],
    tell: Callable[[str], None],
) -> Selection[Explained]:
    """What was found, or two effects, where one alone explains nearly all, but with a chain that is damped as none is:
    what it lacks beside it, such as a delay, has driven the chain there, and leads out of it again."""
    near = [t for t in found.tried if only_overdamped(t) and gone_from_all(before, t, EXPLAINED)]
    if not near:
        return found
    begun = min(near, key=distance)
    name = begun.model.fitted.model.effects[-1].name
    tell(f"{name} explains nearly all with {', '.join(begun.at_limits)} as no machine's: what is beside it")
    beside = selected(
        scene,
        begun,
        lambda present, taken: propose(scene, library, present, (name, *taken), tell),
        tell,
        replace(BEYOND, enough=0.0, most=1),
    )
    both = replace(
        beside,
        before=before,
        effects=(name, *beside.effects),
        candidates=found.candidates + beside.candidates,
        tried=found.tried,
    )
    return both if beside.effects and finding_of(both)[0] == "effect" else found


def only_overdamped(trial: Trial[Explained]) -> bool:
    """Whether nothing but dampings of the chain stands where none is."""
    return bool(trial.at_limits) and set(trial.at_limits) <= set(overdamped(trial.model.fitted))
