"""Search for what a model of moves lacks: every effect is refitted as an addition to the model, from the best of its
starts (``moves_starts``, ``moves_looks``), and judged on moves that were not fitted.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import permutations

import numpy as np

from service.backlash.moves_begun import Values, point_at, shared_at
from service.backlash.moves_fit import (
    CLOSE_PLACES,
    Fitted,
    Point,
    best_of_each,
    fit,
    reconstructed,
    rests_found,
    values_at,
    width,
)
from service.dynamics.driven_model import DrivenEffect, Model
from service.dynamics.effects.driven_library import DRIVEN
from service.identification.held_out import DESCRIBED, Explained, trial_of
from service.identification.moves_end import (
    AS_WELL,
    HOPELESS,
    HOWEVER_FAR,
    OF_ADDED,
    RIDGE,
    SOUND,
    ended,
    in_full,
    led_on,
    settled,
    with_own_errors,
)
from service.identification.moves_heard import heard
from service.identification.moves_looks import (
    ENDED,
    FAR_OFF,
    GLIMPSE,
    Brief,
    compared,
    enough_of_few,
    noted,
    out_of_reach,
    standing,
)
from service.identification.moves_motors import plainly_against
from service.identification.moves_rests import swings_at_all
from service.identification.moves_ridges import across
from service.identification.moves_starts import (
    BRIEF,
    GUIDE,
    ROUNDS,
    Candidate,
    begun_at,
    candidates,
    fewer,
    fitted_from,
    hardly_any,
    on_a_few_moves,
    on_sound_motion,
    placed,
    scored,
    unanswering,
    widened,
)
from service.identification.scene import Scene
from service.identification.selection import (
    EXPLAINED,
    LEFT,
    LEFT_BY_CLEAN,
    PART,
    UNKNOWN_NUMBERS,
    WHOLLY,
    Trial,
    distance,
    gone,
    gone_from_all,
    shown,
)

FIRST_ROUNDS = 6
"""Rounds of a first fit of all moves."""
PROMISING = 4
"""Effects that are fitted further after a first look at all."""
FINALISTS = 2
"""Effects whose fit is finished with the motor's motion reconstructed from it, the nearest to all moves."""
BEHIND = 1.5
"""How much farther from the moves than the best a fit may be and still be finished (chosen)."""
TURNS_OF_RESTS = 2
"""How often the rests of two coupled axes are found anew after the first time."""
RIVAL = 0.75
"""How near to the best of a candidate's fits of a few moves another must come to be fitted to all moves beside it."""
HARDLY_NEARER = 0.99
"""RMS on a few moves, over that of the present fit, from which on an effect explains nothing of what is missing
(chosen: a parameter more gains a few parts in ten thousand)."""
AGAINST = 1.1
"""How much farther than the best from the moves and the motors' equations of motion a fit may be, and from all moves
what does much the same by another law (chosen)."""
SECOND = 0.9
"""How much nearer to the moves a place must be for a fit to begin there once more."""


def as_other(found: Fitted, other: Fitted) -> Fitted:
    """The fit of an effect, begun once more where one ended that contains it, or does much the same, and that came
    nearer."""
    if other.rms > found.rms:
        return found
    values = values_at(other) | dict(found.model.effects[-1].instead(values_at(other)))
    return min(found, fitted_from(found, values, ROUNDS), key=lambda f: f.rms)


def glanced_at(found: Fitted, brief: Brief) -> Fitted:
    """What was fitted to a few moves of a fit, on all of them: every move's zeros taken along, and one round of a fit.
    As far as one that is far behind the best has to be known."""
    moves, held = unanswering(found.moves), np.zeros(0, dtype=np.int64)
    shared = shared_at(brief.model, brief.values)
    starts = (Point(shared, local) for local in (brief.local, widened(found.at.local, brief.model)))
    at = best_of_each([fit(moves, brief.model, at, 1, free=held) for at in starts])
    return fit(moves, brief.model, at, 1)


