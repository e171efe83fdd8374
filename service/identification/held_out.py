"""A fitted model on moves that were not fitted: only where the pinion rests in its gap, and what an effect says has its
zero found again, is found there, in the first part of each move."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from service.backlash.expected_errors import expected_errors
from service.backlash.moves import Moves
from service.backlash.moves_fit import Fitted, fit, jacobian
from service.backlash.moves_parts import early_part
from service.backlash.moves_point import Free, Point, every, found_again, resting
from service.backlash.moves_predicted import predict
from service.backlash.moves_refined import (
    CLOSE_PLACES,
    as_alike_moves,
    best_of_each,
    reconstructed,
    rests_found,
    rms_of_moves,
    zeros_alike,
)
from service.dynamics.driven_model import LINKS, Model
from service.identification.moves_lying import as_left_and_told, pinions_lie
from service.identification.moves_rests import KNOWN, WORSE, how_known, swinging_on, swings_at_all
from service.identification.scene import Scene
from service.identification.selection import Trial, independent_samples, shown
from service.recording import FloatArray

EARLY = 0.45
"""Share of a held-out move in which its zeros are found again; the backlash pass comes after it."""
ANYWHERE = tuple(np.linspace(-1.6, 1.6, 13))
"""Coordinates at which a zero is looked for again, over its prior: a phase all around, the zero of a bridge in steps of
which some lie on its slope."""
FEW_ROUNDS, STARTS = 3, 3
"""Rounds in which the loads come to lie before a zero is released, and from how many of its places it is."""
NEAR = 4.0
"""RMS below which a fit may be the right one; only then its numbers tell of the machine, and a motor's
motion is made to agree with its force."""
SEARCHED = 1.03
"""RMS that shows from which on what is missing is searched for (chosen: a few parts in a hundred of some thousand
samples are no chance, and a second gap leaves no more)."""
DESCRIBED = 1.15
"""RMS up to which a fit describes its moves: impurities too small to matter leave as much (chosen)."""
OVERDAMPED = 4.5
"""Standard deviations of their priors above which no damping ratio of a chain is."""
SURELY = 3.0
"""Standard deviations from which on an amount differs from zero (chosen: of all shapes the best was looked for)."""
TOLD = KNOWN[-2]
"""Share of its prior's width within which the move before must tell a swing (chosen; the last step, a third of it, a
planted hung mass did not reach)."""
SEEN_AT_REST = ("sensor_bias",)
"""What a zero that wanders while the axis rests is: there is such an effect, however little of it is a drift."""
IN_THE_GAP = 0.3
"""Share of the gap behind the driving flank at which a load is begun that lies on neither (chosen)."""
TURNS, AGREED = 6, 0.05
"""How often the motor's motion in the held-out moves and the force that a model makes in it take turns, and the change
of a prediction, over the expected errors, from which on they agree (chosen: what changes less changes no error)."""
PARTS = 5
"""Blocks into which a held-out move is cut for the test of a gain."""


@dataclass(frozen=True)
class Held:
    """What a model predicts for the held-out moves (T, X, K), and what it doubts of that, over the expected errors,
    nothing if it is hopeless; the moves with the motors' motion and with what swings as they were simulated for it, and
    at which point."""

    moves: Moves
    predicted: FloatArray
    doubted: FloatArray
    simulated: Moves
    at: Point

    @property
    def errors(self) -> FloatArray:
        """(T, X, K) over the noise, NaN where there is no sample."""
        difference = (self.moves.measured - self.predicted) / self.moves.noise[:, None]
        return np.where(self.moves.used, difference, np.nan)

    @property
    def weighed(self) -> FloatArray:
        """(T, X, K) over the standard deviation that is expected."""
        return np.asarray(self.errors / (self.moves.expected * np.hypot(1.0, self.doubted)))

    @property
    def doubt(self) -> float:
        """Geometric mean of what the doubts add to the standard deviation that is expected."""
        return float(np.exp(np.mean(np.log(np.hypot(1.0, self.doubted[self.moves.used])))))


@dataclass(frozen=True)
class Explained:
    """A fitted model and what it says of the held-out moves; whether its fit was continued to the end."""

    fitted: Fitted
    held: Held
    ended: bool = False

    @cached_property
    def announced(self) -> FloatArray:
        """RMS over the sensor's noise that is expected of the held-out errors of each axis (X,) if this model is right:
        the noise of the motor's speed moves the load, too, and numbers are known as well as the moves tell them."""
        moves, at = self.held.moves, self.held.at
        own = expected_errors(self.held.simulated, self.fitted.model, at.shared, at.local[0], fitted=False)
        expected = np.where(
            moves.used, np.hypot(own.acceleration, moves.expected * self.held.doubted), np.nan
        )
        return np.array([rms(expected[:, x]) for x in range(len(moves.axes))])


