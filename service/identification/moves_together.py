"""Two effects that are found together only.

One after the other they may both be missed: what is fitted beside the second one bends the machine, and ends in a wrong
valley. All smooth effects at once, and one that is not beside them, lead a fit to the machine as it is, whichever act.
How much each of them is needed there is told by its covariance, without another fit (the rise of a sum of squares under
linear constraints; Seber and Wild, Nonlinear Regression, 1989, section 5.3), and the few pairs with which least is left
are fitted.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import chain, combinations, product

import numpy as np

from service.backlash.moves import Moves
from service.backlash.moves_begun import Values, point_at
from service.backlash.moves_fit import Fitted, fit, values_at
from service.backlash.moves_point import width
from service.backlash.moves_refined import reconstructed
from service.dynamics.driven_model import DrivenEffect, Model
from service.identification.held_out import DESCRIBED, Explained, trial_of
from service.identification.moves_carried import FIRST_ROUNDS, refitted
from service.identification.moves_end import RIDGE, SOUND, ended, led_on, settled
from service.identification.moves_finals import BEHIND, FINALISTS, described
from service.identification.moves_looks import (
    AS_NEAR,
    ENDED,
    FROM_AFAR,
    best_looks,
    better_half,
    glimpsed,
    looked_at,
    nearest,
)
from service.identification.moves_starts import (
    ROUNDS,
    SUMMED,
    across_samples,
    as_measured,
    begun_at,
    candidates,
    fewer,
    fitted_from,
    likely,
    of_speed,
    unanswering,
)
from service.identification.scene import NOT_SMOOTH, Scene
from service.identification.selection import (
    CHANGED,
    EXPLAINED,
    LEFT,
    NEAR,
    PART,
    UNKNOWN_NUMBERS,
    WHOLLY,
    Trial,
    distance,
    gone,
    gone_from_all,
    most_left,
)
from service.recording import FloatArray

PAIRS = 4
"""Pairs that are fitted (chosen)."""
ALL_BUT = 0.99
"""Share of the excess variance that two effects explain which leave something (chosen: the nearest two beside a film of
oil explained 0.97, a body and a friction curve of another law 0.995)."""
NO_OTHERS = (np.inf, 0.0)
"""That no other valley is looked for."""


def pairs(
    scene: Scene, before: Trial[Explained], library: Sequence[type[DrivenEffect]], tell: Callable[[str], None]
) -> list[Trial[Explained]]:
    """Fits with two of the library's effects that are all that is missing, the nearest first: two smooth ones, or where
    no such two are all, a smooth one and one that is not."""
    smooth = with_all_smooth(scene, before.model.fitted, library)
    if smooth is None:
        return []
    tell(f"all smooth effects together: {smooth.rms:.3f} (now {before.train_rms:.3f})")
    if leads(before, smooth.rms) and (found := fitted_pairs(scene, before, smooth, (), library, tell)):
        return found
    other = with_one_beside(scene, before, smooth, library)
    if other is None:
        return []
    beside = other.model.effects[-1].name
    tell(f"with {beside} beside them: {other.rms:.3f}")
    return fitted_pairs(scene, before, other, (beside,), library, tell)


def are_all(before: Trial[Explained], trial: Trial[Explained], found: Fitted) -> bool:
    """Whether two effects of a fit with many describe all moves, or leave not much, however their laws differ from the
    machine's: next to all is gone that is missing without them, and the moves that were fitted are described; or all
    but a hundredth is, and they leave hardly more of these than all effects do."""
    if described(trial):
        return True
    if most_left(trial) > LEFT or trial.at_limits:
        return False
    if trial.train_rms <= DESCRIBED:
        return gone_from_all(before, trial, WHOLLY)
    return gone_from_all(before, trial, ALL_BUT) and trial.train_rms <= (1.0 + NEAR) * found.rms


def added(before: Trial[Explained], trial: Trial[Explained]) -> tuple[str, ...]:
    """The effects that a trial has beyond those of the model before, by name."""
    held = {effect.name for effect in before.model.fitted.model.effects}
    return tuple(e.name for e in trial.model.fitted.model.effects if e.name not in held)


def leads(before: Trial[Explained], rms: float) -> bool:
    """Whether many effects together explain so much that two of them may be all."""
    return gone(before.train_rms, rms, PART if rms <= LEFT else EXPLAINED)


def may_be_all(before: Trial[Explained], rms: float) -> bool:
    """Whether two effects that leave so much of a few moves may be all, once they are fitted to all moves."""
    return rms <= AS_NEAR * DESCRIBED or gone(before.train_rms, rms, WHOLLY)


def with_all_smooth(scene: Scene, present: Fitted, library: Sequence[type[DrivenEffect]]) -> Fitted | None:
    """The present model with all smooth effects of the library that it lacks, fitted to all moves, from where it stands
    or, where that does not describe a few moves, from the scene's places; none where there are fewer than two."""
    smooth = tuple(kind(present.model.axes) for kind in library if kind.name not in NOT_SMOOTH)
    if len(smooth) < 2:
        return None
    model = replace(present.model, effects=(*present.model.effects, *smooth))
    few = as_measured(fewer(present))
    best = begun(few, model, values_at(present))
    if best.rms > DESCRIBED:
        best = min(best, begun_at_places(few, model, scene), key=lambda f: f.rms)
    return on_all_moves(present.moves, best)


