"""What still swings when a move begins: the move before set it swinging, and the rest between did not end it.

While the axis rests, friction holds the carriage. A sensor on it feels a body that carries both, but not a hung mass,
and how either swings tells little in the first part of a move. But the moves can be simulated on through the rests that
follow them, and how a swing arrives there tells its frequency and its damping better than the moves do.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from service.backlash.moves import Moves, Swings
from service.backlash.moves_fit import Fitted, fit
from service.backlash.moves_point import Point
from service.backlash.moves_predicted import REST_SPREAD, left_over, simulated
from service.dynamics.driven import Course, wider
from service.dynamics.driven_model import Model
from service.dynamics.driven_motion import of_motors
from service.recording import FloatArray

LONGEST = 4.0
"""Time from one move to the next after which nothing swings any more [s]."""
KNOWN = (0.3, 0.3, 0.1, 0.03)
"""Shares of its prior's width that are left of a swing's coordinate where the move before says how it begins: tried one
after the other, for a swing is left by the move before, and by the one before that."""
AT_FIRST = 1.0
"""The same while a fit is far off: the move before says where the prior is centred, and no more."""
TURNS, NEARER = 6, 0.98
"""How often a fit that is far off and what its moves leave take turns at most, and the RMS, over that of the turn
before, from which on they have about agreed (chosen)."""
CLOSE_BY, TRIED, FOLLOWED, APART = 0.03, 61, 3, 0.005
"""Share of a frequency within which others are looked at, how many, how many of them are followed, and by what share
they differ at least (chosen)."""
WORSE = 1.02
"""How much farther from the moves they may be that begin as the moves before left them (chosen)."""


def swinging_on(
    moves: Sequence[Moves], model: Model, at: Point, known: float
) -> tuple[tuple[Moves, ...], Point]:
    """The moves with what the moves before them leave at a point, and the point at which they begin as before; what is
    left is `known` to a share of the prior's width."""
    if not swings_at_all(model) or any(len(part.grids) < 2 for part in moves):
        return tuple(moves), at
    values, parts, local = model.complete(model.values(at.shared[None])), [], []
    for part, own in zip(moves, at.local, strict=True):
        on = swings(part, model, at.shared, own, known)
        following = replace(part, swings=on)
        before, now = left_over(part, model, values), left_over(following, model, values)
        moved = own.copy()
        moved[:, : 2 * len(model.axes)] += part.loads - on.loads
        for k, p in enumerate(model.nuisance):
            if p.name in now:
                j, width = 2 * len(model.axes) + k, part.swings.width if part.swings else 1.0
                begun = p.spread * width * own[:, j] + before.get(p.name, np.zeros(1))[0]
                moved[:, j] = (begun - now[p.name][0]) / (on.width * p.spread)
        parts.append(following)
        local.append(np.clip(moved, -20.0, 20.0))
    return tuple(parts), replace(at, local=tuple(local))


def at_near_frequencies(found: Fitted) -> list[Point]:
    """Points of a fit with its last effect swinging at frequencies close by, those first at which the swings that the
    moves leave arrive most like those with which the next ones begin: a move hardly tells them apart."""
    effect, model = found.model.effects[-1], found.model
    if effect.free_swing is None:
        return []
    which = [k for k, p in enumerate(model.parameters) if p.name.rpartition(".")[2] == effect.free_swing[0]]
    tried = list[tuple[float, float, Point]]()
    for share in np.linspace(-CLOSE_BY, CLOSE_BY, TRIED):
        shared = found.at.shared.copy()
        for k in which:
            p = model.parameters[k]
            shared[k] = float(p.internal(p.value(shared[k]) * (1.0 + share)))
        at = Point(shared, found.at.local)
        tried.append((unlike_left(found, at), float(share), at))
    out = list[tuple[float, Point]]()
    for _, share, at in sorted(tried, key=lambda one: one[0]):
        if all(abs(share - other) > APART for other, _ in out):
            out.append((share, at))
    return [at for _, at in out[:FOLLOWED]]


def unlike_left(found: Fitted, at: Point) -> float:
    """RMS over its prior's width by which what swings when moves begin differs from what the moves before leave at such
    a point: the coordinates in which it is counted from that."""
    _, begun = swinging_on(found.moves, found.model, at, AT_FIRST)
    own = np.concatenate([local[1:, 2 * len(found.model.axes) :] for local in begun.local])
    return float(np.sqrt(np.mean(own**2)))


