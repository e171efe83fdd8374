"""Where fits of an added effect are started.

A model that lacks something is driven into a corner of its parameters, from which a refit comes back slowly. So every
effect is started from several places: where the present fit ended, so that no candidate begins worse than without
it; from the estimator's, which sees the middle of the moves only; from a fit to which all smooth effects were added at
once; from the closed form, which no model drives anywhere; and from a typical machine. The effect's own shape (a
frequency, a speed, a period) is chosen there by a score test: the derivative of the residual with respect to a small
dose of the effect, projected off what the other parameters can do; what swings is also begun at the frequency that is
heard between the moves. Which of the starts are followed is said in ``moves_looks``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from service.backlash.alike_moves import alike
from service.backlash.model_fit_problem import DIFFERENCE
from service.backlash.moves import Moves
from service.backlash.moves_begun import Values, point_at
from service.backlash.moves_fit import Fitted, fit, values_at
from service.backlash.moves_parts import few_of, some_of
from service.backlash.moves_point import Free, Point, width
from service.backlash.moves_predicted import predict, residuals
from service.backlash.moves_refined import best_of_each
from service.dynamics.driven_model import LINKS, DrivenEffect, Model
from service.dynamics.driven_parameters import LINK_PARAMETERS
from service.identification.held_out import DESCRIBED, NEAR
from service.identification.scene import Scene
from service.recording import FloatArray

SHAPES = 2
"""Shapes of an effect from which it is started at each place, the best by the score."""
ROUNDS = 12
"""Rounds of a fit of all moves."""
FEW, BRIEF = 4, 5
"""Moves, at most, and rounds with which starts are compared."""
SAME_PLACE = 1e-4
"""Distance within which two moves begin at one place [m] (chosen: none of what depends on the place differs there)."""
TOO_MUCH = 8.0
"""RMS of the present model from which on an effect whose fits have many valleys is not searched for (chosen: two gaps
leave up to 6.5 beside one)."""
MISLED = 0.9
"""RMS on the measured motion over that on the one that a model's own force made, below which that force is wrong
(chosen: the motion was made for this very model)."""
TOLERANCES = ("clock_offset", "smear")
"""What every chain of measurement does to an impact."""
HARDLY_ANY = 0.01
"""Of a dose of an effect, what is next to nothing, and yet has a slope."""
GUIDE = ("coulomb", "viscous")
"""A guide's friction, which a missing gap hardly drives away."""
RUBBED = (-1.0, 0.0, 1.0, 2.0)
"""A typical machine's dry friction with which what swings is begun, in standard deviations of its prior (chosen: hardly
any to a seal's). Where the load comes to a stand decides how it swings, so each leads to another end."""
ACROSS, ROUNDS_ACROSS, GAINED = (8.0, 16.0), (4, 6), 1.0
"""Samples over which residuals are summed up to lead a fit across one (chosen: of one to twenty most do), rounds by
these speeds and by acceleration, and by what the sum of squares must fall where that leads on."""
LED = 8
"""How often at most a fit is led across samples (chosen; the first two in vain are the last)."""
FINE = 0.05
"""What a round of a fit must gain of cost where it goes on along a valley."""
SUMMED = (0.05, 0.01)
"""How long residuals are summed up to those of speed, the longest first [s] (chosen: periods of a contact, and one)."""


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
    left = found.r - found.basis @ (found.basis.T @ found.r)
    for start in candidate.effect.starts:
        values = dict(candidate.effect.traded(dict(base) | dict(start)))
        slopes = score_slopes(found, model, values, amounts)
        slopes -= found.basis @ (found.basis.T @ slopes)
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
    return tuple(some_of(part, how_few(found)) for part in unanswering(found.moves)[:1])


def own_of_few(found: Fitted) -> FloatArray:
    """The own coordinates (T, L) of these moves in a fit."""
    return found.at.local[0][few_of(found.moves[0], how_few(found))]


def how_few(found: Fitted) -> int:
    """How many moves starts are compared with: of those that are made alike, several tell more only where as little is
    missing as noise may hide, or where it is heard that each begins with another swing."""
    moves = found.moves[0]
    made = moves.made[few_of(moves, FEW)]
    if found.rms < NEAR or moves.heard or len(made) == len(moves.made):
        return len(made)
    places = np.stack([[float(motor(move.start)) for motor in moves.plain] for move in made])
    last = 0
    for k in range(1, len(made)):
        same = (
            alike(made[k], made[j]) and np.ptp(places[[j, k]], axis=0).max() < SAME_PLACE for j in range(k)
        )
        last = last if any(same) else k
    return last + 1


def on_a_few_moves(found: Fitted) -> Fitted:
    """The present fit, fitted to a few moves as candidates are."""
    return fit(fewer(found), found.model, Point(found.at.shared, (own_of_few(found),)), BRIEF)