def carried(found: Fitted, brief: Brief, rounds: int) -> Fitted:
    """What was fitted to a few moves of a fit, fitted to all of them."""
    moves = unanswering(found.moves)
    at = begun_at(moves, brief.model, brief.values, brief.local, widened(found.at.local, brief.model))
    return fit(moves, brief.model, at, rounds)


def refitted(found: Fitted, brief: Sequence[Brief], enough: float) -> list[Fitted]:
    """The candidate on all moves, from the best of its fits of a few, the nearest first; of an effect with many valleys
    one in each, with the motor's motion that it makes, for how near a few moves come says little of them, unless the
    motors speak against it. One that is not near `enough` is only looked at."""
    if brief[0].rms > enough:
        return [glanced_at(found, brief[0])]
    fits = [carried(found, one, FIRST_ROUNDS) for one in brief if brief[0].rms > RIVAL * one.rms]
    if fits[0].model.effects[-1].many_valleys:
        fits = [fit(reconstructed(f, asked=True), f.model, f.at, ROUNDS) for f in fits]
        least = min(f.rms_with_motors for f in fits)
        held = [f for f in fits if f.rms_with_motors <= AGAINST * least]
        return sorted(held, key=lambda f: f.rms)
    return [min(fits, key=standing)]


def bridges(candidate: Candidate) -> bool:
    """Whether the effect is a bridge between two axes, which the estimator has fitted by itself."""
    return "bridge_stiffness" in {p.name for p in candidate.effect.parameters}


def as_coupled(scene: Scene, found: Fitted, candidate: Candidate) -> Fitted:
    """The candidate on all moves from where the estimator puts two axes with a bridge between them. Where each side
    rests tells only once it is known where the other one does, and until then the masses and the friction of both are
    driven away; so the rests are found first, in turns. What takes a part of what is missing is led on from there
    before anything else is tried, however far it still is: two drives have many numbers, and two gaps many valleys."""
    moves, held = unanswering(found.moves), np.zeros(0, dtype=np.int64)
    begun = fit(
        moves, candidate.model, point_at(candidate.model, scene.coupled, moves), FIRST_ROUNDS, free=held
    )
    for _ in range(TURNS_OF_RESTS):
        at = rests_found(moves, candidate.model, begun.at, CLOSE_PLACES)
        begun = fit(moves, candidate.model, at, FIRST_ROUNDS, free=held)
    coupled = fit(moves, candidate.model, begun.at, ROUNDS)
    far = coupled.rms > ENDED and gone(found.rms, coupled.rms, PART)
    return settled(with_own_errors(coupled), ROUNDS, HOWEVER_FAR) if far else coupled


def ground_of(found: Fitted, best: Fitted) -> Fitted:
    """The present model with the machine that the best of all candidates found, on a few moves: while an axis moves,
    effects are alike that are not at its turning points, and the best has left the declared model's corner."""
    few, held = fewer(found), np.zeros(0, dtype=np.int64)
    return fit(few, found.model, point_at(found.model, values_at(best), few), BRIEF, free=held)


def seconded(ground: Fitted, first: Fitted, candidate: Candidate, nearest: float, far: float) -> Fitted:
    """The candidate, fitted `first`, begun once more from such a ground, unless it is `far` off after a glimpse;
    `nearest` is the RMS of its best fit so far."""
    glimpse = fit(ground.moves, candidate.model, placed(ground, candidate).at, GLIMPSE)
    if glimpse.rms > far:
        return first
    brief = fit(ground.moves, candidate.model, glimpse.at, BRIEF - GLIMPSE)
    if brief.rms > SECOND * nearest:
        return first
    again = carried(first, noted(brief, first.moves), FIRST_ROUNDS)
    return min(first, again, key=lambda f: f.rms)


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
    begun_again(base, found, brief, tried)
    if min(f.rms for f in found.values()) > HOPELESS:
        for c in tried:
            found[c.name] = min((found[c.name], *heard(scene, base, c)), key=lambda f: f.rms)
    fitted_on(base, found, tried)
    trials = {
        name: min((trial_of(scene, one, thorough=False) for one in (f, *others[name])), key=distance)
        for name, f in found.items()
    }
    trials = {c.name: in_best_shape(scene, base, c, trials[c.name]) for c in tried}
    trials = finished(scene, present, trials)
    trials = trials | beside_likeness(scene, present, base, tried, trials)
    best = min(tried, key=lambda c: distance(trials[c.name]))
    trials = trials | {best.name: in_other_shapes(scene, base, best, trials[best.name])}
    trials = trials | by_other_laws(scene, present, tried, trials)
    return trials | as_near(scene, present, trials)