def how_known(moves: Sequence[Moves]) -> float:
    """The share to which all moves know what the moves before them leave."""
    return max((float(np.min(part.swings.width)) if part.swings else 1.0) for part in moves)


def begun_as_left(found: Fitted, rounds: int) -> Fitted:
    """The fit continued, each move beginning about as the one before left what swings, as long as that is nearer: how
    the moves go on from one to the next is told by numbers that a move by itself does not tell."""
    for _ in range(TURNS):
        moves, at = swinging_on(found.moves, found.model, found.at, AT_FIRST)
        before, found = found, min(found, fit(moves, found.model, at, rounds), key=lambda f: f.rms)
        if found.rms > NEARER * before.rms:
            break
    return found


def swings_at_all(model: Model) -> bool:
    """Whether anything in the model may still swing when a move begins."""
    return any(effect.states for effect in model.effects)


class Rests(NamedTuple):
    """Sets of moves simulated through the rests that follow them.

    Attributes
    ----------
    said : the simulation
    states : (S, T − 1, n), of the chains when the next move begins
    motor : (S, T − 1, X, 2) position and speed of the motors then
    apart, lasted : (T − 1,) time from one move to the next, and how much of it was simulated [s]
    """

    said: Course
    states: FloatArray
    motor: FloatArray
    apart: FloatArray
    lasted: FloatArray


def through_rests(
    moves: Moves, model: Model, shared: FloatArray, local: FloatArray, longest: float = LONGEST
) -> Rests:
    """All moves but the last of one recording to where the next begins, or for the `longest` time [s]; shared (S, P),
    local (S, T, L)."""
    apart = np.diff(moves.start)
    K = int(np.ceil(min(float(np.max(apart)), longest) / moves.h)) + 1
    values = model.complete(model.values(shared))
    skews = np.stack([values[f"{a}.skew"] for a in model.axes], axis=1)
    c = of_motors([moves.plain] * len(moves.grids), moves.start, moves.h, K, skews)
    said = simulated(moves, model, shared, local, c)
    last = np.minimum(np.round(apart / moves.h).astype(int), K - 1)
    each = np.arange(len(apart))
    return Rests(said, said.states[:, each, last], c[:, each, last][..., :2], apart, moves.h * last)


def swings(moves: Moves, model: Model, shared: FloatArray, local: FloatArray, known: float) -> Swings:
    """What every move finds left of the move before, by a simulation through the rests; the first one finds nothing."""
    rests = through_rests(moves, model, shared[None], local[None])
    said, states, motor, apart = rests.said, rests.states[0], rests.motor[0], rests.apart
    values = model.complete(model.values(shared[None]))
    rest = np.maximum(np.concatenate(([0.0], apart - moves.h * moves.samples)), 0.0)
    there = (apart < LONGEST) & np.all(np.isfinite(states), axis=1)
    released: dict[str, FloatArray] = {}
    for effect, case, room in said.cases:
        found = effect.swinging(states[None], case, room)
        begun = {name: after_the_first(value[0], there) for name, value in found.items()}
        released |= {name: value[0] for name, value in effect.swung(values, begun, -rest).items()}
        states = effect.carried(states[None], case, room)[0]
    loads = np.zeros((len(moves.grids), 2 * len(model.axes)))
    more = wider(
        said.cases, np.stack([states[None, :, model.load(x)] for x in range(len(model.axes))], axis=2)
    )[0]
    for x, axis in enumerate(model.axes):
        at = model.load(x)
        ahead = states[:, at : at + 2] - motor[:, x]
        gap = values[f"{axis}.backlash"][0] + more[:, x]
        ahead[:, 0] += 0.5 * moves.s[1:] * gap
        for part in range(2):
            loads[:, 2 * x + part] = after_the_first(ahead[:, part] / REST_SPREAD[part], there)
    return Swings(loads, np.concatenate(([1.0], np.where(there, known, 1.0))), released, rest)


def after_the_first(found: FloatArray, there: NDArray[np.bool_]) -> FloatArray:
    """Values (T,) of all moves from those of all but the first, 0 where there is none."""
    return np.concatenate(([0.0], np.where(there, found, 0.0)))