def as_measured(moves: Sequence[Moves]) -> tuple[Moves, ...]:
    """The moves with the motion of the motors that their samples alone tell, whatever force a model makes."""
    return tuple(replace(m, motion=(m.plain,) * len(m.grids), echoes=(), reference=None) for m in moves)


def on_sound_motion(found: Fitted) -> Fitted:
    """A fit of a model that lacks something, with the motors' motion as its force made it or, if the same model comes
    nearer there, as it is measured: what a wrong force makes between the samples hides the right effect, too."""
    if found.rms < DESCRIBED:
        return found
    own, plain = (
        fit(moves, found.model, found.at, ROUNDS)
        for moves in (unanswering(found.moves), as_measured(found.moves))
    )
    return plain if plain.rms < MISLED * own.rms else found


def unanswering(moves: Sequence[Moves]) -> tuple[Moves, ...]:
    """The moves with a motion that does not answer to the force: quicker, and good enough for comparing effects."""
    return tuple(replace(part, echoes=(), reference=None) for part in moves)


def likely(scene: Scene, found: Fitted, candidate: Candidate) -> list[Values]:
    """Values from which the candidate mostly finds to its best fit: its best shapes on the present model, and, unless
    that describes the moves and so is not far from the machine, the first on the machine as the estimator and the
    smooth fit find it, and as what is heard between the moves on all of them."""
    shapes = scored(found, candidate, values_at(found))[:SHAPES]
    if candidate.effect.many_valleys:
        return shapes[:1]
    if found.rms < DESCRIBED:
        return shapes
    places = (scene.rich, scene.smooth)
    at_places = [on_machine(place, found, candidate, shapes[0]) for place in places]
    if heard := as_heard(scene, candidate):
        kept = {p.name for p in found.model.parameters}
        machines = ({k: v for k, v in place.items() if k in kept} for place in (values_at(found), *places))
        at_places += [{**machine, **heard} for machine in machines]
    return [*shapes, *at_places]


def on_typical_machine(candidate: Candidate, shape: Values) -> Values:
    """The effect in a shape on a typical machine, as strong as it may well be where its amounts have one sign: what an
    effect has done to the numbers of the present model, or of any place without it, may lead nowhere."""
    return {**{p.name: shape[p.name] for p in candidate.effect.parameters}, **strong_of_one_sign(candidate)}


def strong_of_one_sign(candidate: Candidate) -> Values:
    """The effect's amounts of one sign, as strong as they may well be."""
    return {p.name: p.spread for p in candidate.effect.parameters if p.dose and p.low >= 0.0}


def strong_at(place: Values, found: Fitted, candidate: Candidate) -> list[Values]:
    """The effect in all its shapes and as strong as it may well be, at a place; none where its amounts have two signs.
    A small dose of it, from which a score is taken, leads back to where the present fit stands."""
    strong = strong_of_one_sign(candidate)
    shapes = candidate.effect.starts if strong else ()
    return [on_machine(place, found, candidate, {**shape, **strong}) for shape in shapes]


def on_typical_machines(candidate: Candidate) -> list[Values]:
    """The effect on a typical machine in its first shape, or if it swings in all, as strong as it is where it is heard;
    none of one with many valleys."""
    effect = candidate.effect
    if effect.many_valleys:
        return []
    if effect.free_swing is None:
        return [on_typical_machine(candidate, effect.starts[0])]
    return [on_all_axes(effect, {**shape, **effect.free_swing[1]}) for shape in effect.shapes]


def on_all_axes(effect: DrivenEffect, short: Values) -> Values:
    """The effect with values by their names without an axis', others typical."""
    return {p.name: short.get(p.name.rpartition(".")[2], p.typical) for p in effect.parameters}


def strong_either_way(found: Fitted, candidate: Candidate) -> list[Values]:
    """The present machine with one amount of the effect as strong as it may well be, in either sense, and none of the
    others. Where a load is pressed across its gap by a strong force, it moves otherwise than with a small dose of it,
    from which a score is taken. None unless much is missing."""
    effect = candidate.effect
    if found.rms < NEAR:
        return []
    nothing = {**values_at(found), **effect.starts[0]}
    amounts = [p for p in effect.parameters if p.dose and p.low < 0.0]
    return [{**nothing, p.name: sign * p.spread} for p in amounts for sign in (-1.0, 1.0)]


def heard_on_typical_machines(scene: Scene, candidate: Candidate) -> list[Values]:
    """The effect as what is heard, on typical machines with little and with much friction."""
    heard = as_heard(scene, candidate)
    rubbing = [p for p in candidate.model.parameters if p.name.endswith(GUIDE[0])]
    return [{**heard, **{p.name: float(p.value(u)) for p in rubbing}} for u in RUBBED] if heard else []


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
    """An effect that is heard to swing between the moves; a body then carries the axis, which friction holds."""
    if scene.heard is None or candidate.effect.free_swing is None:
        return {}
    frequency, strong, faster = candidate.effect.free_swing
    return on_all_axes(candidate.effect, {**strong, frequency: faster * scene.heard})