def with_one_beside(
    scene: Scene, before: Trial[Explained], smooth: Fitted, library: Sequence[type[DrivenEffect]]
) -> Fitted | None:
    """The model with all smooth effects and the one of the others which is nearest to a few moves beside them, fitted
    to all; none where too much is left."""
    others = [kind for kind in library if kind.name in NOT_SMOOTH and not kind.many_valleys]
    tried = candidates(smooth.model, others, ())
    if not tried:
        return None
    looks = {one.name: looked_at(glimpsed(smooth, one, likely(scene, smooth, one))) for one in tried}
    best = min(tried, key=lambda one: nearest(looks[one.name]))
    brief = best_looks(looks[best.name], smooth, best)
    if not leads(before, brief[0].rms):
        return None
    found = on_all_moves(smooth.moves, refitted(smooth, brief, np.inf)[0])
    return found if found.rms <= LEFT and leads(before, found.rms) else None


def begun(few: Sequence[Moves], model: Model, place: Values) -> Fitted:
    """The nearest of fits of a few moves begun at a place, where the loads' speeds are described best, which have a
    slope from wherever a flank is met, and at once; or the first that describes them."""
    at, tried = point_at(model, place, few), list[Fitted]()
    for lasting in (*SUMMED, None):
        first = at if lasting is None else fit(of_speed(few, lasting), model, at, ROUNDS).at
        tried.append(fit(few, model, first, ROUNDS))
        if tried[-1].rms <= DESCRIBED:
            break
    return min(tried, key=lambda f: f.rms)


def begun_at_places(few: Sequence[Moves], model: Model, scene: Scene) -> Fitted:
    """The nearest of fits of a few moves begun where the loads' speeds are described best from the scene's places: of
    these the better half goes on (successive halving)."""
    found = list[Fitted]()
    for lasting in SUMMED:
        speeds = [
            fit(of_speed(few, lasting), model, point_at(model, place, few), FIRST_ROUNDS)
            for place in scene.places
        ]
        found += [fit(few, model, f.at, FROM_AFAR) for f in better_half(speeds)]
    return min(found, key=lambda f: f.rms)


def on_all_moves(moves: Sequence[Moves], few: Fitted) -> Fitted:
    """The model of a fit of a few moves fitted to all, with the motion that it makes."""
    found = fit(moves, few.model, begun_at(moves, few.model, values_at(few)), ROUNDS)
    return fit(reconstructed(found), found.model, found.at, ROUNDS)


def fitted_pairs(
    scene: Scene,
    before: Trial[Explained],
    found: Fitted,
    beside: tuple[str, ...],
    library: Sequence[type[DrivenEffect]],
    tell: Callable[[str], None],
) -> list[Trial[Explained]]:
    """The pairs of effects of a fit with many that are needed most, fitted, the nearest first; those of the nearest are
    ended that may be all, until one is and the next is not as near."""
    few = unanswering(fewer(found))
    pairs = ranked(before.model.fitted, found, beside)[:PAIRS]
    two = {names: begun_two(before.model.fitted, found, names, few) for names in pairs}
    least = min(f.rms for f in two.values())
    if not may_be_all(before, least):
        return []
    trials = list[Trial[Explained]]()
    for names in pairs:
        if two[names].rms <= AS_NEAR * least:
            trials.append(trial_of(scene, fitted_two(found.moves, two[names])))
            of_all, held = trials[-1].train_rms, trials[-1].validation_rms
            tell(f"tried {' and '.join(names)}: {of_all:.3f}, held out {held:.3f}")
    first, *others = sorted(trials, key=distance)
    out = [to_its_end(scene, before, first)]
    likely_too = (nearer_instead(scene, trial, first) for trial in others)
    for trial in chain(exchanged(scene, first, library), likely_too):
        behind = 1.0 + NEAR if most_left(out[0]) <= ENDED else BEHIND
        behind = behind if most_left(out[0]) <= LEFT else RIDGE
        if distance(trial) <= behind * distance(out[0]):
            out.append(to_its_end(scene, before, trial))
        if len(out) == FINALISTS:
            break
    return sorted((t for t in out if are_all(before, t, found)), key=distance)


