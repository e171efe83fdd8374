"""Which starts of an added effect are worth a fit of all moves: they are compared on a few moves, in two looks.

All candidates are begun (``moves_starts``) and given a few rounds; those that may be right are followed, the nearest
first; where none is as near as a right one comes, more starts are tried.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from service.backlash.moves import Moves
from service.backlash.moves_begun import Values, point_at
from service.backlash.moves_fit import Fitted, fit, values_at
from service.backlash.moves_refined import zeros_alike
from service.dynamics.driven_model import Model
from service.identification.held_out import DESCRIBED, NEAR, overdamped
from service.identification.moves_starts import (
    BRIEF,
    SUMMED,
    Candidate,
    across_samples,
    added,
    begun_at,
    fewer,
    grounds,
    hardly_any,
    heard_on_typical_machines,
    likely,
    of_speed,
    on_a_few_moves,
    on_typical_machine,
    on_typical_machines,
    placed,
    softer_contact,
    speeds_first,
    strong_at,
    strong_either_way,
)
from service.identification.moves_valleys import valleys
from service.identification.scene import NOT_SMOOTH, Scene
from service.identification.selection import EXPLAINED, PART, UNKNOWN_NUMBERS, gone
from service.recording import FloatArray

GLIMPSE, FROM_AFAR = 2, 10
"""Rounds after which a candidate is given up that is far off, and from a start that is far off itself."""
HALF = FROM_AFAR // 2
"""Rounds after which only the best of several such starts are continued."""
STRONG = 3
"""Rounds after which only the best of a candidate's strong starts is continued (chosen)."""
PLACED = 3
"""Shapes with which the numbers of an effect that swings are fitted alone, or that are followed from afar: a spectrum
of few periods has several maxima."""
HALVED = 3
"""How often the better half of the fits of what swings is continued."""
APART = 0.5
"""Difference in any of an effect's numbers, in standard deviations of its prior, that makes it another."""
FAR_OFF = 2.0
"""How much farther from a few moves than the best of all candidates one may be and still be looked at again, and be
fitted to all moves."""
A_PART = 0.8
"""RMS on a few moves, over that of the present fit, up to which an effect is looked at however near another is
(chosen): after a glimpse, a right one may have gone but a part of its way."""
AS_NEAR = 4.0 / 3.0
"""How much farther from a few moves one may be and still be looked at again where the best explains nearly all
(chosen)."""
HOPES = 4
"""How many effects are looked at again (chosen: a right one is mostly the nearest after the first look)."""
ENDED = 1.05
"""RMS up to which a fit need not be begun elsewhere."""
VALLEYS = 4
"""How many fits of an effect with many valleys are fitted to all moves."""
SHARED = 0.5**0.5
"""What the first of two effects leaves of an RMS that each explains half of the variance of."""
HARDLY = 0.9
"""How much nearer to a few moves than the present fit the best further effect must come to be looked at again
(chosen)."""
UNSOUND = 1.5
"""How much farther from the moves a fit stands whose chain is damped as none is (chosen): it is no explanation, but may
become one."""
WITHIN_REACH = 2.5
"""RMS on a few moves from which on a further effect does not come to what two effects may leave (chosen)."""


@dataclass(frozen=True)
class Brief:
    """What a fit of a few moves found: where it stands, its values, and how all moves begin by it."""

    model: Model
    rms: float
    values: Values
    local: tuple[FloatArray, ...]


def standing(found: Fitted) -> float:
    """RMS of a fit by which it is compared with others, larger than it is where its chain is damped as none is: where a
    wrong model ended so, what lies close by comes nearer at first than the right effect on a sound chain."""
    return UNSOUND * found.rms if overdamped(found) else found.rms


def noted(found: Fitted, moves: Sequence[Moves]) -> Brief:
    return Brief(found.model, standing(found), values_at(found), zeros_alike(moves, found))


