"""Search for what a model of moves lacks: every effect is refitted as an addition to the model, from the best of its
starts (``moves_starts``, ``moves_looks``), and judged on moves that were not fitted.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from service.backlash.moves_fit import Fitted, fit, values_at
from service.backlash.moves_point import Point, width
from service.dynamics.driven_model import DrivenEffect
from service.dynamics.work import up_to
from service.identification.held_out import DESCRIBED, Explained, judged_rms, trial_of
from service.identification.moves_carried import (
    SECOND,
    as_coupled,
    as_other,
    bridges,
    ground_of,
    refitted,
    seconded,
)
from service.identification.moves_end import HOPELESS, RIDGE, SOUND, ended, settled
from service.identification.moves_finals import BEHIND, describes_all, finished, leading, on_better_machines
from service.identification.moves_heard import heard
from service.identification.moves_likenesses import as_near, beside_likeness, by_other_laws
from service.identification.moves_looks import (
    ENDED,
    FAR_OFF,
    Brief,
    compared,
    enough_of_few,
    out_of_reach,
    standing,
)
from service.identification.moves_ridges import across
from service.identification.moves_shapes import in_best_shape, in_other_shapes
from service.identification.moves_starts import (
    ROUNDS,
    Candidate,
    begun_at,
    candidates,
    on_a_few_moves,
    on_sound_motion,
)
from service.identification.scene import Scene
from service.identification.selection import UNKNOWN_NUMBERS, Trial, distance

PROMISING = 4
"""Effects that are fitted further after a first look at all."""
SEARCH = 0.75
"""Share of all that may be simulated after which no effect is followed further (chosen: what may be hidden, and two
effects together, are asked for after this)."""
HARDLY_NEARER = 0.99
"""RMS on a few moves, over that of the present fit, from which on an effect explains nothing of what is missing
(chosen: a parameter more gains a few parts in ten thousand)."""


def propose(
    scene: Scene,
    library: Sequence[type[DrivenEffect]],
    present: Trial[Explained],
    taken: tuple[str, ...],
    tell: Callable[[str], None],
) -> dict[str, Trial[Explained]]:
    """Every effect that is not in yet, fitted on all train moves; the best few fitted to the end. Of further effects
    none, where a few moves show that none explains what is left. What was spared its strong starts, for another effect
    described a few moves, has them where that one does not describe all: it may have imitated the right one there; what
    they lead no nearer to the few moves stays as it is, and the nearest of both are tried on each other's machines."""
    base = on_sound_motion(present.model.fitted)
    tried = candidates(base.model, library, taken)
    coupled = {c.name: as_coupled(scene, base, c) for c in tried if scene.coupled and bridges(c)}
    known = min((f.rms for f in coupled.values()), default=np.inf)
    brief, spared = compared(scene, base, tried, known, taken)
    trials = proposed(scene, present, base, tried, brief, coupled, taken, tell)
    if not (trials and spared) or any(describes_all(present, trial) for trial in trials.values()):
        return trials
    tell("what describes a few moves does not describe the others: the other effects, from strong starts")
    return up_to(
        SEARCH, lambda: with_spared(scene, present, base, spared, brief, taken, trials, tell), trials
    )


def with_spared(
    scene: Scene,
    present: Trial[Explained],
    base: Fitted,
    spared: Sequence[Candidate],
    brief: Mapping[str, list[Brief]],
    taken: tuple[str, ...],
    trials: dict[str, Trial[Explained]],
    tell: Callable[[str], None],
) -> dict[str, Trial[Explained]]:
    """The trials, with those of what was `spared` its strong starts from these, too."""
    strong, _ = compared(scene, base, spared, np.inf, taken, sparing=False)
    nearer = [c for c in spared if strong[c.name][0].rms < RIDGE * brief[c.name][0].rms]
    again = proposed(scene, present, base, nearer, strong, {}, taken, tell) if nearer else {}
    trials = trials | {name: min((trials.get(name, t), t), key=distance) for name, t in again.items()}
    return on_better_machines(scene, present, trials)