def rms(values: FloatArray) -> float:
    """Of what is there; NaN where nothing is."""
    there = ~np.isnan(values)
    return float(np.sqrt(np.mean(values**2, where=there))) if there.any() else np.nan


def held_out(validate: Moves, found: Fitted, thorough: bool = True) -> Held:
    """The held-out moves by the fitted model.

    The motor's motion between its samples comes from the simulated force (where `thorough`, else it is a spline),
    never from the measured acceleration. The force depends on that motion, so the two are found in turns until they
    agree; a motion that did not answer to the force would go around between two that do not.
    """
    model, free = found.model, found_again(found.model)
    moves, at, known, _ = begun(validate, found, thorough)
    if thorough and pinions_lie(model):
        (moves,), at = as_left_and_told(replace(found, moves=(moves,), at=at), EARLY)
    predicted = said(moves, model, at)
    for _ in range(TURNS if thorough else 0):
        early = early_part(moves, EARLY)
        if over_expected(early, early.measured - predicted[..., : early.samples]) > NEAR:
            break
        at = fit([early], model, at, 8, free=free).at
        (moves,) = reconstructed(replace(found, moves=(moves,), at=at))
        (moves,), at = swinging_on([moves], model, at, known)
        before, predicted = predicted, said(moves, model, at)
        if not over_expected(moves, predicted - before) > AGREED:
            break
    if thorough:
        at = fit([early_part(moves, EARLY)], model, at, 8, free=free).at
        predicted = said(moves, model, at)
    doubted = doubts(moves, found, at) if found.rms < NEAR else np.zeros(predicted.shape)
    unanswering = replace(moves, echoes=(), reference=None)
    return Held(validate, np.nan_to_num(predicted, nan=1e6), doubted, unanswering, at)


class Begun(NamedTuple):
    """Moves, the point at which they begin, the share to which is known what swings then, and the RMS of their first
    parts over the expected errors."""

    moves: Moves
    at: Point
    known: float
    misfit: float


def begun(validate: Moves, found: Fitted, thorough: bool) -> Begun:
    """The held-out moves as they begin: with what the moves before them leave swinging, or where their first parts are
    not described so, as each is heard by itself. A move that is begun wrong would spoil all after it."""
    model, free = found.model, found_again(found.model)
    at, through = Point(found.at.shared, resting([validate], model)), validate
    for _ in validate.grids if swings_at_all(model) else ():
        (through,), _ = swinging_on([through], model, at, how_known(found.moves))
    zeros = zeros_alike([validate], found) if found.rms < NEAR else ()
    tried = []
    for moves in (through, validate) if swings_at_all(model) else (validate,):
        first = anew([early_part(moves, EARLY)], model, at, free, zeros)
        one = Begun(moves, first, how_known(found.moves), early_misfit(moves, model, first))
        tried.append(as_left(one, found, free) if thorough else one)
        if tried[0].misfit < DESCRIBED:
            break
    return min(tried, key=lambda one: one.misfit)


def as_left(one: Begun, found: Fitted, free: Free) -> Begun:
    """The moves beginning as each one before left them, where anything swings: known as closely as in the train moves,
    unless the first parts are described the worse for it."""
    model, (moves, at, kept, _), closest = found.model, one, np.inf
    swinging = swings_at_all(model)
    for known in KNOWN if swinging else (1.0, 1.0):
        share = max(known, how_known(found.moves))
        (on,), begun_so = swinging_on([moves], model, at, share)
        begun_so = zeros_found([early_part(on, EARLY)], model, begun_so, free)
        error = early_misfit(on, model, begun_so)
        if swinging and error > WORSE * closest:
            break
        closest, kept, at = min(error, closest), share, begun_so
        (moves,) = reconstructed(replace(found, moves=(on,), at=at), follow=False)
    return Begun(moves, at, kept, early_misfit(moves, model, at))


def early_misfit(moves: Moves, model: Model, at: Point) -> float:
    """RMS over the expected errors of the first parts of the moves, with the motors' motion that is not followed."""
    early = early_part(moves, EARLY)
    return over_expected(early, early.measured - said(early, model, at))


def said(moves: Moves, model: Model, at: Point) -> FloatArray:
    """What a model says of one recording's moves at a point, (T, X, K)."""
    return np.asarray(predict(moves, model, at.shared[None], at.local[0][None]).acceleration()[0])