def near_by(scene: Scene, found: Fitted, candidate: Candidate) -> list[Values]:
    """All shapes at the present fit; there with shaft and contact exchanged, if the contact is the stiffer one, and
    without what smears the impacts of two gaps into one; and there and at the estimator's with the chain between motor
    and flanks put back, since what was not in the model may have gone into its masses and springs."""
    present, effect = values_at(found), candidate.effect
    kept = {
        p.name for p in candidate.model.parameters if p.name.rpartition(".")[2] not in chain(candidate.model)
    }
    places: list[Values] = [present]
    if exchanged := softer_contact(present, candidate.model):
        places.append({k: v for k, v in exchanged.items() if not k.endswith(TOLERANCES)})
    places += [{k: v for k, v in place.items() if k in kept} for place in (present, scene.rich)]
    return [dict(effect.traded({**place, **start})) for place in places for start in effect.starts]


def softer_contact(values: Values, model: Model) -> Values | None:
    """The values with shaft and contact exchanged where the contact is the stiffer one: beside a light pinion a linear
    model cannot tell them apart, and what bends or parts is the contact."""
    link, out = LINKS[model.lumps][-1], dict(values)
    for axis in model.axes:
        shaft, contact = f"{axis}.{link}_stiffness", f"{axis}.contact_stiffness"
        if values[contact] > values[shaft]:
            out |= {shaft: values[contact], contact: values[shaft]}
    return None if out == dict(values) else out


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


def speeds_first(moves: Sequence[Moves], model: Model, at: Point, lasting: float, rounds: int) -> Fitted:
    """A fit begun where the loads' *speeds* are described best. A contact that the model meets half a period late lies
    in another valley of the acceleration; of the speed it is a step, and has a slope from wherever it is met."""
    return fit(moves, model, fit(of_speed(moves, lasting), model, at, rounds).at, rounds)


def across_samples(moves: Sequence[Moves], found: Fitted) -> Fitted:
    """The fit of these moves led on by speed and acceleration in turns, until it comes no nearer by any of the speeds.
    A flank that is met as one sample is taken puts a step into the sum of squares, on whose edge a fit stops that would
    have to meet it after the sample, or before it; of the speed it is a slope."""
    h, in_vain = max(part.h for part in moves), 0
    by_speed, by_acceleration = ROUNDS_ACROSS
    for turn in range(LED):
        lasting = ACROSS[turn % len(ACROSS)] * h
        begun = fit(of_speed(moves, lasting), found.model, found.at, by_speed, tolerance=FINE)
        on = fit(moves, found.model, begun.at, by_acceleration, tolerance=FINE)
        in_vain = 0 if on.squares < found.squares - GAINED else in_vain + 1
        found = min(found, on, key=lambda f: f.squares)
        if in_vain == len(ACROSS):
            break
    return found


def of_speed(moves: Sequence[Moves], lasting: float) -> tuple[Moves, ...]:
    """The moves with residuals of acceleration summed up to those of speed over so long [s]."""
    return tuple(replace(m, lasting=lasting) for m in moves)


def added(found: Fitted, candidate: Candidate, values: Values) -> Point:
    """The few moves as they are fitted, and the effect with the numbers of `values`."""
    own = [float(p.internal(values[p.name])) for p in candidate.effect.parameters]
    begun = widened((own_of_few(found),), candidate.model)
    return Point(np.concatenate((found.at.shared, own)), begun)


def hardly_any(candidate: Candidate, values: Values) -> Values:
    """The values with next to nothing of the effect: such a start is no farther off than the present fit, and the first
    steps find how much there is of the effect, where a dose that its score tells may lead far beyond."""
    return {**values, **{p.name: HARDLY_ANY * p.dose for p in candidate.effect.parameters if p.dose}}


def widened(local: Sequence[FloatArray], model: Model) -> tuple[FloatArray, ...]:
    """The moves' own coordinates (T, L) of a model, with those of further effects at their likeliest."""
    return tuple(np.pad(own, ((0, 0), (0, width(model) - own.shape[1]))) for own in local)


def begun_at(moves: Sequence[Moves], model: Model, values: Values, *locals_: tuple[FloatArray, ...]) -> Point:
    """The point with these values and every move's zeros fitted there, from a search and from those given, so that no
    wrong zero drives the values away."""
    searched, held = point_at(model, values, moves), np.zeros(0, dtype=np.int64)
    starts = (searched, *(Point(searched.shared, local) for local in locals_))
    return best_of_each([fit(moves, model, at, BRIEF, free=held) for at in starts])


def fitted_from(found: Fitted, values: Values, rounds: int, free: Free | None = None) -> Fitted:
    """The model of a fit fitted to its moves once more, from other values."""
    at = begun_at(found.moves, found.model, values, found.at.local)
    return fit(found.moves, found.model, at, rounds, free=free)