def beside_likeness(
    scene: Scene,
    present: Trial[Explained],
    base: Fitted,
    tried: Sequence[Candidate],
    trials: Mapping[str, Trial[Explained]],
) -> dict[str, Trial[Explained]]:
    """Where the nearest of all is no such effect by its limits, the others that are nearer once they begin on the
    machine that it found, by name: a likeness of the right effect leads to the right machine, from which that one's own
    starts were too far. A few moves say which of them explain anything there; these are fitted to all, and ended where
    they come nearer than the likeness."""
    best = min(trials.values(), key=distance)
    others = [c for c in tried if c.name != best.model.fitted.model.effects[-1].name]
    if not (best.at_limits and others):
        return {}
    ground = ground_of(base, best.model.fitted)
    begun = [fit(ground.moves, c.model, placed(ground, c).at, BRIEF) for c in others]
    usual = np.median([one.rms for one in begun])
    out = dict[str, Trial[Explained]]()
    for brief in sorted((one for one in begun if one.rms < SECOND * usual), key=lambda f: f.rms)[:FINALISTS]:
        name = brief.model.effects[-1].name
        again = carried(base, noted(brief, base.moves), FIRST_ROUNDS)
        if again.rms < SECOND * trials[name].train_rms:
            nearer = judged(scene, present, settled(again, ROUNDS))
            if nearer.train_rms < best.train_rms and may_be_named(present, nearer):
                nearer = ended(scene, nearer)
            out[name] = min((trials[name], nearer), key=distance)
    return out


def by_other_laws(
    scene: Scene,
    present: Trial[Explained],
    tried: Sequence[Candidate],
    trials: Mapping[str, Trial[Explained]],
) -> dict[str, Trial[Explained]]:
    """Where the nearest of all leaves more than the right one does, what does nearly the same by another law, begun in
    each of its shapes where that one ended, by name, and ended where it is about as near: a likeness has found the
    machine, and hardly differs there."""
    best = min(trials.values(), key=distance)
    if not may_be_likeness(best):
        return {}
    found, out = best.model.fitted, dict[str, Trial[Explained]]()
    values = values_at(found)
    for candidate in tried:
        other = replace(found, model=candidate.model)
        begun = [
            fitted_from(other, values | dict(numbers), ROUNDS)
            for numbers in candidate.effect.imitating(values)
        ]
        if begun:
            trial = judged(scene, present, min(begun, key=lambda f: f.rms))
            if distance(trial) < AGAINST * distance(best):
                trial = ended_if_named(scene, present, trial)
            out[candidate.name] = min((trials[candidate.name], trial), key=distance)
    return out


def as_near(
    scene: Scene, present: Trial[Explained], trials: Mapping[str, Trial[Explained]]
) -> dict[str, Trial[Explained]]:
    """Where the nearest of all leaves more than the right one does, the next with their fits ended, by name, of those
    that explain nearly all and are not far behind: on a chain that is not the machine's, and that a fit leaves over a
    ridge only, the right one stands behind its likeness."""
    best = min(trials.values(), key=distance)
    if not may_be_likeness(best):
        return {}
    near = {
        name: distance(trial)
        for name, trial in trials.items()
        if not trial.model.ended
        and gone_from_all(present, trial, EXPLAINED)
        and distance(trial) <= BEHIND * distance(best)
    }
    return {
        name: min((trials[name], ended_if_named(scene, present, trials[name])), key=distance)
        for name in leading(near, FINALISTS)
    }