def proposed(
    scene: Scene,
    present: Trial[Explained],
    base: Fitted,
    tried: Sequence[Candidate],
    brief: Mapping[str, list[Brief]],
    coupled: Mapping[str, Fitted],
    taken: tuple[str, ...],
    tell: Callable[[str], None],
) -> dict[str, Trial[Explained]]:
    """The trials of these candidates by name, from their `brief` fits of a few moves; none where those speak against
    all of them."""
    found: dict[str, Fitted] = {}
    brief = {c.name: brief[c.name] for c in tried}
    least = min([f.rms for f in coupled.values()] + [fits[0].rms for fits in brief.values()])
    enough = min(BEHIND * least, enough_of_few(base, taken), worth_all_moves(base))
    if taken and (out_of_reach(least, base, taken) or least > enough):
        return {}
    if out_of_reach(least, base):
        ranked = sorted(brief, key=lambda name: brief[name][0].rms)[:PROMISING]
        return {
            name: trial_of(scene, refitted(base, brief[name], BEHIND * least)[0], thorough=False)
            for name in ranked
        }
    others: dict[str, list[Fitted]] = {}
    for name, fits in brief.items():
        first, *others[name] = refitted(base, fits, enough)
        found[name] = min((first, *(f for at, f in coupled.items() if at == name)), key=lambda f: f.rms)
        tell(f"tried {name}: {found[name].rms:.3f} (now {base.rms:.3f})")
    up_to(SEARCH, lambda: led_nearer(scene, base, found, brief, tried), None)
    trials = {
        name: min((tried_first(scene, present, one) for one in (f, *others[name])), key=distance)
        for name, f in found.items()
    }
    steps: tuple[Callable[[dict[str, Trial[Explained]]], Mapping[str, Trial[Explained]]], ...] = (
        lambda trials: {c.name: in_best_shape(scene, base, c, trials[c.name]) for c in tried},
        lambda trials: finished(scene, present, trials),
        lambda trials: beside_likeness(scene, present, base, tried, trials),
        lambda trials: best_in_other_shapes(scene, base, tried, trials),
        lambda trials: by_other_laws(scene, present, tried, trials),
        lambda trials: as_near(scene, present, trials),
    )
    for further in steps:
        trials = {**trials, **up_to(SEARCH, partial(further, trials), trials)}
    return trials


def led_nearer(
    scene: Scene,
    base: Fitted,
    found: dict[str, Fitted],
    brief: Mapping[str, Sequence[Brief]],
    tried: Sequence[Candidate],
) -> None:
    """The fits begun once more where they are far behind, or where what swings is heard and nothing is near, and the
    best continued."""
    begun_again(base, found, brief, tried)
    if min(f.rms for f in found.values()) > HOPELESS:
        for c in tried:
            found[c.name] = min((found[c.name], *heard(scene, base, c)), key=lambda f: f.rms)
    fitted_on(base, found, tried)


def best_in_other_shapes(
    scene: Scene, base: Fitted, tried: Sequence[Candidate], trials: Mapping[str, Trial[Explained]]
) -> dict[str, Trial[Explained]]:
    """The best of the trials, begun in the effect's other shapes, too."""
    best = min(tried, key=lambda c: distance(trials[c.name]))
    return {best.name: in_other_shapes(scene, base, best, trials[best.name])}


def tried_first(scene: Scene, present: Trial[Explained], found: Fitted) -> Trial[Explained]:
    """The trial of a fit that is not finished. Where much shows in the moves that were fitted, and it comes no nearer
    to them than the present model, it explains nothing: without the effect it says what that says of the others."""
    if present.train_rms < SOUND or found.rms < present.train_rms:
        return trial_of(scene, found, thorough=False)
    return replace(present, model=Explained(found, present.model.held), train_rms=judged_rms(found))


def roughly(
    scene: Scene, present: Trial[Explained], kind: type[DrivenEffect], taken: tuple[str, ...]
) -> Trial[Explained]:
    """One effect fitted to all train moves beside those that were `taken`, and to no end."""
    base = on_sound_motion(present.model.fitted)
    (candidate,) = candidates(base.model, (kind,), taken)
    brief, _ = compared(scene, base, [candidate], np.inf, taken)
    first, *_ = refitted(base, brief[candidate.name], np.inf)
    return trial_of(scene, fit(first.moves, first.model, first.at, ROUNDS), thorough=False)


def worth_all_moves(base: Fitted) -> float:
    """How near to a few moves an effect must come to be fitted to all, where the present fit does not describe these
    few either: what is missing in them it would explain a part of."""
    few = standing(on_a_few_moves(base)) if base.rms > DESCRIBED else 0.0
    return HARDLY_NEARER * few if few > DESCRIBED else np.inf


