"""Where fits of an added effect are started, and which starts are worth a fit of all moves.

A model that lacks something is driven into a corner of its parameters, from which a refit comes back slowly. So every
effect is started from several places: where the present fit ended, so that no candidate begins worse than without
it; from the estimator's, which sees the middle of the moves only; from a fit to which all smooth effects were added at
once; and from the closed form, which no model drives anywhere. The effect's own shape (a frequency, a speed, a period)
is chosen there by a score test: the derivative of the residual with respect to a small dose of the effect, projected
off what the other parameters can do; what swings is also begun at the frequency that is heard between the moves. The
starts are compared on a few moves, in two looks.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from service.backlash.model_fit_problem import DIFFERENCE
from service.backlash.moves import Moves, few_of, predict, residuals, some_of
from service.backlash.moves_begun import Values, point_at
from service.backlash.moves_fit import (
    Fitted,
    Point,
    costs_of_moves,
    fit,
    values_at,
    width,
)
from service.dynamics.driven_model import LINKS, DrivenEffect, Model
from service.dynamics.driven_parameters import LINK_PARAMETERS
from service.identification.held_out import NEAR
from service.identification.scene import Scene
from service.identification.selection import EXPLAINED, gone
from service.recording import FloatArray

SHAPES = 2
"""Shapes of an effect from which it is started at each place, the best by the score."""
PLACED = 3
"""Shapes with which the numbers of an effect that swings are fitted alone: a spectrum of few periods has several
maxima."""
APART = 0.5
"""Difference in any of an effect's numbers, in standard deviations of its prior, that makes it another."""
FEW, BRIEF = 4, 5
"""Moves and rounds with which starts are compared."""
GLIMPSE, FROM_AFAR = 2, 10
"""Rounds after which a candidate is given up that is far off, and from a start that is far off itself."""
HALVED = 3
"""How often the better half of the fits of what swings is continued."""
ENDED = 1.05
"""RMS up to which a fit need not be begun elsewhere."""
SHARED = 0.5**0.5
"""What the first of two effects leaves of an RMS that each explains half of the variance of."""
AS_NEAR = 4.0 / 3.0
"""How much farther from a few moves one may be and still be looked at again where the best explains nearly all
(chosen)."""
DIVIDED = 1.15
"""RMS from which on it is looked for how two gaps divide, which takes long (chosen)."""
FAR_OFF = 2.0
"""How much farther from a few moves than the best of all candidates one may be and still be looked at again, and be
fitted to all moves."""
HARDLY = 0.9
"""How much nearer to a few moves than the present fit the best further effect must come to be looked at again
(chosen)."""
WITHIN_REACH = 2.5
"""RMS on a few moves from which on a further effect does not come to what two effects may leave (chosen)."""
TOO_MUCH = 4.0
"""RMS of the present model from which on an effect whose fits have many valleys is not searched for: more is missing
than a split gap."""
GUIDE = ("coulomb", "viscous")
"""A guide's friction, which a missing gap hardly drives away."""


@dataclass(frozen=True)
class Candidate:
    """What a model becomes with an effect."""

    effect: DrivenEffect
    model: Model

    @property
    def name(self) -> str:
        return self.effect.name


def candidates(
    present: Model, library: Sequence[type[DrivenEffect]], taken: Sequence[str]
) -> list[Candidate]:
    """Every effect that is not in the model yet; a bridge only where two axes move together without one."""
    found = []
    for kind in library:
        bridge = kind.name == "gantry_coupling"
        if kind.name in taken or (bridge and (len(present.axes) < 2 or present.bridge)):
            continue
        effect = kind(present.axes)
        found.append(Candidate(effect, replace(present, effects=(*present.effects, effect))))
    return found


def scored(found: Fitted, candidate: Candidate, base: Values) -> list[Values]:
    """The candidate's shapes with the amounts that would take most from the residual, the best first.

    `found` is a fit of the model without the effect, `base` its values.
    """
    model, out = candidate.model, []
    amounts = [k for k, p in enumerate(model.parameters) if p.dose and p.name not in base]
    basis = np.linalg.qr(found.slopes.dense())[0]
    left = found.r - basis @ (basis.T @ found.r)
    for start in candidate.effect.starts:
        values = dict(candidate.effect.traded(dict(base) | dict(start)))
        slopes = score_slopes(found, model, values, amounts)
        slopes -= basis @ (basis.T @ slopes)
        H = slopes.T @ slopes + np.eye(len(amounts))
        step = np.linalg.solve(H, -slopes.T @ left)
        for k, u in zip(amounts, np.clip(step, -1.0, 1.0), strict=True):
            p = model.parameters[k]
            least = p.dose if p.low >= 0.0 else -np.inf
            values[p.name] = max(least, float(p.value(u)))
        out.append((float(step @ H @ step), values))
    return [values for _, values in sorted(out, key=lambda one: -one[0])]