def may_be_likeness(best: Trial[Explained]) -> bool:
    """Whether the nearest of all is near and yet leaves more than the right one does."""
    return best.train_rms < SOUND and max(best.train_rms, best.validation_rms) > ENDED


def describes_all(present: Trial[Explained], trial: Trial[Explained]) -> bool:
    """Whether a model describes the moves that were fitted and the others, or next to all that the present one leaves
    of both, with numbers that there are."""
    described = max(trial.train_rms, trial.validation_rms) <= DESCRIBED
    return (described or gone_from_all(present, trial, WHOLLY)) and not trial.at_limits


def may_be_named(present: Trial[Explained], trial: Trial[Explained]) -> bool:
    """Whether a fit may be that of a name once it is ended: next to nothing is left of the moves that it was fitted to,
    or not much, or half of what the present one leaves is gone, and the motors do not speak against it."""
    if trial.train_rms <= LEFT_BY_CLEAN:
        return True
    near = trial.train_rms <= LEFT or gone(present.train_rms, trial.train_rms, PART)
    return near and not plainly_against(present, trial)


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


def finished(
    scene: Scene, present: Trial[Explained], trials: Mapping[str, Trial[Explained]]
) -> dict[str, Trial[Explained]]:
    """The trials, those of the finalists with the motor's motion reconstructed from them, and ended if they may be
    named; what swings comes last, and only if it is not far behind; where none is anywhere near, the nearest alone.
    What takes a part of what the present model leaves is led over ridges even where it is hopeless: the right effect
    may stand there on a wrong chain. They are tried on each other's machines. The nearest is led on over further ridges
    before any is ended, unless it is near and the motors speak against it; what one of them contains is begun where it
    stands, and ended before it; what is far behind one that is ended and describes all is not. What comes closest to
    the moves that it was fitted to, and describes them, is ended even if it describes the others not much worse: it may
    be the right one."""
    out, done = dict(trials), list[str]()
    last = finalists(trials)
    if min(trials[name].train_rms for name in last) > FAR_OFF * HOPELESS:
        last = last[:1]
    for name in sorted(last, key=lambda name: swings_at_all(trials[name].model.fitted.model)):
        nearest = min((out[other].train_rms for other in done), default=np.inf)
        if nearest > ENDED or out[name].train_rms < BEHIND * nearest:
            part = gone(present.train_rms, out[name].train_rms, PART)
            found, ridges = with_own_errors(out[name].model.fitted), HOWEVER_FAR if part else OF_ADDED
            out[name] = judged(scene, present, settled(found, ROUNDS, ridges))
            done.append(name)
    out |= on_better_machines(scene, present, {name: out[name] for name in done})
    name = min(done, key=lambda name: out[name].train_rms)
    if out[name].train_rms >= HOPELESS or not plainly_against(present, out[name]):
        out[name] = led_further(scene, present, out[name])
    sound = [name for name in done if not out[name].at_limits]
    near = leading({name: distance(out[name]) for name in sound}, FINALISTS)
    first = min(done, key=lambda name: distance(out[name]))
    closest = min(sound, key=lambda name: out[name].train_rms, default=first)
    contained = [(name, inner) for name in {first, *near} for inner in DRIVEN[name].contains if inner in out]
    for name, inner in contained:
        out[inner] = begun_there(scene, present, out[inner], out[name])
    near += [inner for _, inner in contained]
    for name in sorted({first, *near}, key=lambda name: len(out[name].model.fitted.model.parameters)):
        if not (inner_suffices(name, out) or outdone(name, present, out)):
            out[name] = ended_if_named(scene, present, out[name])
    if inner_suffices(closest, out):
        return out
    return out | {closest: to_the_end(scene, out[closest], DESCRIBED, AS_WELL)}


