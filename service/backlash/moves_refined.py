"""A fit of moves taken further: where each move begins, chosen anew or from the fit that describes it best, and the
motors' motion reconstructed from its force."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from service.backlash.moves import Moves
from service.backlash.moves_fit import Fitted, fit
from service.backlash.moves_motion import with_motors_asked, with_reconstructed_motion
from service.backlash.moves_parts import unasked
from service.backlash.moves_point import Point
from service.backlash.moves_predicted import REST_SPREAD, misfits, predict
from service.dynamics.driven_model import Model
from service.recording import FloatArray

REST_PLACES = (0.0, -0.05, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 1.0, 1.05)
"""Shares of the gap behind the driving flank at which the pinion may rest when a move begins."""
CLOSE_PLACES = tuple(np.linspace(-0.05, 1.05, 45))
"""The same, closer: a stiff contact that is met at the beginning of a move may swing on so far between two of the
others that a fit which is begun there ends in another swing."""


def rests_found(
    moves: Sequence[Moves], model: Model, at: Point, among: Sequence[float] = REST_PLACES
) -> Point:
    """The point with each move's resting place chosen among a few by its own samples."""
    local = []
    values = model.numbers(at.shared)
    for part, own in zip((unasked(part) for part in moves), at.local, strict=True):
        rests = [rest for effect in model.effects for rest in effect.rests(values)]
        lying = [own, *(at_rest(own, model, rest) for rest in rests)]
        tried = np.tile(np.stack(lying), (len(among), 1, 1))
        places = np.repeat(among, len(lying))
        sets = np.tile(at.shared, (len(tried), 1))
        best_own = own.copy()
        for x, axis in enumerate(model.axes):
            gap = values[f"{axis}.backlash"]
            tried[:, :, 2 * x] = part.s * (places * gap / REST_SPREAD[0])[:, None] - part.loads[:, 2 * x]
            tried[:, :, 2 * x + 1] = -part.loads[:, 2 * x + 1]
            with np.errstate(all="ignore"):
                r = misfits(part, model, sets, tried)
            squares = np.add.reduceat((r * part.expected[part.used]) ** 2, part.ends[:-1], axis=1)
            best = np.argmin(np.nan_to_num(squares, nan=np.inf), axis=0)
            best_own = tried[best, np.arange(len(best))]
            tried[:] = best_own
        local.append(best_own)
    return replace(at, local=tuple(local))


def at_rest(own: FloatArray, model: Model, rest: Mapping[str, float]) -> FloatArray:
    """Coordinates of moves (T, L) with an effect's at what they are in a rest."""
    out, first = own.copy(), 2 * len(model.axes)
    for k, p in enumerate(model.nuisance):
        if p.name in rest:
            out[:, first + k] = p.internal(rest[p.name])
    return out


def best_of_each(fits: Sequence[Fitted]) -> Point:
    """From fits of the same moves: every move's own coordinates from the fit that describes it best."""
    local = []
    for k, part in enumerate(fits[0].moves):
        errors = [costs_of_moves(one, k) for one in fits]
        best = np.argmin(np.nan_to_num(np.stack(errors), nan=np.inf), axis=0)
        local.append(np.stack([one.at.local[k] for one in fits])[best, np.arange(len(part.grids))])
    return replace(fits[0].at, local=tuple(local))


def costs_of_moves(found: Fitted, k: int) -> FloatArray:
    """Sum of squares of every move of recording k, with its priors: (T,)."""
    return np.asarray(squares_of_moves(found, k) + np.sum(found.at.local[k] ** 2, axis=1))


def squares_of_moves(found: Fitted, k: int) -> FloatArray:
    """Sum of squares of every move of recording k: (T,)."""
    sizes = [int(np.sum(part.used)) for part in found.moves]
    first = sum(sizes[:k])
    move_of = np.nonzero(found.moves[k].used)[0]
    squares = found.r[first : first + sizes[k]] ** 2
    return np.asarray(np.bincount(move_of, squares, len(found.moves[k].grids)), dtype=np.float64)


def rms_of_moves(found: Fitted) -> FloatArray:
    """RMS of every move, recording after recording."""
    squares = [squares_of_moves(found, k) for k in range(len(found.moves))]
    counts = [np.sum(part.used, axis=(1, 2)) for part in found.moves]
    return np.asarray(np.sqrt(np.concatenate(squares) / np.maximum(np.concatenate(counts), 1)))


def as_alike_moves(found: Fitted) -> Point:
    """Every move begun like the best described one of its direction."""
    local = (zeros_alike([part], found, k)[0] for k, part in enumerate(found.moves))
    return Point(found.at.shared, tuple(local))


def zeros_alike(moves: Sequence[Moves], found: Fitted, k: int = 0) -> tuple[FloatArray, ...]:
    """The zeros of moves, begun like the best described one of their direction in recording `k` of a fit, at rest
    where that has none: moves of one direction begin much alike."""
    of, own, errors = found.moves[k].s, found.at.local[k], costs_of_moves(found, k)
    best = {s: own[np.flatnonzero(of == s)[np.argmin(errors[of == s])]] for s in np.unique(of)}
    return tuple(np.stack([best.get(s, np.zeros(own.shape[1])) for s in part.s]) for part in moves)


def reconstructed(found: Fitted, follow: bool = True, asked: bool = False) -> tuple[Moves, ...]:
    """The moves with the motor's motion reconstructed from the fit; with `follow` it goes on following the force. No
    motor follows a fit that ran away. With `asked` the motors' equations of motion are residuals, too, over the
    noise."""
    out = []
    for part, local in zip(found.moves, found.at.local, strict=True):
        force = predict(part, found.model, found.at.shared[None], local[None]).force()[0]
        sound = bool(np.all(np.isfinite(force)))
        at = found.at.shared
        now = with_reconstructed_motion(part, found.model, at, force, follow) if sound else part
        out.append(with_motors_asked(now, found.model, at, force) if sound and asked else now)
    return tuple(out)


def hearing_motors(found: Fitted) -> tuple[Moves, ...]:
    """The moves with the motors' motion reconstructed from the fit, their equations of motion as residuals over the
    noise, or over what the fit leaves of them where that is more: a motor that cogs says less."""
    moves = reconstructed(found, asked=True)
    motors = fit(moves, found.model, found.at, 0).motors
    left = max(1.0, float(np.sqrt(np.mean(motors**2)))) if len(motors) else 1.0
    return tuple(
        replace(part, motors=tuple(tuple(rows.over(left) for rows in move) for move in part.motors))
        for part in moves
    )
