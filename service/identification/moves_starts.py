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
DIVIDED = 1.15
"""RMS from which on it is looked for how two gaps divide, which takes long (chosen)."""
FAR_OFF = 2.0
"""How much farther from a few moves than the best of all candidates one may be and still be looked at again, and be
fitted to all moves."""
HARDLY = 0.9
"""How much nearer to a few moves than the present fit the best further effect must come to be looked at again
(chosen)."""
TOO_MUCH = 4.0
"""RMS of the present model from which on an effect whose fits have many valleys is not searched for: more is missing
than a split gap."""
GUIDE = ("coulomb", "viscous")
"""A guide's friction, which a missing gap hardly drives away."""
PUT_BACK = ("turnover_speed", "turnover_spread", "coulomb", "viscous", "damping_ratio", "smear")
"""Parameters that a wrong model drives into a corner from which a fit comes back slowly."""


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
    the machine as the estimator and the smooth fit find it, and what is heard between the moves."""
    shapes = scored(found, candidate, values_at(found))[:SHAPES]
    if candidate.effect.many_valleys:
        return shapes[:1]
    at_places = (
        on_machine(scene.rich, found, candidate, shapes[0]),
        on_machine(scene.smooth, found, candidate, shapes[0]),
    )
    return [*shapes, *at_places, *as_heard(scene, found, candidate)]


def less_likely(scene: Scene, found: Fitted, candidate: Candidate) -> list[Values]:
    """The other places, and the same with the numbers put back that a wrong model drives into a corner."""
    if candidate.effect.many_valleys:
        return everywhere(scene, found, candidate)
    own, kept = own_and_kept(candidate)
    shape = scored(found, candidate, values_at(found))[0]
    at_rich = {k: v for k, v in scene.rich.items() if k in kept and not k.endswith(PUT_BACK)}
    return [
        on_machine(scene.plain, found, candidate, shape),
        {k: v for k, v in shape.items() if not k.endswith(PUT_BACK)},
        at_rich | {k: v for k, v in shape.items() if k in own},
    ]


def on_typical_machine(candidate: Candidate, shape: Values) -> Values:
    """The effect in a shape on a typical machine, as strong as it may well be where its amounts have one sign: what an
    effect has done to the numbers of the present model, or of any place without it, may lead nowhere."""
    strong = {p.name: p.spread for p in candidate.effect.parameters if p.dose and p.low >= 0.0}
    return {p.name: shape[p.name] for p in candidate.effect.parameters} | strong


def on_machine(place: Values, found: Fitted, candidate: Candidate, shape: Values) -> Values:
    """The effect in a shape, or as what the place has instead of it, on the machine as it is at a place."""
    own, kept = own_and_kept(candidate)
    free = {k: v for k, v in place.items() if k in own or k not in kept}
    base = {k: v for k, v in place.items() if k in kept} | dict(candidate.effect.instead(free))
    return {**values_at(found), **{k: v for k, v in shape.items() if k in own}, **base}


def own_and_kept(candidate: Candidate) -> tuple[set[str], set[str]]:
    """The names of the effect's parameters, and of the whole model's."""
    return {p.name for p in candidate.effect.parameters}, {p.name for p in candidate.model.parameters}


def as_heard(scene: Scene, found: Fitted, candidate: Candidate) -> list[Values]:
    """An effect that swings as fast as what is heard between the moves: on the machine as it is at every place, and on
    a typical one, since a wrong model of the machine has gone into the numbers of all others."""
    if scene.heard is None or candidate.effect.free_swing is None:
        return []
    frequency, strong = candidate.effect.free_swing
    own = {
        p.name: {**strong, frequency: scene.heard}.get(p.name.rpartition(".")[2], p.typical)
        for p in candidate.effect.parameters
    }
    kept = {p.name for p in found.model.parameters}
    machines: list[Values] = [{}, values_at(found), scene.rich, scene.smooth]
    return [{**{k: v for k, v in machine.items() if k in kept}, **own} for machine in machines]


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
    typical = point_at(candidate.model, on_typical_machine(candidate, values[0]), few)
    return [*glimpses, fit(few, candidate.model, typical, FROM_AFAR)]


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
    """The same from all other starts."""
    few = fewer(found)
    starts = [point_at(candidate.model, values, few) for values in less_likely(scene, found, candidate)]
    if not candidate.effect.many_valleys:
        shapes = min(PLACED if candidate.effect.states else 1, len(candidate.effect.shapes))
        starts += [placed(place, candidate, k).at for place in at_places for k in range(shapes)]
    return [fit(few, candidate.model, at, BRIEF) for at in starts]


def best_looks(looks: Sequence[Fitted], found: Fitted, candidate: Candidate) -> list[Brief]:
    """The candidate's best fit of a few moves, and the best of those that ended with another shape of the effect."""
    brief = list(looks)
    latest = min(brief, key=lambda f: f.rms)
    brief.append(fit(latest.moves, latest.model, latest.at, BRIEF))
    for _ in range(HALVED if candidate.effect.states or candidate.effect.many_valleys else 0):
        brief = better_half_on(brief)
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
    nearest, also of what is `known` by its RMS, are looked at, and if they are not as near as a right one comes, a
    second time from more starts; where one comes as near, only those that come half the way to it. Of many valleys the
    first look tells little. Where they are out of reach, or hardly nearer, the first look is all."""
    looks = {one.name: glimpsed(scene, found, one) for one in library}
    least = min([known, *map(nearest, looks.values())])
    hopeful = [one for one in library if nearest(looks[one.name]) < FAR_OFF * least]
    looks |= {one.name: looked_at(looks[one.name]) for one in hopeful}
    least = min([known, *map(nearest, looks.values())])
    far = FAR_OFF * least if least > ENDED else min(FAR_OFF * least, 0.5 * (least + found.rms))
    if out_of_reach(least, found) or hardly_nearer(least, found, taken):
        return {one.name: glanced(looks[one.name], found) for one in library}
    lacking = [one for one in hopeful if ENDED < nearest(looks[one.name]) < far]
    if least > DIVIDED:
        lacking += [one for one in library if one.effect.many_valleys and one not in lacking]
    at_places = grounds(scene, found) if lacking else []
    for one in lacking:
        looks[one.name] += second_look(scene, found, at_places, one)
    followed = [*hopeful, *lacking]
    return {
        one.name: best_looks(looks[one.name], found, one)
        if one in followed
        else glanced(looks[one.name], found)
        for one in library
    }


def out_of_reach(least: float, found: Fitted, taken: Sequence[str] = ()) -> bool:
    """Whether no two effects can explain the moves, by the RMS of the best candidate on a few of them beside the
    present fit: it is not near, and neither half the way nor the second of them."""
    return least > NEAR and (len(taken) > 0 or least > SHARED * found.rms)


def hardly_nearer(least: float, found: Fitted, taken: Sequence[str]) -> bool:
    """Whether the best further effect comes hardly nearer to a few moves than the present fit, which would have to be
    a quarter nearer for a name."""
    return len(taken) > 0 and least > HARDLY * on_a_few_moves(found).rms


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


def better_half_on(fits: Sequence[Fitted]) -> list[Fitted]:
    """The better half of the fits continued by as many rounds again (successive halving): what swings is found late,
    its frequency wanders far."""
    ranked = sorted(fits, key=lambda f: f.rms)[: (len(fits) + 1) // 2]
    return [fit(f.moves, f.model, f.at, BRIEF) for f in ranked]


def best_of_each_shape(fits: Sequence[Fitted], candidate: Candidate) -> list[Fitted]:
    """The best fit, the best of those whose effect is another than that one's, and so on."""
    names = [p.name for p in candidate.model.parameters]
    own = [names.index(p.name) for p in candidate.effect.parameters if not p.found_again]
    out: list[Fitted] = []
    for one in sorted(fits, key=lambda f: f.rms):
        if all(np.max(np.abs(one.at.shared[own] - other.at.shared[own])) > APART for other in out):
            out.append(one)
    return out