def begun_again(
    base: Fitted, found: dict[str, Fitted], brief: Mapping[str, Sequence[Brief]], tried: Sequence[Candidate]
) -> None:
    """All that is far behind the best begun once more from its ground."""
    best = min(found.values(), key=lambda f: f.rms)
    behind = [c for c in tried if best.rms < SECOND * min(base.rms, found[c.name].rms)]
    ground = ground_of(base, best) if behind else base
    for candidate in behind:
        nearest = min(brief[candidate.name][0].rms, found[candidate.name].rms)
        first, far = found[candidate.name], FAR_OFF * best.rms
        found[candidate.name] = seconded(ground, first, candidate, nearest, far)


def fitted_on(base: Fitted, found: dict[str, Fitted], tried: Sequence[Candidate]) -> None:
    """The best of the fits continued and led across samples, then what they contain and what does much the same as the
    best, begun there. Where the present fit describes the moves already, what is missing shows in others, and hardly in
    how near a fit comes: all are continued. What is far behind one that describes the moves is not led across samples,
    nor, where none describes them and the present fit is far off, what is near: that may leave the error of a motion
    that was made by a wrong force, and is gone with it."""
    nearest = leading({name: one.rms for name, one in found.items()}, PROMISING)
    for name in nearest if base.rms > ENDED else list(found):
        found[name] = fit(found[name].moves, found[name].model, found[name].at, ROUNDS)
    described = min(one.rms for one in found.values()) <= ENDED
    behind = BEHIND if described else FAR_OFF
    reached = UNKNOWN_NUMBERS if base.rms >= HOPELESS and not described else ENDED
    for name in leading({name: one.rms for name, one in found.items()}, PROMISING, behind):
        found[name] = across(found[name]) if found[name].rms > reached else found[name]
    for candidate in tried:
        for inner in set(candidate.effect.contains) & set(found):
            found[inner] = as_other(found[inner], found[candidate.name])
    best = min(found.values(), key=lambda f: f.rms)
    for candidate in tried:
        if candidate.effect.instead(values_at(best)) and found[candidate.name] is not best:
            found[candidate.name] = as_other(found[candidate.name], best)


def challenged(scene: Scene, present: Trial[Explained], best: Trial[Explained]) -> Trial[Explained]:
    """The present model fitted once more from where the best candidate ended, without the candidate's effect, so that
    no effect is named for having led the fit out of a poor valley; which valley is the better one, the best has found.
    Where the candidate ended with gear and pinion apart, so does the present model begin, and every move as the
    candidate left it or where it is found to rest, which is elsewhere without the candidate's effect."""
    now, other = present.model.fitted, best.model.fitted
    model = replace(now.model, lumps=other.model.lumps)
    moves = [
        replace(
            theirs,
            expected=own.expected,
            judged=own.judged,
            wander=own.wander,
            force_off=own.force_off,
        )
        for theirs, own in zip(other.moves, now.moves, strict=True)
    ]
    own = tuple(local[:, : width(model)] for local in other.at.local)
    again = fit(moves, model, begun_at(moves, model, values_at(other), own), ROUNDS)
    if again.rms < BEHIND * now.rms and again.rms < HOPELESS:
        again = settled(again, ROUNDS, (np.inf, np.inf))
    return trial_of(scene, again) if again.rms < 0.99 * now.rms else present


def without(scene: Scene, trial: Trial[Explained], name: str) -> Trial[Explained]:
    """The model without one of its effects, fitted once more from where it stands, and to the end if it is not far off:
    an effect without which it is so cannot be spared."""
    found = trial.model.fitted
    effects = tuple(effect for effect in found.model.effects if effect.name != name)
    model = replace(found.model, effects=effects)
    places = 2 * len(model.axes)
    nuisance = [p.name for p in found.model.nuisance]
    own = [*range(places), *(places + nuisance.index(p.name) for p in model.nuisance)]
    numbers = [p.name for p in found.model.parameters]
    shared = found.at.shared[[numbers.index(p.name) for p in model.parameters]]
    again = fit(found.moves, model, Point(shared, tuple(local[:, own] for local in found.at.local)), ROUNDS)
    again = settled(again, ROUNDS)
    if again.rms > FAR_OFF * found.rms:
        return trial_of(scene, again, thorough=False)
    return ended(scene, trial_of(scene, again))