def score_slopes(found: Fitted, model: Model, values: Values, amounts: Sequence[int]) -> FloatArray:
    """Derivative of the residuals with respect to the amounts' coordinates (N, amounts) at a fit."""
    shared = np.array([float(p.internal(values[p.name])) for p in model.parameters])
    sets = np.tile(shared, (1 + len(amounts), 1))
    for row, k in enumerate(amounts):
        sets[1 + row, k] += 10.0 * DIFFERENCE
    r = []
    for part, local in zip(found.moves, found.at.local, strict=True):
        own = np.zeros((len(local), width(model)))
        own[:, : local.shape[1]] = local
        r.append(residuals(part, predict(part, model, sets, np.tile(own, (len(sets), 1, 1)))))
    rows = np.hstack(r)
    return np.asarray(np.nan_to_num((rows[1:] - rows[0]).T / (10.0 * DIFFERENCE)))


def grounds(scene: Scene, found: Fitted) -> list[Fitted]:
    """The present model at the scene's places, on a few moves: where a score is taken too."""
    few, held = fewer(found), np.zeros(0, dtype=np.int64)
    return [
        fit(few, found.model, point_at(found.model, place, few), BRIEF, free=held) for place in scene.places
    ]


def fewer(found: Fitted) -> tuple[Moves, ...]:
    """The few moves with which starts are compared."""
    return tuple(some_of(part, FEW) for part in unanswering(found.moves)[:1])


def unanswering(moves: Sequence[Moves]) -> tuple[Moves, ...]:
    """The moves with a motion that does not answer to the force: quicker, and good enough for comparing effects."""
    return tuple(replace(part, echoes=(), reference=None) for part in moves)


def likely(scene: Scene, found: Fitted, candidate: Candidate) -> list[Values]:
    """Values from which the candidate mostly finds to its best fit: its best shapes on the present model, the first on
    the machine as the estimator and the smooth fit find it, and as what is heard between the moves on all of them."""
    shapes = scored(found, candidate, values_at(found))[:SHAPES]
    if candidate.effect.many_valleys:
        return shapes[:1]
    places = (scene.rich, scene.smooth)
    at_places = [on_machine(place, found, candidate, shapes[0]) for place in places]
    if heard := as_heard(scene, candidate):
        kept = {p.name for p in found.model.parameters}
        machines = ({k: v for k, v in place.items() if k in kept} for place in (values_at(found), *places))
        at_places += [{**machine, **heard} for machine in machines]
    return [*shapes, *at_places]


def on_typical_machine(scene: Scene, candidate: Candidate, shape: Values) -> list[Values]:
    """The effect in a shape, and as what is heard, on a typical machine, as strong as it may well be where its amounts
    have one sign: what an effect has done to the numbers of the present model, or of any place without it, may lead
    nowhere."""
    strong = {p.name: p.spread for p in candidate.effect.parameters if p.dose and p.low >= 0.0}
    shapes: list[Values] = [{p.name: shape[p.name] for p in candidate.effect.parameters} | strong]
    heard = as_heard(scene, candidate)
    return [*shapes, heard] if heard else shapes


def on_machine(place: Values, found: Fitted, candidate: Candidate, shape: Values) -> Values:
    """The effect in a shape, or as what the place has instead of it, on the machine as it is at a place."""
    own, kept = own_and_kept(candidate)
    free = {k: v for k, v in place.items() if k in own or k not in kept}
    base = {k: v for k, v in place.items() if k in kept} | dict(candidate.effect.instead(free))
    return {**values_at(found), **{k: v for k, v in shape.items() if k in own}, **base}


def own_and_kept(candidate: Candidate) -> tuple[set[str], set[str]]:
    """The names of the effect's parameters, and of the whole model's."""
    return {p.name for p in candidate.effect.parameters}, {p.name for p in candidate.model.parameters}


def as_heard(scene: Scene, candidate: Candidate) -> Values:
    """An effect that swings as fast as what is heard between the moves."""
    if scene.heard is None or candidate.effect.free_swing is None:
        return {}
    frequency, strong = candidate.effect.free_swing
    return {
        p.name: {**strong, frequency: scene.heard}.get(p.name.rpartition(".")[2], p.typical)
        for p in candidate.effect.parameters
    }


def everywhere(scene: Scene, found: Fitted, candidate: Candidate) -> list[Values]:
    """All shapes at the present fit and at the estimator's, with the chain between motor and flanks put back, since
    what was not in the model has gone into its masses and springs; and on a typical machine with the present friction.
    None where more is missing than the effect can do."""
    present, effect = values_at(found), candidate.effect
    if found.rms > TOO_MUCH:
        return []
    kept = {
        p.name for p in candidate.model.parameters if p.name.rpartition(".")[2] not in chain(candidate.model)
    }
    places = [{k: v for k, v in place.items() if k in kept} for place in (present, scene.rich)]
    places.append({k: v for k, v in present.items() if k.endswith(("backlash", *GUIDE))})
    return [dict(effect.traded(place | dict(start))) for place in places for start in effect.starts]