def compared(
    scene: Scene,
    found: Fitted,
    library: Sequence[Candidate],
    known: float = np.inf,
    taken: Sequence[str] = (),
    sparing: bool = True,
) -> tuple[dict[str, list[Brief]], list[Candidate]]:
    """The best fits of a few moves of every candidate, by name, and where it is `sparing` the candidates that were
    spared their strong starts, for another describes these moves. All are begun; those that are not far off what is
    nearest, also of what is `known` by its RMS, or that may be the right ones, or have gone a part of their way, are
    looked at, and the nearest first, if they are not as near as a right one comes, a second time from more starts; once
    one explains nearly all, or what is known does, only those that are about as near; of all the nearest few. Where
    none is near, all are begun from afar, too, in turn until one is. Where the present fit describes the moves, it is
    no bad start, and no other is tried; of many valleys the first look tells little even there. Where they are out of
    reach, the first look is all; of further effects, which have no strong starts, it is all of each that is hardly
    nearer than the present fit."""
    present = on_a_few_moves(found).rms
    looks, seen, spared = all_glimpsed(scene, found, library, known, sparing, strong=not taken)
    least = min([known, *map(nearest, looks.values())])
    anywhere = max(FAR_OFF * least, NEAR, A_PART * present)
    far = AS_NEAR * known if gone(found.rms, known, EXPLAINED) else anywhere
    hopeful = [one for one in library if nearest(looks[one.name]) < far]
    looks |= {one.name: looked_at(looks[one.name]) for one in hopeful if one.name not in seen}
    least = min([known, *map(nearest, looks.values())])
    if not taken and least > NEAR:
        for some in in_turn(scene, found, library):
            looks |= {one.name: [*looks[one.name], *from_afar(scene, found, one)] for one in some}
            least = min([known, *map(nearest, looks.values())])
            if least <= NEAR:
                break
        hopeful = [one for one in library if nearest(looks[one.name]) < max(FAR_OFF * least, NEAR)]
    out = {one.name: glanced(looks[one.name], found) for one in library}
    enough = enough_of_few(found, taken)
    if out_of_reach(least, found, taken) or least > enough:
        return out, spared
    hopeful = [one for one in hopeful if nearest(looks[one.name]) < enough]
    if found.rms > DESCRIBED:
        hopeful = sorted(hopeful, key=lambda one: nearest(looks[one.name]))[:HOPES]
    split = [one for one in library if one.effect.many_valleys and one not in hopeful]
    places = grounds(scene, found)
    for one in sorted([*hopeful, *split], key=lambda one: nearest(looks[one.name])):
        now = nearest(looks[one.name])
        all_but_gone = gone(found.rms, least, EXPLAINED)
        near = now < (as_near(least, present) if all_but_gone else FAR_OFF * least)
        divided = one.effect.many_valleys and (found.rms < DESCRIBED or not all_but_gone)
        if divided or (near and now > ENDED and found.rms > DESCRIBED):
            looks[one.name] += second_look(scene, found, places, one)
        if divided or near:
            out[one.name] = best_looks(looks[one.name], found, one)
            least = min(least, out[one.name][0].rms)
    return out, spared


def as_near(least: float, present: float) -> float:
    """How near to a few moves is about as near as the best, which explains nearly all, by its RMS and that of the
    present fit: an effect that explains less than half as much is not."""
    return min(AS_NEAR * least, float(np.sqrt(0.5 * (least**2 + max(present, least) ** 2))))


def all_glimpsed(
    scene: Scene, found: Fitted, library: Sequence[Candidate], known: float, sparing: bool, strong: bool
) -> tuple[dict[str, list[Fitted]], set[str], list[Candidate]]:
    """Short fits of a few moves of every candidate, the names of those that were looked at already, and what was spared
    its `strong` starts: the nearest come first, and once one describes the few moves, or something is `known` that
    explains nearly all, the others are spared."""
    begun = {one.name: likely(scene, found, one) for one in library}
    looks = {one.name: glimpsed(found, one, begun[one.name]) for one in library}
    seen, few = set[str](), on_a_few_moves(found).rms
    ranked = sorted(library, key=lambda one: nearest(looks[one.name]))
    for k, one in enumerate(ranked):
        if sparing and gone(few, known, EXPLAINED):
            return looks, seen, [other for other in ranked[k:] if strong and has_strong_starts(found, other)]
        fits = looks[one.name]
        if strong and nearest(fits) > UNKNOWN_NUMBERS:
            fits = fits + strongly_glimpsed(scene, found, one, begun[one.name][0])
        if gone(few, nearest(fits), EXPLAINED):
            fits = looked_at(fits)
            seen.add(one.name)
            known = nearest(fits) if nearest(fits) < UNKNOWN_NUMBERS else known
        looks[one.name] = fits
    return looks, seen, []