def begun_there(
    scene: Scene, present: Trial[Explained], inner: Trial[Explained], outer: Trial[Explained]
) -> Trial[Explained]:
    """The trial of what another effect contains, or a nearer one that is begun where that one ended: else it is not
    judged by what it explains, but by the valley in which it was left."""
    found = inner.model.fitted
    again = as_other(found, outer.model.fitted)
    if again is found:
        return inner
    return min(inner, judged(scene, present, settled(again, ROUNDS, HOWEVER_FAR)), key=distance)


def on_better_machines(
    scene: Scene, present: Trial[Explained], trials: Mapping[str, Trial[Explained]]
) -> dict[str, Trial[Explained]]:
    """The trials, or nearer ones with the same effect, begun on the machine of another that foretells the held-out
    moves better and is about as near to those that were fitted: two effects may do much the same in these, on two
    machines, and only one of the machines is right."""
    out = dict(trials)
    for name, other in permutations(leading({n: t.train_rms for n, t in trials.items()}, FINALISTS), 2):
        there = trials[other]
        if there.validation_rms < SECOND * out[name].validation_rms:
            found, machine = out[name].model.fitted, values_at(there.model.fitted)
            values = values_at(found)
            again = fitted_from(found, values | {k: v for k, v in machine.items() if k in values}, ROUNDS)
            out[name] = min(out[name], judged(scene, present, again), key=distance)
    return out


def ended_if_named(scene: Scene, present: Trial[Explained], trial: Trial[Explained]) -> Trial[Explained]:
    """The trial with its fit ended where it may be named, as it is or with its effects as they are simulated for a
    value."""
    if may_be_named(present, trial):
        return to_the_end(scene, trial)
    full = as_for_a_value(scene, trial)
    return to_the_end(scene, full) if full is not trial and may_be_named(present, full) else full


def as_for_a_value(scene: Scene, trial: Trial[Explained]) -> Trial[Explained]:
    """The trial of a fit that is not far off with its effects as they are simulated for a value, if that is nearer: a
    law in coarser pieces may have driven the chain to where the motors speak against it."""
    found = trial.model.fitted
    full = in_full(found) if trial.train_rms <= LEFT else found
    nearer = full is not found and full.rms < SECOND * trial.train_rms
    return trial_of(scene, full) if nearer else trial


def judged(scene: Scene, present: Trial[Explained], found: Fitted) -> Trial[Explained]:
    """The trial of a fit, with the motors' motion in the held-out moves followed only where it may be named."""
    brief = trial_of(scene, found, thorough=False)
    return trial_of(scene, found) if may_be_named(present, brief) else brief


def led_further(scene: Scene, present: Trial[Explained], trial: Trial[Explained]) -> Trial[Explained]:
    """The trial, or one of its fit led on; also of a hopeless one, if a part of what the present model leaves is gone:
    the right effect may stand there on a wrong chain."""
    part = gone(present.train_rms, trial.train_rms, PART)
    further = led_on(trial.model.fitted, np.inf if part else HOPELESS, (scene.smooth,))
    return trial if further is trial.model.fitted else trial_of(scene, further)


def inner_suffices(name: str, trials: Mapping[str, Trial[Explained]]) -> bool:
    """Whether an effect contains one whose fit is ended and leaves next to nothing: what it has beside that explains
    nothing more."""
    inner = (trials[other] for other in DRIVEN[name].contains if other in trials)
    return any(trial.model.ended and shown(trial) <= LEFT_BY_CLEAN for trial in inner)


def outdone(name: str, present: Trial[Explained], trials: Mapping[str, Trial[Explained]]) -> bool:
    """Whether an effect is far behind another whose fit is ended and describes all moves, and whose law is not nearly
    its own: it would be ended in vain."""
    far = distance(trials[name])
    return any(
        trial.model.ended
        and describes_all(present, trial)
        and far > BEHIND * distance(trial)
        and name not in DRIVEN[other].nearly
        for other, trial in trials.items()
    )


