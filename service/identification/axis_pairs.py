"""Whether two effects are what a search for one after the other has missed, or another lies beside what was found:
named are only such as describe all moves, and of which neither can be spared."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from service.dynamics.driven_model import DrivenEffect
from service.dynamics.effects.driven_library import DRIVEN
from service.dynamics.effects.driven_sensors import DrivenBias
from service.identification.axis_selected import ANOTHER, FURTHER, SEEN_BESIDE, selected
from service.identification.axis_verdict import finding_of
from service.identification.explanation import Candidate
from service.identification.held_out import DESCRIBED, Explained
from service.identification.moves_finals import described
from service.identification.moves_hidden import Near, hidden, may_lead
from service.identification.moves_motors import CONTRADICTED, left_by_motors, nothing_left, reconciled
from service.identification.moves_search import propose, without
from service.identification.moves_together import added, pairs
from service.identification.scene import Scene
from service.identification.selection import (
    LEVEL,
    MATERIAL,
    NEAR,
    Limits,
    Selection,
    Trial,
    alike,
    distance,
    gain_p_value,
    left,
)


def with_two(
    scene: Scene,
    before: Trial[Explained],
    found: Selection[Explained],
    library: Sequence[type[DrivenEffect]],
    tell: Callable[[str], None],
) -> Selection[Explained]:
    """What was found, or two effects of the library, the stronger first, that describe all moves and with which the
    motors agree; or one of them where the other can be spared."""
    trials = [t for t in pairs(scene, before, library, tell) if reconciled(before, t)]
    if not trials:
        return found
    best = trials[0]
    one, other = added(before, best)
    spared = {one: without(scene, best, one), other: without(scene, best, other)}
    for name, alone in ((one, spared[other]), (other, spared[one])):
        if as_good(alone, best):
            return as_found(before, found, alone, {name: before}, ())
    if not all_needed(best, spared):
        return found
    strongest = sorted(spared, key=lambda name: distance(spared[name]), reverse=True)
    rivals = [r for t in trials[1:] if (r := rival(before, best, t))]
    return as_found(before, found, best, {name: spared[name] for name in strongest}, rivals)


def as_good(alone: Trial[Explained], best: Trial[Explained]) -> bool:
    """Whether one effect alone describes all moves, about as well as the best two."""
    return described(alone) and distance(alone) <= (1.0 + NEAR) * distance(best)


def all_needed(best: Trial[Explained], spared: Mapping[str, Trial[Explained]]) -> bool:
    """Whether each effect removes its share of the held-out RMS beside the others, by the trials in which it is
    spared."""
    return all(best.held_rms <= (1.0 - FURTHER[0]) * trial.held_rms for trial in spared.values())


def with_hidden(
    scene: Scene,
    found: Selection[Explained],
    kinds: Sequence[type[DrivenEffect]],
    tell: Callable[[str], None],
) -> Selection[Explained]:
    """What was found, or that and what of these `kinds` hides between motor and load, where the motors contradict the
    model with what was found alone, which describes the moves that were fitted, as one gap as wide as two does beside
    another effect, too. What was found keeps its name only where it cannot be spared then; both have theirs only where
    they are a finding together, and nothing is left of samples and motors: a preloaded flank is a gap to them, too."""
    after, near = found.after, Near()
    held = {effect.name for effect in after.model.fitted.model.effects}
    if not found.effects or any(kind.name in held for kind in kinds):
        return found
    if after.train_rms > DESCRIBED or float(np.max(left_by_motors(after.model.fitted))) <= CONTRADICTED:
        return found
    if not may_lead(scene, after, kinds, near):
        return found
    tell(f"the motors contradict the model with {' and '.join(found.effects)}: what hides beside it")
    told = hidden(scene, after, kinds, len(DRIVEN), tell, near)
    if not (told.effects and nothing_left(told.after.model.fitted)):
        why = "leaves something of the motors' equations of motion"
        return replace(found, candidates=(*found.candidates, *(refused(one, why) for one in told.candidates)))
    candidates = found.candidates + told.candidates
    best = told.after
    spared = {name: without(scene, best, name) for name in found.effects}
    alone, *more = spared.values()
    if not more and as_good(alone, best):
        others = tuple(refused(one, explained_by(told.effects)) for one in found.candidates)
        return replace(
            told, before=found.before, after=alone, candidates=others + told.candidates, tried=found.tried
        )
    if not all_needed(best, spared):
        return found
    spared |= dict.fromkeys(told.effects, after)
    strongest = tuple(sorted(spared, key=lambda name: distance(spared[name]), reverse=True))
    both = replace(found, after=best, effects=strongest, candidates=candidates)
    return both if finding_of(both)[0] == "effect" else found


def with_bias_seen(
    scene: Scene, found: Selection[Explained], tell: Callable[[str], None]
) -> Selection[Explained]:
    """What was found, and beside it a zero that is seen to wander at rest, which explained too little of the moves to
    be found before it."""
    held = {effect.name for effect in found.after.model.fitted.model.effects}
    if not (scene.zero_wanders and found.effects) or DrivenBias.name in held:
        return found
    tell(f"the accelerometer's zero wanders beside {' and '.join(found.effects)}")
    return beside(scene, found, (DrivenBias,), SEEN_BESIDE, tell)


def with_another(
    scene: Scene,
    found: Selection[Explained],
    library: Sequence[type[DrivenEffect]],
    tell: Callable[[str], None],
) -> Selection[Explained]:
    """What was found, and another of the library where both describe all moves, which it alone does not: nearly all
    that is missing is the one, and what it leaves may be its law, or another effect that is small beside it."""
    if finding_of(found)[0] != "effect" or left(found.after) <= ANOTHER.enough:
        return found
    others = tuple(kind for kind in library if kind.name not in found.effects)
    tell(f"{' and '.join(found.effects)} leaves {left(found.after):.2f} of the noise: what is beside it")
    both = beside(scene, found, others, ANOTHER, tell)
    return both if described(both.after) else found


def beside(
    scene: Scene,
    found: Selection[Explained],
    kinds: Sequence[type[DrivenEffect]],
    limits: Limits,
    tell: Callable[[str], None],
) -> Selection[Explained]:
    """What was found, or that and one of these `kinds`, begun where its fit ended, if they are a finding together."""
    more = selected(
        scene,
        found.after,
        lambda present, taken: propose(scene, kinds, present, (*found.effects, *taken), tell),
        tell,
        limits,
    )
    told = tuple(one for one in more.candidates if one.effect in more.effects)
    both = replace(
        found,
        after=more.after,
        effects=found.effects + more.effects,
        candidates=tuple(one for one in found.candidates if one.effect not in more.effects) + told,
        rivals=found.rivals + more.rivals,
    )
    return both if more.effects and finding_of(both)[0] == "effect" else found


def rival(
    before: Trial[Explained], best: Trial[Explained], trial: Trial[Explained]
) -> tuple[str, str] | None:
    """The effect of the best pair, and what explains the moves as it does in its place, beside the same other one."""
    mine, theirs = set(added(before, best)), set(added(before, trial))
    if len(mine & theirs) != 1:
        return None
    (name,), (other,) = mine - theirs, theirs - mine
    share = NEAR if other in DRIVEN[name].nearly else MATERIAL
    return (name, other) if alike(best, trial, share) else None


def as_found(
    before: Trial[Explained],
    found: Selection[Explained],
    after: Trial[Explained],
    spared: Mapping[str, Trial[Explained]],
    rivals: Sequence[tuple[str, str]],
) -> Selection[Explained]:
    """The selection with these effects, in order, each with the trial in which it is spared; found unknown if one gains
    no more than chance does."""
    names = tuple(spared)
    tried = len(DRIVEN) * (len(DRIVEN) - 1) // 2
    p_values = {name: min(1.0, tried * gain_p_value(trial, after)) for name, trial in spared.items()}
    if max(p_values.values()) >= LEVEL:
        return found
    others = tuple(refused(one, explained_by(names)) for one in found.candidates if one.effect not in names)
    why = "significant and material on held-out moves" + (", beside the other" if len(names) > 1 else "")
    own = tuple(Candidate(name, after.held_rms, p, True, why) for name, p in p_values.items())
    return replace(
        found, before=before, after=after, effects=names, candidates=others + own, rivals=tuple(rivals)
    )


def explained_by(names: Sequence[str]) -> str:
    """Why nothing else is accepted beside effects that explain all."""
    return f"significant, but {' and '.join(names)} explain all"


def refused(candidate: Candidate, why: str) -> Candidate:
    """The candidate, not accepted, and why it is not if it was."""
    return replace(candidate, accepted=False, why=why) if candidate.accepted else candidate
