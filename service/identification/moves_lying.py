"""Where loads, and pinions between two gaps, lie when a move begins.

Friction holds a pinion anywhere in its gap. The accelerometer does not feel where before the flanks behind the pinion
meet, and then little of it; but the move before left it there, and can be simulated on through the rest that follows.
Only where the first one of a recording lies is told by nothing else than the motor, which meets it first. A move that
is begun with its pinion elsewhere foretells every later meeting of the flanks wrong, and a fit of the numbers that all
moves share follows it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from service.backlash.moves import Moves, Swings
from service.backlash.moves_fit import Fitted, fit, settle_locally
from service.backlash.moves_motion import with_motors_asked
from service.backlash.moves_parts import early_part, first_of
from service.backlash.moves_point import Point
from service.backlash.moves_predicted import REST_SPREAD, TOGETHER, misfits, predict
from service.backlash.moves_refined import at_rest, reconstructed
from service.dynamics.driven_model import Model
from service.dynamics.driven_parameters import Parameter
from service.identification.moves_rests import Rests, through_rests
from service.recording import FloatArray

PINION_REST = "pinion_rest"
"""Where a pinion lies between its two gaps, of an effect that has them."""
LYING, CLOSELY = 0.03, 0.01
"""Shares of its prior's width to which it is known where a pinion lies that a move left: about 1 µm while the machine
is fitted, and 0.3 µm in moves that are held out (chosen)."""
HELD_AFTER = 0.5
"""Time after a move [s] from which on its pinion lies still, and is moved by the motor only (chosen)."""
PINIONS = (0.0, 0.2, 0.4, 0.6, 0.8, 1.0)
"""From one of the rests that an effect knows to the next: where a pinion may lie (chosen)."""
LOADS = (None, 0.0, 0.2, 0.5, 0.8, 1.0)
"""Shares of the gap behind the driving flank at which a load may lie, or where it is already (chosen)."""
NEAREST, ROUNDS = 4, 2
"""How many of these are followed for every move, for how many rounds."""
BY_SAMPLES, BY_MOTORS, FITTED = 3, 2, 8
"""How often the motors' motion and where the moves begin in it take turns, by the samples and with the motors asked,
too, and the rounds of a fit in each (chosen)."""


def pinions_lie(model: Model) -> bool:
    """Whether a pinion may lie anywhere between two gaps when a move begins."""
    return bool(pinions(model))


def lying_as_left(
    moves: Sequence[Moves], model: Model, at: Point, known: float = LYING
) -> tuple[tuple[Moves, ...], Point]:
    """The moves with every pinion between two gaps lying where the move before left it, `known` to a share of its
    prior's width, and the point at which they begin, every load where it lay. The first pinion of a recording lies
    anywhere."""
    if not pinions_lie(model):
        return tuple(moves), at
    parts, local = [], []
    for part, own in zip(moves, at.local, strict=True):
        shared, moved, width, heard = at.shared[None], own.copy(), np.ones(len(own)), dict(part.heard)
        for (k, p), left in left_lying(part, model, shared, own[None]).items():
            there = np.isfinite(left[0])
            now = lying_now(part, model, shared, own[None], k)[0]
            heard[p.name], width = np.where(there, left[0], now), np.where(there, known, 1.0)
            moved[:, k] = 0.0
            moved[:, 2 * axis_of(model, p)] += (now - heard[p.name]) / REST_SPREAD[0]
        still = Swings(part.loads, width, {}, np.zeros(len(own)))
        parts.append(replace(part, swings=still, heard=heard))
        local.append(moved)
    return tuple(parts), replace(at, local=tuple(local))


def as_left_and_told(found: Fitted, share: float) -> tuple[tuple[Moves, ...], Point]:
    """The moves of a fit, and the point with every pinion where the move before left it, and the loads, and the first
    pinion, where the first `share` of the moves and of their motors' equations of motion says."""
    model, held = found.model, np.zeros(0, dtype=np.int64)
    for turn in range(BY_SAMPLES + BY_MOTORS):
        moves, at = lying_as_left(found.moves, model, found.at, CLOSELY)
        early = tuple(early_part(part, share) for part in moves)
        if turn >= BY_SAMPLES:
            early = motors_asked(early, model, at)
            at = elsewhere(early, model, at) if turn == BY_SAMPLES else at
        at = fit(early, model, at, FITTED, free=held, tolerance=0.05).at
        found = replace(found, moves=moves, at=at)
        found = replace(found, moves=reconstructed(found))
    return found.moves, found.at


def pinions(model: Model) -> list[tuple[int, Parameter]]:
    """Where a pinion lies between two gaps: its place among the coordinates of a move, and what it is."""
    named = [(2 * len(model.axes) + k, p) for k, p in enumerate(model.nuisance)]
    return [(k, p) for k, p in named if p.name.endswith(f".{PINION_REST}")]


def axis_of(model: Model, p: Parameter) -> int:
    """The axis of a coordinate."""
    return model.axes.index(p.name.partition(".")[0])


def lying_now(moves: Moves, model: Model, shared: FloatArray, local: FloatArray, k: int) -> FloatArray:
    """Where the pinions of a coordinate `k` lie [m]: (S, T)."""
    p = model.nuisance[k - 2 * len(model.axes)]
    if p.name not in moves.heard:
        return np.asarray(p.value(local[..., k]))
    width = moves.swings.width if moves.swings else 1.0
    return np.asarray(p.value(width * local[..., k]) + moves.heard[p.name])