def in_best_shape(
    scene: Scene, base: Fitted, candidate: Candidate, trial: Trial[Explained]
) -> Trial[Explained]:
    """The candidate's trial, or a nearer one of another shape. Where the present fit describes the moves that were
    fitted, they hardly tell a shape, such as how friction depends on speed, which shows in other moves: each is fitted
    and judged there, so that the held-out moves choose among a few shapes of one effect as they do among effects. So
    are standard sizes, as long as no more is missing than what every machine has may leave."""
    fits = list(all_shapes(base, candidate))
    fits += (
        standard(base, replace(candidate, effect=effect, model=with_last(candidate.model, effect)))
        for effect in (candidate.effect.standards if base.rms < SOUND else ())
    )
    return min((trial, *(trial_of(scene, f, thorough=False) for f in fits)), key=distance)


def in_other_shapes(
    scene: Scene, base: Fitted, candidate: Candidate, trial: Trial[Explained]
) -> Trial[Explained]:
    """The candidate's trial, or where its fit was ended and yet describes its own moves only, the nearest of its shapes
    that are ended, too: until then the friction of another shape hides in the viscous one."""
    if not (trial.model.ended and describes_its_own_only(trial)):
        return trial
    others = (trial_of(scene, settled(f, ROUNDS)) for f in all_shapes(base, candidate))
    return min((trial, *(ended(scene, one) for one in others)), key=distance)


def all_shapes(base: Fitted, candidate: Candidate) -> Iterator[Fitted]:
    """The candidate in every shape of friction, where the train moves do not tell it."""
    if candidate.effect.bends_friction and base.rms < DESCRIBED:
        for shape in scored(base, candidate, values_at(base)):
            yield shaped(base, candidate, shape)


def with_last(model: Model, effect: DrivenEffect) -> Model:
    """The model with another effect in the place of its last."""
    return replace(model, effects=(*model.effects[:-1], effect))


def standard(base: Fitted, candidate: Candidate) -> Fitted:
    """The candidate on all moves, with a number of a standard size, from the best of its starts."""
    moves, model = unanswering(base.moves), candidate.model
    begun = (
        fit(moves, model, begun_at(moves, model, values, widened(base.at.local, model)), GLIMPSE)
        for values in scored(base, candidate, values_at(base))
    )
    best = min(begun, key=lambda f: f.rms)
    return fit(moves, model, best.at, ROUNDS)


def shaped(base: Fitted, candidate: Candidate, shape: Values) -> Fitted:
    """The candidate on all moves, begun with next to nothing of the effect: friction is fitted first, then all but the
    effect's shape, then all."""
    model, moves = candidate.model, unanswering(base.moves)
    amounts = {p.name for p in candidate.effect.parameters if p.dose}
    form = {p.name for p in candidate.effect.parameters if not p.dose}
    names = [p.name for p in model.parameters]
    friction = [k for k, name in enumerate(names) if name in amounts or name.endswith(GUIDE)]
    all_but_shape = [k for k, name in enumerate(names) if name not in form]
    at = begun_at(moves, model, hardly_any(candidate, shape), widened(base.at.local, model))
    found = fit(moves, model, at, FIRST_ROUNDS, free=np.array(friction))
    found = fit(moves, model, found.at, ROUNDS, free=np.array(all_but_shape))
    return fit(moves, model, found.at, ROUNDS)


def fitted_on(base: Fitted, found: dict[str, Fitted], tried: Sequence[Candidate]) -> None:
    """The best of the fits continued and led across samples, then what they contain and what does much the same as the
    best, begun there. Where the present fit describes the moves already, what is missing shows in others, and hardly in
    how near a fit comes: all are continued."""
    nearest = leading({name: one.rms for name, one in found.items()}, PROMISING)
    for name in nearest if base.rms > ENDED else list(found):
        found[name] = fit(found[name].moves, found[name].model, found[name].at, ROUNDS)
    for name in leading({name: one.rms for name, one in found.items()}, PROMISING, FAR_OFF):
        found[name] = across(found[name]) if found[name].rms > ENDED else found[name]
    for candidate in tried:
        for inner in set(candidate.effect.contains) & set(found):
            found[inner] = as_other(found[inner], found[candidate.name])
    best = min(found.values(), key=lambda f: f.rms)
    for candidate in tried:
        if candidate.effect.instead(values_at(best)) and found[candidate.name] is not best:
            found[candidate.name] = as_other(found[candidate.name], best)