def over_expected(moves: Moves, difference: FloatArray) -> float:
    """RMS of a difference of accelerations (T, X, K) over the errors that are expected."""
    return rms(np.where(moves.used, difference / moves.noise[:, None] / moves.expected, np.nan))


def doubts(moves: Moves, found: Fitted, at: Point) -> FloatArray:
    """Standard deviation of a prediction (T, X, K), over the errors that are expected of a known model: what the train
    moves do not tell of its numbers, and the first part of each held-out move not of its zeros."""
    _, slopes = jacobian([moves], found.model, at, every(found.model))
    early = np.zeros(moves.used.shape, dtype=bool)
    part = early_part(moves, EARLY).used
    early[..., : part.shape[-1]] = part
    early = early[moves.used]
    known, again = told_by_train(found), found_again(found.model)
    known[again] = known[:, again] = 0.0
    variance = np.zeros(len(early))
    for rows, _ in slopes.moves():
        shared, own, first = slopes.shared[rows], slopes.own[rows], early[rows]
        told = np.linalg.inv(own[first].T @ own[first] + np.eye(own.shape[1]))
        left = shared - own @ (told @ (own[first].T @ shared[first]))
        variance[rows] = np.sum((left @ known) * left, axis=1) + np.sum((own @ told) * own, axis=1)
    out = np.zeros(moves.used.shape)
    out[moves.used] = np.sqrt(np.maximum(variance, 0.0))
    return out


def told_by_train(found: Fitted) -> FloatArray:
    """(P, P) covariance of the shared coordinates by the noise alone: a misfit is no doubt."""
    P = len(found.model.parameters)
    information, _ = found.slopes.normal(found.r)
    return np.asarray(np.linalg.inv(information + np.eye(len(information)))[:P, :P])


def anew(
    moves: Sequence[Moves], model: Model, at: Point, free: Free, zeros: tuple[FloatArray, ...] = ()
) -> Point:
    """The point with what an effect says has its zero found again where the moves are described best: looked for all
    over its range where a fit from the train moves' own does not come near, and there from the best few. Where the
    loads rest tells only once the zero is known, and it only once they lie about right: where no fit comes near, they
    are put where `zeros` say, every move's own coordinates, and released. Without `zeros` the model is hopeless."""
    held = np.zeros(0, dtype=np.int64)
    first = fit(moves, model, rests_found(moves, model, at), 8, free=free)
    if zeros and first.rms > DESCRIBED:
        other = fit(moves, model, in_the_gap(moves, model, first.at), 8, free=free)
        first = fit(moves, model, best_of_each(sorted((first, other), key=lambda f: f.rms)), 0, free=free)
    if zeros and first.rms > NEAR:
        still = fit(moves, model, Point(at.shared, zeros), FEW_ROUNDS, free=held)
        first = min(first, fit(moves, model, still.at, 8, free=free), key=lambda f: f.rms)
    if not len(free) or first.rms < NEAR:
        return first.at
    places = []
    for k in free:
        for u in ANYWHERE:
            shared = at.shared.copy()
            shared[k] = u
            lying = rests_found(moves, model, Point(shared, at.local))
            places.append(fit(moves, model, lying, 0, free=held))
    found = [first]
    for begun in sorted(places, key=lambda f: f.rms)[:STARTS]:
        still = fit(moves, model, begun.at, FEW_ROUNDS, free=held)
        found.append(fit(moves, model, rests_found(moves, model, still.at), 8, free=free))
    return min(found, key=lambda f: f.rms).at


def zeros_found(moves: Sequence[Moves], model: Model, at: Point, free: Free) -> Point:
    """Every move's zeros, `free` shared coordinates with them: from the given ones, and where those do not describe
    every move, from the best of several starts."""

    def fits(starts: Sequence[Point]) -> list[Fitted]:
        return [fit(moves, model, one, 12, free=free, tolerance=0.05) for one in starts]

    first = fits((at,))
    if np.max(rms_of_moves(first[0])) < DESCRIBED:
        return first[0].at
    as_left = (Point(at.shared, resting(moves, model)),) if swings_at_all(model) else ()
    first += fits((rests_found(moves, model, at, CLOSE_PLACES), *as_left))
    best = min(first, key=lambda f: f.rms)
    again = fits((rests_found(moves, model, best.at, CLOSE_PLACES), as_alike_moves(best)))
    if min(f.rms for f in again) > DESCRIBED:
        again += fits((in_the_gap(moves, model, at),))
    return best_of_each(sorted(first + again, key=lambda f: f.rms))


