"""Two effects that are found together only.

One after the other they may both be missed: what is fitted beside the second one bends the machine, and ends in a wrong
valley. All smooth effects at once, and one that is not beside them, lead a fit to the machine as it is, whichever act.
How much each of them is needed there is told by its covariance, without another fit (the rise of a sum of squares under
linear constraints; Seber and Wild, Nonlinear Regression, 1989, section 5.3), and the few pairs with which least is left
are fitted.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from service.backlash.moves import Moves
from service.backlash.moves_begun import Values, point_at
from service.backlash.moves_fit import Fitted, fit, values_at
from service.backlash.moves_refined import reconstructed
from service.dynamics.driven_model import DrivenEffect, Model
from service.identification.held_out import DESCRIBED, Explained, trial_of
from service.identification.moves_carried import refitted
from service.identification.moves_end import SOUND, ended, settled
from service.identification.moves_finals import BEHIND, described
from service.identification.moves_looks import best_looks, glimpsed, looked_at, nearest
from service.identification.moves_starts import (
    ROUNDS,
    SUMMED,
    across_samples,
    as_measured,
    begun_at,
    candidates,
    fewer,
    likely,
    speeds_first,
    unanswering,
)
from service.identification.scene import NOT_SMOOTH, Scene
from service.identification.selection import (
    EXPLAINED,
    LEFT,
    PART,
    UNKNOWN_NUMBERS,
    Trial,
    distance,
    gone,
    gone_from_all,
    most_left,
)
from service.recording import FloatArray

PAIRS = 3
"""Pairs that are fitted (chosen)."""
ALL_BUT = 0.99
"""Share of the excess variance that two effects explain which leave something (chosen: the nearest two beside a film of
oil explained 0.97, a body and a friction curve of another law 0.995)."""
NO_OTHERS = (np.inf, 0.0)
"""That no other valley is looked for."""


def pairs(
    scene: Scene, before: Trial[Explained], library: Sequence[type[DrivenEffect]], tell: Callable[[str], None]
) -> list[Trial[Explained]]:
    """Fits with two of the library's effects, the nearest first: two smooth ones, or where these do not describe all
    moves one that is not beside a smooth one."""
    smooth = with_all_smooth(scene, before.model.fitted, library)
    if smooth is None:
        return []
    tell(f"all smooth effects together: {smooth.rms:.3f} (now {before.train_rms:.3f})")
    found = list[Trial[Explained]]()
    if leads(before, smooth.rms):
        found = fitted_pairs(scene, before, smooth, (), tell)
    if any(are_all(before, trial) for trial in found):
        return found
    other = with_one_beside(scene, before, smooth, library)
    if other is None:
        return found
    beside = other.model.effects[-1].name
    tell(f"with {beside} beside them: {other.rms:.3f}")
    return sorted([*found, *fitted_pairs(scene, before, other, (beside,), tell)], key=distance)


def are_all(before: Trial[Explained], trial: Trial[Explained]) -> bool:
    """Whether two effects describe all moves, or not much is left, however their laws differ from the machine's, and
    that a hundredth of what is missing without them: what no library has, two effects imitate less well."""
    nearly = most_left(trial) <= LEFT and gone_from_all(before, trial, ALL_BUT) and not trial.at_limits
    return nearly or described(trial)


def added(before: Trial[Explained], trial: Trial[Explained]) -> tuple[str, ...]:
    """The effects that a trial has beyond those of the model before, by name."""
    held = {effect.name for effect in before.model.fitted.model.effects}
    return tuple(e.name for e in trial.model.fitted.model.effects if e.name not in held)


def leads(before: Trial[Explained], rms: float) -> bool:
    """Whether many effects together explain so much that two of them may be all."""
    return gone(before.train_rms, rms, PART if rms <= LEFT else EXPLAINED)


def with_all_smooth(scene: Scene, present: Fitted, library: Sequence[type[DrivenEffect]]) -> Fitted | None:
    """The present model with all smooth effects of the library that it lacks, fitted to all moves; none where there are
    fewer than two."""
    added = tuple(kind(present.model.axes) for kind in library if kind.name not in NOT_SMOOTH)
    if len(added) < 2:
        return None
    model = replace(present.model, effects=(*present.model.effects, *added))
    few = as_measured(fewer(present))
    starts = (found for place in (values_at(present), scene.smooth) for found in begun(few, model, place))
    return on_all_moves(present.moves, nearest_of(starts))


def with_one_beside(
    scene: Scene, before: Trial[Explained], smooth: Fitted, library: Sequence[type[DrivenEffect]]
) -> Fitted | None:
    """The model with all smooth effects and the one of the others which is nearest to a few moves beside them, fitted
    to all; none where it does not lead."""
    others = [kind for kind in library if kind.name in NOT_SMOOTH and not kind.many_valleys]
    tried = candidates(smooth.model, others, ())
    looks = {one.name: looked_at(glimpsed(smooth, one, likely(scene, smooth, one))) for one in tried}
    if not tried:
        return None
    best = min(tried, key=lambda one: nearest(looks[one.name]))
    brief = best_looks(looks[best.name], smooth, best)
    return (
        on_all_moves(smooth.moves, refitted(smooth, brief, np.inf)[0])
        if leads(before, brief[0].rms)
        else None
    )


def begun(few: Sequence[Moves], model: Model, place: Values) -> Iterator[Fitted]:
    """Fits of a few moves begun at a place: where the loads' speeds are described best, which have a slope from
    wherever a flank is met, and at once."""
    at = point_at(model, place, few)
    for lasting in SUMMED:
        yield speeds_first(few, model, at, lasting, ROUNDS)
    yield fit(few, model, at, ROUNDS)


def nearest_of(starts: Iterator[Fitted]) -> Fitted:
    """The nearest of fits, which are made until one describes its moves."""
    tried = list[Fitted]()
    for found in starts:
        tried.append(found)
        if found.rms <= DESCRIBED:
            break
    return min(tried, key=lambda f: f.rms)


def on_all_moves(moves: Sequence[Moves], few: Fitted) -> Fitted:
    """The model of a fit of a few moves fitted to all, with the motion that it makes, and settled if it is near."""
    found = fit(moves, few.model, begun_at(moves, few.model, values_at(few)), ROUNDS)
    found = fit(reconstructed(found), found.model, found.at, ROUNDS)
    return settled(found, ROUNDS, NO_OTHERS) if found.rms <= SOUND else found


def fitted_pairs(
    scene: Scene,
    before: Trial[Explained],
    found: Fitted,
    beside: tuple[str, ...],
    tell: Callable[[str], None],
) -> list[Trial[Explained]]:
    """The pairs of effects of a fit with many that are needed most, fitted, and ended where they may be all and are
    not far behind the nearest."""
    out, closest = list[Trial[Explained]](), np.inf
    for names in ranked(before.model.fitted, found, beside)[:PAIRS]:
        trial = trial_of(scene, with_two(before.model.fitted, found, names))
        if most_left(trial) <= SOUND and distance(trial) <= BEHIND * closest:
            trial = ended(scene, trial)
        tell(f"tried {' and '.join(names)}: {trial.train_rms:.3f}, held out {trial.validation_rms:.3f}")
        closest = min(closest, distance(trial))
        out.append(trial)
    return sorted(out, key=distance)


def ranked(present: Fitted, found: Fitted, beside: tuple[str, ...]) -> list[tuple[str, str]]:
    """The pairs of effects that a fit has and the present one lacks, two of them, or one and what is `beside`, by the
    RMS that would be left without the others: the least first, and none that is far behind it."""
    held = {effect.name for effect in present.model.effects}
    more = [effect for effect in found.model.effects if effect.name not in held]
    C, numbers = own_covariance(found), {p.name: k for k, p in enumerate(found.model.parameters)}

    def left(names: Sequence[str]) -> float:
        others = [p for e in more if e.name not in names for p in e.parameters if p.dose]
        at = [numbers[p.name] for p in others]
        off = found.at.shared[at] - np.array([float(p.internal(0.0)) for p in others])
        rise = float(off @ np.linalg.solve(C[np.ix_(at, at)], off))
        return float(np.sqrt((found.r @ found.r + rise) / len(found.r)))

    rest = [effect.name for effect in more if effect.name not in beside]
    named = [(*some, *beside) for some in combinations(rest, 2 - len(beside))]
    least, *_ = by_left = sorted((left(names), (names[0], names[1])) for names in named)
    return [names for rms, names in by_left if rms <= BEHIND * least[0]]


def own_covariance(found: Fitted) -> FloatArray:
    """(P, P) of the shared coordinates, as if the residuals were white."""
    J, P = found.slopes.dense(), len(found.model.parameters)
    return np.asarray(np.linalg.inv(J.T @ J + np.eye(J.shape[1]))[:P, :P])


def with_two(present: Fitted, found: Fitted, names: tuple[str, str]) -> Fitted:
    """The present model with two effects of a fit with many, begun with the numbers that they have there."""
    effects = [next(e for e in found.model.effects if e.name == name) for name in names]
    model = replace(present.model, effects=(*present.model.effects, *effects), lumps=found.model.lumps)
    few = unanswering(fewer(found))
    values = values_at(found)
    best = nearest_of(begun(few, model, {p.name: values[p.name] for p in model.parameters}))
    best = across_samples(few, best) if best.rms > UNKNOWN_NUMBERS else best
    return on_all_moves(found.moves, best)