def glimpsed(found: Fitted, candidate: Candidate, values: Sequence[Values]) -> list[Fitted]:
    """Fits of a few moves, begun with next to nothing of the candidate and, unless the present fit describes the moves,
    with the values from which it mostly finds to its best one."""
    few = fewer(found)
    near = found.rms < DESCRIBED and not candidate.effect.many_valleys
    starts = [added(found, candidate, hardly_any(candidate, one)) for one in (values if near else values[:1])]
    starts += [] if near else [point_at(candidate.model, one, few) for one in values]
    return [fit(few, candidate.model, at, GLIMPSE) for at in starts]


def strongly_glimpsed(scene: Scene, found: Fitted, candidate: Candidate, shape: Values) -> list[Fitted]:
    """Fits of a few moves, begun with the candidate as strong as it may be and, in a shape, on typical machines."""
    if not has_strong_starts(found, candidate):
        return []
    few = fewer(found)
    typical = point_at(candidate.model, on_typical_machine(candidate, shape), few)
    swinging = [point_at(candidate.model, one, few) for one in heard_on_typical_machines(scene, candidate)]
    begun = [typical, *(begun_at(few, candidate.model, one) for one in strong_either_way(found, candidate))]
    first = sorted((fit(few, candidate.model, at, STRONG) for at in begun), key=standing)
    speeds = [fit(of_speed(few, SUMMED[0]), candidate.model, at, HALF) for at in swinging]
    return [
        *(fit(few, candidate.model, f.at, BRIEF) for f in first[:1]),
        *first[1:],
        *(speeds_first(few, candidate.model, f.at, SUMMED[0], FROM_AFAR) for f in better_half(speeds)),
    ]


def has_strong_starts(found: Fitted, candidate: Candidate) -> bool:
    """Not where the present fit describes the moves, and of many valleys no single start tells."""
    return not candidate.effect.many_valleys and found.rms >= DESCRIBED


def in_turn(scene: Scene, found: Fitted, library: Sequence[Candidate]) -> list[list[Candidate]]:
    """The candidates that are begun from afar together: of those that are smooth, where all of them together leave more
    than half of what is missing, none is likely to be near, and they come last."""
    if gone(found.rms, scene.smooth_left, PART):
        return [list(library)]
    smooth = [one for one in library if one.name not in NOT_SMOOTH]
    return [[one for one in library if one not in smooth], smooth]


def from_afar(scene: Scene, found: Fitted, candidate: Candidate) -> list[Fitted]:
    """Fits of a few moves from typical machines by the loads' speeds, with a typical play and with the estimator's, for
    what is missing has driven the present machine, and all places, into another valley; and from the estimator's
    machine with the effect as strong as it may well be."""
    few = fewer(found)
    play = {name: v for name, v in scene.rich.items() if name.endswith("backlash")}
    typical = on_typical_machines(candidate)
    begun = [point_at(candidate.model, one, few) for one in (*typical, *({**one, **play} for one in typical))]
    speeds = [fit(of_speed(few, SUMMED[0]), candidate.model, at, HALF) for at in begun]
    best = sorted(speeds, key=standing)[:PLACED]
    at_place = [point_at(candidate.model, one, few) for one in strong_at(scene.rich, found, candidate)]
    strong = sorted((fit(few, candidate.model, at, STRONG) for at in at_place), key=standing)[:1]
    return [fit(few, candidate.model, f.at, FROM_AFAR) for f in (*best, *strong)]