def exchanged(
    scene: Scene, first: Trial[Explained], library: Sequence[type[DrivenEffect]]
) -> list[Trial[Explained]]:
    """The nearest pair with one of its effects exchanged for one that does nearly the same, and that is not among the
    smooth ones for that; begun where it ended. None where it is as near as a right one comes."""
    if most_left(first) <= ENDED:
        return []
    found, out = first.model.fitted, list[Trial[Explained]]()
    there, effects = values_at(found), found.model.effects
    others = [kind(found.model.axes) for kind in library if kind.name in NOT_SMOOTH]
    for k, other in product(range(len(effects)), others):
        if other.name in effects[k].nearly:
            model = replace(found.model, effects=(*effects[:k], other, *effects[k + 1 :]))
            out.append(begun_as(scene, replace(found, model=model), {**there, **other.instead(there)}))
    return out


def nearer_instead(scene: Scene, trial: Trial[Explained], first: Trial[Explained]) -> Trial[Explained]:
    """The trial, or one that is begun where the nearest pair ended, if that has something in its place which does much
    the same: a delay and a filter each have a chain on which they describe the moves."""
    there, held = values_at(first.model.fitted), first.model.fitted.model.effects
    found = trial.model.fitted
    numbers = [e.instead(there) for e in found.model.effects if e not in held]
    if not any(numbers):
        return trial
    values = there | {name: value for own in numbers for name, value in own.items()}
    return min(trial, begun_as(scene, found, values), key=distance)


def begun_as(scene: Scene, found: Fitted, values: Values) -> Trial[Explained]:
    """The trial of the model of a fit that is begun with these values."""
    return trial_of(scene, settled(fitted_from(found, values, ROUNDS), ROUNDS, NO_OTHERS))


def to_its_end(scene: Scene, before: Trial[Explained], trial: Trial[Explained]) -> Trial[Explained]:
    """The trial, its fit led over ridges where it explains nearly all and leaves something, and ended if it may be the
    right one."""
    if gone(before.train_rms, trial.train_rms, EXPLAINED) and trial.train_rms > UNKNOWN_NUMBERS:
        further = led_on(trial.model.fitted)
        trial = trial if further is trial.model.fitted else trial_of(scene, further)
    near = trial.train_rms <= UNKNOWN_NUMBERS or gone(before.train_rms, trial.train_rms, WHOLLY)
    return ended(scene, trial) if near and trial.train_rms <= LEFT and most_left(trial) <= CHANGED else trial


def ranked(present: Fitted, found: Fitted, beside: tuple[str, ...]) -> list[tuple[str, str]]:
    """The pairs of effects that a fit has and the present one lacks, two of them, or one and what is `beside`, by the
    RMS that would be left without the others: the least first, and none that is far behind it."""
    held = {effect.name for effect in present.model.effects}
    more = [effect for effect in found.model.effects if effect.name not in held]
    C, at = own_covariance(found), np.concatenate((found.at.shared, *map(np.ravel, found.at.local)))

    def left(names: Sequence[str]) -> float:
        absent = [k for e in more if e.name not in names for k in amounts(found, e)]
        rise = float(at[absent] @ np.linalg.solve(C[np.ix_(absent, absent)], at[absent]))
        return float(np.sqrt((found.r @ found.r + rise) / len(found.r)))

    rest = [effect.name for effect in more if effect.name not in beside]
    named = [(*some, *beside) for some in combinations(rest, 2 - len(beside))]
    least, *_ = by_left = sorted((left(names), (names[0], names[1])) for names in named)
    return [names for rms, names in by_left if rms <= BEHIND * least[0]]


def amounts(found: Fitted, effect: DrivenEffect) -> list[int]:
    """Where the coordinates of a fit lie that are 0 without an effect: its amounts, and what it has of every move."""
    names = [p.name for p in found.model.parameters]
    own = [2 * len(found.model.axes) + found.model.nuisance.index(p) for p in effect.nuisance]
    moves = range(sum(len(local) for local in found.at.local))
    of_moves = [len(names) + t * width(found.model) + k for t in moves for k in own]
    return [names.index(p.name) for p in effect.parameters if p.dose] + of_moves


def own_covariance(found: Fitted) -> FloatArray:
    """Covariance (size, size) of all coordinates of a fit, the shared ones first, as if the residuals were white."""
    J = found.slopes.dense()
    return np.asarray(np.linalg.inv(J.T @ J + np.eye(J.shape[1])))


def begun_two(present: Fitted, found: Fitted, names: tuple[str, str], few: Sequence[Moves]) -> Fitted:
    """The present model with two effects of a fit with many, begun with the numbers that they have there, and fitted to
    a few moves."""
    effects = [next(e for e in found.model.effects if e.name == name) for name in names]
    model = replace(present.model, effects=(*present.model.effects, *effects))
    values = values_at(found)
    return begun(few, model, {p.name: values[p.name] for p in model.parameters})


def fitted_two(moves: Sequence[Moves], few: Fitted) -> Fitted:
    """A fit of two effects to a few moves led on to all."""
    best = across_samples(few.moves, few) if few.rms > UNKNOWN_NUMBERS else few
    on = on_all_moves(moves, best)
    return settled(on, ROUNDS, NO_OTHERS) if on.rms <= SOUND else on