def chain(model: Model) -> set[str]:
    """Parameters of the masses and springs between motor and flanks, and all damping, without the axis' name."""
    links = {p.name for link in LINKS[model.lumps] for p in LINK_PARAMETERS[link]}
    return links | {"contact_damping_ratio"}


def placed(place: Fitted, candidate: Candidate, shape: int = 0) -> Fitted:
    """The effect's own numbers fitted alone, begun with one of its shapes, the best by the score first, where the
    present model is put at one of the scene's places."""
    names = [p.name for p in candidate.model.parameters]
    own = np.array([names.index(p.name) for p in candidate.effect.parameters])
    at = point_at(candidate.model, scored(place, candidate, values_at(place))[shape], place.moves)
    return fit(place.moves, candidate.model, at, BRIEF, free=own)


def softer_contact(values: Values, model: Model) -> Values | None:
    """The values with shaft and contact exchanged where the contact is the stiffer one: beside a light pinion a linear
    model cannot tell them apart, and what bends or parts is the contact."""
    link, out = LINKS[model.lumps][-1], dict(values)
    for axis in model.axes:
        shaft, contact = f"{axis}.{link}_stiffness", f"{axis}.contact_stiffness"
        if values[contact] > values[shaft]:
            out |= {shaft: values[contact], contact: values[shaft]}
    return None if out == dict(values) else out


def alike(moves: Sequence[Moves], found: Fitted) -> tuple[FloatArray, ...]:
    """The zeros of all moves as they are in a fit of a few: moves of one direction begin much alike."""
    of, own, errors = found.moves[0].s, found.at.local[0], costs_of_moves(found, 0)
    best = {s: own[np.flatnonzero(of == s)[np.argmin(errors[of == s])]] for s in np.unique(of)}
    return tuple(np.stack([best.get(s, np.zeros(own.shape[1])) for s in part.s]) for part in moves)


@dataclass(frozen=True)
class Brief:
    """What a fit of a few moves found: its RMS, its values, and how all moves begin by it."""

    model: Model
    rms: float
    values: Values
    local: tuple[FloatArray, ...]


def noted(found: Fitted, moves: Sequence[Moves]) -> Brief:
    return Brief(found.model, found.rms, values_at(found), alike(moves, found))


def glimpsed(scene: Scene, found: Fitted, candidate: Candidate) -> list[Fitted]:
    """Fits of a few moves, begun where the candidate mostly finds to its best one."""
    few = fewer(found)
    values = likely(scene, found, candidate)
    starts = [added(found, candidate, values[0]), *(point_at(candidate.model, one, few) for one in values)]
    glimpses = [fit(few, candidate.model, at, GLIMPSE) for at in starts]
    if candidate.effect.many_valleys:
        return glimpses
    typical = [point_at(candidate.model, one, few) for one in on_typical_machine(scene, candidate, values[0])]
    return [*glimpses, *(fit(few, candidate.model, at, FROM_AFAR) for at in typical)]


def looked_at(glimpses: Sequence[Fitted]) -> list[Fitted]:
    """The fits continued, the best of them as long again."""
    looks = [fit(f.moves, f.model, f.at, BRIEF - GLIMPSE) for f in glimpses]
    best = min(looks, key=lambda f: f.rms)
    return [*looks, fit(best.moves, best.model, best.at, BRIEF)]


def added(found: Fitted, candidate: Candidate, values: Values) -> Point:
    """The few moves as they are fitted, and the effect with the numbers of `values`."""
    own = [float(p.internal(values[p.name])) for p in candidate.effect.parameters]
    begun = widened((found.at.local[0][few_of(found.moves[0], FEW)],), candidate.model)
    return Point(np.concatenate((found.at.shared, own)), begun)


def widened(local: Sequence[FloatArray], model: Model) -> tuple[FloatArray, ...]:
    """The moves' own coordinates (T, L) of a model, with those of further effects at their likeliest."""
    return tuple(np.pad(own, ((0, 0), (0, width(model) - own.shape[1]))) for own in local)


def second_look(
    scene: Scene, found: Fitted, at_places: Sequence[Fitted], candidate: Candidate
) -> list[Fitted]:
    """Fits of a few moves from other starts: the effect's own numbers fitted alone at the scene's places, where no
    effect has driven the others away yet; of many valleys from all over."""
    few = fewer(found)
    if candidate.effect.many_valleys:
        starts = [point_at(candidate.model, values, few) for values in everywhere(scene, found, candidate)]
    else:
        shapes = min(PLACED if candidate.effect.states else 1, len(candidate.effect.shapes))
        starts = [placed(place, candidate, k).at for place in at_places for k in range(shapes)]
    if candidate.effect.many_valleys:
        return [fit(few, candidate.model, at, BRIEF) for at in starts]
    return better_half_on([fit(few, candidate.model, at, GLIMPSE) for at in starts], BRIEF - GLIMPSE)