def looked_at(glimpses: Sequence[Fitted]) -> list[Fitted]:
    """The better half of the fits continued, the best of them as long again."""
    looks = better_half_on(glimpses, BRIEF - GLIMPSE)
    best = min(looks, key=standing)
    return [*looks, fit(best.moves, best.model, best.at, BRIEF)]


def second_look(
    scene: Scene, found: Fitted, at_places: Sequence[Fitted], candidate: Candidate
) -> list[Fitted]:
    """Fits of a few moves from other starts: the effect's own numbers fitted alone at the scene's places, where no
    effect has driven the others away yet; of many valleys from all over."""
    few = fewer(found)
    if candidate.effect.many_valleys:
        return valleys(scene, found, candidate)
    shapes = min(PLACED if candidate.effect.states else 1, len(candidate.effect.shapes))
    starts = [placed(place, candidate, k).at for place in at_places for k in range(shapes)]
    return better_half_on([fit(few, candidate.model, at, GLIMPSE) for at in starts], BRIEF - GLIMPSE)


def best_looks(looks: Sequence[Fitted], found: Fitted, candidate: Candidate) -> list[Brief]:
    """The candidate's best fit of a few moves, and the best of those that ended with another shape of the effect."""
    brief = list(looks)
    latest = min(brief, key=standing)
    latest = fit(latest.moves, latest.model, latest.at, BRIEF)
    brief.append(across_samples(latest.moves, latest) if latest.rms > ENDED else latest)
    for _ in range(HALVED if candidate.effect.states else 0):
        brief = better_half_on(brief, BRIEF)
    best = min(brief, key=standing)
    other = softer_contact(values_at(best), candidate.model)
    if other:
        brief.append(fit(best.moves, candidate.model, point_at(candidate.model, other, best.moves), BRIEF))
    kept = VALLEYS if candidate.effect.many_valleys else 2
    return [noted(one, found.moves) for one in best_of_each_shape(brief, candidate)[:kept]]


def glanced(fits: Sequence[Fitted], found: Fitted) -> list[Brief]:
    """The best of the fits as it is."""
    return [noted(min(fits, key=standing), found.moves)]


def nearest(fits: Sequence[Fitted]) -> float:
    """Where the best of them stands."""
    return min(standing(f) for f in fits)


def better_half_on(fits: Sequence[Fitted], rounds: int) -> list[Fitted]:
    """The better half of the fits continued by so many rounds (successive halving)."""
    return [fit(f.moves, f.model, f.at, rounds) for f in better_half(fits)]


def better_half(fits: Sequence[Fitted]) -> list[Fitted]:
    """The nearer half of the fits, the nearest first."""
    return sorted(fits, key=standing)[: (len(fits) + 1) // 2]


def best_of_each_shape(fits: Sequence[Fitted], candidate: Candidate) -> list[Fitted]:
    """The best fit, the best of those whose effect is another than that one's, and so on."""
    names = [p.name for p in candidate.model.parameters]
    own = [names.index(p.name) for p in candidate.effect.parameters if not p.found_again]
    out: list[Fitted] = []
    for one in sorted(fits, key=standing):
        if all(np.max(np.abs(one.at.shared[own] - other.at.shared[own])) > APART for other in out):
            out.append(one)
    return out


def out_of_reach(least: float, found: Fitted, taken: Sequence[str] = ()) -> bool:
    """Whether no two effects can explain the moves, by the RMS of the best candidate on a few of them beside the
    present fit: it is not near, and not half the way either."""
    if taken:
        return least > WITHIN_REACH
    return least > NEAR and least > SHARED * found.rms


def enough_of_few(found: Fitted, taken: Sequence[str]) -> float:
    """How near to a few moves a further effect must come to be looked at again: it would have to be a quarter nearer
    than the present fit for a name."""
    return HARDLY * on_a_few_moves(found).rms if taken else np.inf