def left_lying(
    moves: Moves, model: Model, shared: FloatArray, local: FloatArray
) -> dict[tuple[int, Parameter], FloatArray]:
    """Where the move before leaves each pinion [m], by a simulation through the rests: (S, T) of each; unknown, NaN, in
    the first of a recording and where a set runs away, in a part of one like the third, which the second leaves."""
    where, T, longest = pinions(model), len(moves.grids), moves.h * moves.samples + HELD_AFTER
    out = {one: np.full((len(shared), T), np.nan) for one in where}
    sets = range(0, len(shared) if T > 1 else 0, TOGETHER)
    for some in (slice(k, k + TOGETHER) for k in sets if where):
        rests = through_rests(moves, model, shared[some], local[some], longest)
        for k, p in where:
            left = out[k, p][some]
            left[:, 1:] = lying_after(moves, model, rests, axis_of(model, p))
            if moves.grids[0].index and T > 2 and moves.s[2] == moves.s[0]:
                left[:, 0] = left[:, 2]
    return out


def lying_after(moves: Moves, model: Model, rests: Rests, x: int) -> FloatArray:
    """Where the pinions of an axis lie beside their motor after the rests (S, T − 1) [m]: where they came to rest,
    while the motor went on as it was measured, as far as it does not take them along."""
    ended = moves.start[:-1] + rests.lasted
    motor = moves.plain[x](moves.start[1:]) - moves.plain[x](ended)
    lies = rests.states[..., model.load(x) - 2] - rests.motor[..., x, 0]
    half = 0.5 * rests.said.values[f"{model.axes[x]}.clearance"][:, None]
    moved = np.clip(lies - motor, -np.maximum(half, np.abs(lies)), np.maximum(half, np.abs(lies)))
    return np.asarray(np.where(rests.lasted < rests.apart - moves.h, moved, lies))


def motors_asked(moves: Sequence[Moves], model: Model, at: Point) -> tuple[Moves, ...]:
    """The moves with the motors' equations of motion as further residuals, over the noise; as they are where a model
    runs away."""
    out = []
    for part, own in zip(moves, at.local, strict=True):
        force = predict(part, model, at.shared[None], own[None]).force()[0]
        sound = bool(np.all(np.isfinite(force)))
        out.append(with_motors_asked(part, model, at.shared, force) if sound else part)
    return tuple(out)


def costs_of(part: Moves, model: Model, at: Point, tried: FloatArray) -> FloatArray:
    """Sum of squares of every move, its motor's equation and its priors, with several coordinates (S, T, L) of one
    recording's moves: (S, T), infinite where a move ran away."""
    with np.errstate(all="ignore"):
        r = misfits(part, model, np.tile(at.shared, (len(tried), 1)), tried)
        squares = np.add.reduceat(r**2, part.ends[:-1], axis=1) + np.sum(tried**2, axis=2)
    return np.asarray(np.nan_to_num(squares, nan=np.inf))


def elsewhere(moves: tuple[Moves, ...], model: Model, at: Point) -> Point:
    """Every move begun with pinion and load where it is described best, among a few places of each."""
    local = []
    for part, own in zip(moves, at.local, strict=True):
        tried = np.stack(list(places(part, model, at, own)))
        order = np.argsort(costs_of(part, model, at, tried), axis=0)
        best, least = own, costs_of(part, model, at, own[None])[0]
        for near in order[:NEAREST]:
            begun = Point(at.shared, (tried[near, np.arange(len(own))],))
            for _ in range(ROUNDS):
                r = misfits(part, model, begun.shared[None], begun.local[0][None])[0]
                begun, _ = settle_locally([part], model, begun, 1.0, r)
            costs = costs_of(part, model, begun, begun.local[0][None])[0]
            best = np.where((costs < least)[:, None], begun.local[0], best)
            least = np.minimum(costs, least)
        local.append(best)
    return Point(at.shared, tuple(local))


def first_elsewhere(moves: Sequence[Moves], model: Model, at: Point) -> Point:
    """The point with the first move of every recording, which none before it left, begun with pinion and load where it
    is described best. A fit hardly leads it from one place to another, and all shared numbers after it."""
    local = []
    for part, own in zip(moves, at.local, strict=True):
        if part.grids[0].index == 0:
            (first,) = elsewhere((first_of(part),), model, Point(at.shared, (own[:1],))).local
            own = np.concatenate((first, own[1:]))
        local.append(own)
    return Point(at.shared, tuple(local))


def places(part: Moves, model: Model, at: Point, own: FloatArray) -> Iterator[FloatArray]:
    """Coordinates (T, L) of one recording's moves with pinions and loads in other places; a pinion of which it is known
    where the move before left it lies there."""
    values = model.numbers(at.shared)
    rests = [effect.rests(values) for effect in model.effects if effect.rests(values)]
    for between, load in product(PINIONS, LOADS):
        tried = own.copy()
        for first, second in rests:
            lying = {name: (1.0 - between) * first[name] + between * second[name] for name in first}
            tried = at_rest(tried, model, lying)
            if part.swings:
                for k, p in pinions(model):
                    there = p.internal(lying[p.name] - part.heard.get(p.name, 0.0))
                    tried[:, k] = np.where(part.swings.width == 1.0, there, own[:, k])
        if load is not None:
            for x, axis in enumerate(model.axes):
                place = part.s * load * values[f"{axis}.backlash"] / REST_SPREAD[0]
                tried[:, 2 * x] = place - part.loads[:, 2 * x]
                tried[:, 2 * x + 1] = -part.loads[:, 2 * x + 1]
        yield tried