def in_the_gap(moves: Sequence[Moves], model: Model, at: Point) -> Point:
    """The point with every load free of both flanks, at rest, and all else of a move at its likeliest: from there a fit
    finds either flank, while one that is begun on the wrong one may take another zero for it."""
    return rests_found(moves, model, Point(at.shared, resting(moves, model)), (IN_THE_GAP,))


def trial_of(scene: Scene, found: Fitted, thorough: bool = True) -> Trial[Explained]:
    """A fit with its errors on the held-out moves, over what is expected of them, in blocks of a fifth of a move. The
    motor's motion in them is a spline unless `thorough` and the fit is near."""
    held = held_out(scene.validate, found, thorough and found.rms < NEAR)
    errors = held.weighed
    over = held.doubt * errors
    blocks = [float(np.nansum(part**2)) for move in over for part in np.array_split(move, PARTS, axis=-1)]
    flat = errors[np.isfinite(errors)]
    trial = Trial(
        Explained(found, held),
        judged_rms(found),
        rms(errors),
        np.array(blocks),
        np.zeros(0),
        independent_samples(flat),
        held.doubt,
    )
    shape = shapes_at_limits(found) if shown(trial) > DESCRIBED else ()
    seen = scene.zero_wanders and found.model.effects[-1].name in SEEN_AT_REST
    return replace(trial, at_limits=(*shape, *(() if seen else no_such_effect(found))))


def judged_rms(found: Fitted) -> float:
    """RMS of a fit over what is expected by which models are compared."""
    if all(part.judged is None for part in found.moves):
        return found.rms
    rows = [
        np.ones(np.sum(m.used)) if m.judged is None else (m.expected / m.judged)[m.used] for m in found.moves
    ]
    return rms(found.r * np.concatenate(rows))


def shapes_at_limits(found: Fitted) -> tuple[str, ...]:
    """Numbers that shape the last effect, by name, that stand at a limit: what needs a shape that no such effect has is
    something else, unless it leaves next to nothing."""
    return tuple(p.name for p in found.model.effects[-1].parameters if p.at_limit(found.value(p.name)))


def no_such_effect(found: Fitted) -> tuple[str, ...]:
    """Numbers, by name, that stand where no such effect is: all amounts of the last one at zero, or a swing that the
    move before cannot have left, so that something else than the axis keeps it going, or a chain damped as no
    machine's is, or between two gaps what is heavier than the load, or a number at a limit that no such effect
    reaches. Only of a fit that may be the right one."""
    last = found.model.effects[-1]
    if found.rms > NEAR:
        return ()
    limits = amounts_of_nothing(found)
    if last.states and how_known(found.moves) > TOLD:
        limits += tuple(p.name for p in last.nuisance)
    outside = tuple(p for p in last.parameters if p.name.rpartition(".")[2] in last.inside)
    limits += tuple(p.name for p in outside if p.at_limit(found.value(p.name)))
    return (*limits, *overdamped(found), *too_heavy(found))


def amounts_of_nothing(found: Fitted) -> tuple[str, ...]:
    """The amounts of the last effect, by name, where none of them differs from zero: what explains the moves then is
    its coordinates of every move, which something else has that is heard in them. An effect that has none of those
    predicts other moves by its amount alone, however little the fitted ones tell of it."""
    if not found.model.effects[-1].nuisance:
        return ()
    names = [p.name for p in found.model.parameters]
    amounts = [p for p in found.model.effects[-1].parameters if p.dose]
    spread = np.sqrt(np.diag(told_by_train(found))) * max(1.0, found.rms)
    there = [abs(found.value(p.name)) > SURELY * p.spread * spread[names.index(p.name)] for p in amounts]
    return () if any(there) else tuple(p.name for p in amounts)


def too_heavy(found: Fitted) -> tuple[str, ...]:
    """Masses that chatter between two gaps and are heavier than the load, by name: no pinion is; a sensor that rings on
    its mount was described so."""
    if not found.model.effects[-1].many_valleys:
        return ()
    masses = (f"{axis}.{LINKS[found.model.lumps][-1]}_mass" for axis in found.model.axes)
    return tuple(name for name in masses if found.value(name) > 1.0)


def overdamped(found: Fitted) -> tuple[str, ...]:
    """Damping ratios, by name, that no chain has."""
    damped = {p.name for p in found.model.of_axis if p.name.endswith("damping_ratio")}
    numbers = zip(found.model.parameters, found.at.shared, strict=True)
    return tuple(p.name for p, u in numbers if p.name.rpartition(".")[2] in damped and u > OVERDAMPED)