def best_looks(looks: Sequence[Fitted], found: Fitted, candidate: Candidate) -> list[Brief]:
    """The candidate's best fit of a few moves, and the best of those that ended with another shape of the effect."""
    brief = list(looks)
    latest = min(brief, key=lambda f: f.rms)
    brief.append(fit(latest.moves, latest.model, latest.at, BRIEF))
    for _ in range(HALVED if candidate.effect.states or candidate.effect.many_valleys else 0):
        brief = better_half_on(brief, BRIEF)
    best = min(brief, key=lambda f: f.rms)
    other = softer_contact(values_at(best), candidate.model)
    if other:
        brief.append(fit(best.moves, candidate.model, point_at(candidate.model, other, best.moves), BRIEF))
    return [noted(one, found.moves) for one in best_of_each_shape(brief, candidate)[:2]]


def compared(
    scene: Scene,
    found: Fitted,
    library: Sequence[Candidate],
    known: float = np.inf,
    taken: Sequence[str] = (),
) -> dict[str, list[Brief]]:
    """The best fits of a few moves of every candidate, by name. All are begun; those that are not far off what is
    nearest, also of what is `known` by its RMS, or that may be the right ones, are looked at, and the nearest first, if
    they are not as near as a right one comes, a second time from more starts; once one explains nearly all, or what is
    known does, only those that are about as near. Of many valleys the first look tells little. Where they are out of
    reach, the first look is all; of further effects it is all of each that is hardly nearer than the present fit."""
    looks = {one.name: glimpsed(scene, found, one) for one in library}
    least = min([known, *map(nearest, looks.values())])
    far = AS_NEAR * known if gone(found.rms, known, EXPLAINED) else max(FAR_OFF * least, NEAR)
    hopeful = [one for one in library if nearest(looks[one.name]) < far]
    looks |= {one.name: looked_at(looks[one.name]) for one in hopeful}
    least = min([known, *map(nearest, looks.values())])
    out = {one.name: glanced(looks[one.name], found) for one in library}
    enough = enough_of_few(found, taken)
    if out_of_reach(least, found, taken) or least > enough:
        return out
    hopeful = [one for one in hopeful if nearest(looks[one.name]) < enough]
    split = [one for one in library if one.effect.many_valleys and one not in hopeful and least > DIVIDED]
    places = grounds(scene, found)
    for one in sorted([*hopeful, *split], key=lambda one: nearest(looks[one.name])):
        now = nearest(looks[one.name])
        near = now < (AS_NEAR if gone(found.rms, least, EXPLAINED) else FAR_OFF) * least
        divided = one.effect.many_valleys and least > DIVIDED
        if divided or (near and now > ENDED):
            looks[one.name] += second_look(scene, found, places, one)
        if divided or near:
            out[one.name] = best_looks(looks[one.name], found, one)
            least = min(least, out[one.name][0].rms)
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


def on_a_few_moves(found: Fitted) -> Fitted:
    """The present fit, fitted to a few moves as candidates are."""
    own = found.at.local[0][few_of(found.moves[0], FEW)]
    return fit(fewer(found), found.model, Point(found.at.shared, (own,)), BRIEF)


def glanced(fits: Sequence[Fitted], found: Fitted) -> list[Brief]:
    """The best of the fits as it is."""
    return [noted(min(fits, key=lambda f: f.rms), found.moves)]


def nearest(fits: Sequence[Fitted]) -> float:
    """The RMS of the best of them."""
    return min(f.rms for f in fits)


def better_half_on(fits: Sequence[Fitted], rounds: int) -> list[Fitted]:
    """The better half of the fits continued by so many rounds (successive halving)."""
    ranked = sorted(fits, key=lambda f: f.rms)[: (len(fits) + 1) // 2]
    return [fit(f.moves, f.model, f.at, rounds) for f in ranked]


def best_of_each_shape(fits: Sequence[Fitted], candidate: Candidate) -> list[Fitted]:
    """The best fit, the best of those whose effect is another than that one's, and so on."""
    names = [p.name for p in candidate.model.parameters]
    own = [names.index(p.name) for p in candidate.effect.parameters if not p.found_again]
    out: list[Fitted] = []
    for one in sorted(fits, key=lambda f: f.rms):
        if all(np.max(np.abs(one.at.shared[own] - other.at.shared[own])) > APART for other in out):
            out.append(one)
    return out