def to_the_end(
    scene: Scene, trial: Trial[Explained], near: float = SOUND, as_well: float = UNKNOWN_NUMBERS
) -> Trial[Explained]:
    """The trial with its fit ended where it is `near` the moves that it was fitted to, but does not describe the others
    `as_well`: the noise of the speed, taken for the motor's motion, may have driven its numbers away."""
    return ended(scene, trial) if trial.train_rms < near and describes_its_own_only(trial, as_well) else trial


def describes_its_own_only(trial: Trial[Explained], as_well: float = UNKNOWN_NUMBERS) -> bool:
    """Whether the moves that were fitted are described better than the others, by more than `as_well`."""
    return trial.validation_rms > as_well * max(1.0, trial.train_rms)


def leading(found: Mapping[str, float], count: int, behind: float = BEHIND) -> list[str]:
    """The names of the nearest, none that is so far `behind` the nearest."""
    least = min(found.values(), default=np.inf)
    return [
        name for name in sorted(found, key=lambda name: found[name])[:count] if found[name] <= behind * least
    ]


def finalists(trials: Mapping[str, Trial[Explained]]) -> list[str]:
    """The nearest to all moves, and the nearest to those that were fitted: where a fit has not ended, each may
    mislead."""
    by_train = leading({name: trial.train_rms for name, trial in trials.items()}, 1)
    return list(dict.fromkeys([*leading({n: distance(t) for n, t in trials.items()}, FINALISTS), *by_train]))


def challenged(scene: Scene, present: Trial[Explained], best: Trial[Explained]) -> Trial[Explained]:
    """The present model fitted once more from where the best candidate ended, without the candidate's effect, so that
    no effect is named for having led the fit out of a poor valley; which valley is the better one, the best has found.
    Where the candidate ended with gear and pinion apart, so does the present model begin, and every move as the
    candidate left it or where it is found to rest, which is elsewhere without the candidate's effect."""
    now, other = present.model.fitted, best.model.fitted
    model = replace(now.model, lumps=other.model.lumps)
    moves = [
        replace(theirs, expected=own.expected, judged=own.judged, wander=own.wander)
        for theirs, own in zip(other.moves, now.moves, strict=True)
    ]
    own = tuple(local[:, : width(model)] for local in other.at.local)
    again = fit(moves, model, begun_at(moves, model, values_at(other), own), ROUNDS)
    if again.rms < BEHIND * now.rms and again.rms < HOPELESS:
        again = settled(again, ROUNDS, (np.inf, np.inf))
    return trial_of(scene, again) if again.rms < 0.99 * now.rms else present


def without(scene: Scene, trial: Trial[Explained], name: str) -> Trial[Explained]:
    """The model without one of its effects, fitted once more from where it stands and to the end."""
    found = trial.model.fitted
    effects = tuple(effect for effect in found.model.effects if effect.name != name)
    model = replace(found.model, effects=effects)
    places = 2 * len(model.axes)
    nuisance = [p.name for p in found.model.nuisance]
    own = [*range(places), *(places + nuisance.index(p.name) for p in model.nuisance)]
    numbers = [p.name for p in found.model.parameters]
    shared = found.at.shared[[numbers.index(p.name) for p in model.parameters]]
    again = fit(found.moves, model, Point(shared, tuple(local[:, own] for local in found.at.local)), ROUNDS)
    return ended(scene, trial_of(scene, settled(again, ROUNDS)))
