"""Fit of a model to the moves of several recordings: Levenberg-Marquardt, all perturbations as lanes of one pass.

Shared coordinates have a standard normal prior; so have each move's own. Residuals are divided by the noise times
max(1, present misfit), so that the priors hold while the fit is still bad.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from service.backlash.model_fit_problem import DIFFERENCE
from service.backlash.moves import Moves
from service.backlash.moves_parts import unasked
from service.backlash.moves_point import (
    OWN_FAR,
    Free,
    Point,
    Slopes,
    every,
    limits,
    moved,
    priors,
    stopped,
    width,
    within,
)
from service.backlash.moves_predicted import misfits
from service.dynamics.driven_model import Model
from service.recording import FloatArray

OVERFLOWN = 1e8
LADDER = np.array([0.01, 0.1, 0.5, 2.0, 10.0, 1e3])
"""Dampings tried at once around the last good one."""
OWN_LADDER = np.array([0.01, 0.7, 30.0])
"""The same of each move's own coordinates, which are few (chosen)."""
EACH_LADDER = np.array([0.01, 0.2, 1.0, 30.0])
"""The same around every move's last good one, where nothing else is fitted (chosen)."""
STEPS_A_ROUND = 2
"""A round of a fit is a step of all coordinates and one of every move's own."""


@dataclass(frozen=True)
class Fitted:
    """A model at a point of its coordinates, of which `free` were fitted, with residuals over the noise (N,); and what
    was left of the motors' equations, where they were asked."""

    model: Model
    moves: tuple[Moves, ...]
    at: Point
    r: FloatArray
    free: Free
    motors: FloatArray = field(default_factory=lambda: np.zeros(0))

    @cached_property
    def slopes(self) -> Slopes:
        """Derivative of the residuals, found when it is asked for: most fits are only compared."""
        with np.errstate(all="ignore"):
            return jacobian(self.moves, self.model, self.at, self.free, self.r)[1]

    @cached_property
    def basis(self) -> FloatArray:
        """Orthonormal basis (N, size) of what the fit's own coordinates change."""
        return np.asarray(np.linalg.qr(self.slopes.dense())[0])

    @property
    def rms(self) -> float:
        return float(np.sqrt(np.mean(self.r**2)))

    @property
    def rms_with_motors(self) -> float:
        """RMS of all that was compared."""
        return float(np.sqrt(np.mean(np.concatenate((self.r, self.motors)) ** 2)))

    @property
    def squares(self) -> float:
        """Sum of squares of all that was compared, and of the priors: the lower the likelier, of fits of the same
        moves."""
        own = priors(self.at, every(self.model))
        return float(self.r @ self.r + self.motors @ self.motors + own @ own)

    def value(self, name: str) -> float:
        """One parameter in its own unit."""
        k = [p.name for p in self.model.parameters].index(name)
        return float(self.model.parameters[k].value(self.at.shared[k]))


def values_at(found: Fitted) -> dict[str, float]:
    """The fitted values by name."""
    return found.model.numbers(found.at.shared)


def jacobian(
    moves: Sequence[Moves], model: Model, at: Point, free: Free, known: FloatArray | None = None
) -> tuple[FloatArray, Slopes]:
    """Residuals (N,), which may be known, and derivative with respect to the free shared coordinates and those of the
    moves."""
    P, L = len(free), width(model)
    own = 0 if known is not None else 1
    slopes, rows, counts = [], [], [0]
    begin = 0
    inward = np.where(at.shared[free] + DIFFERENCE > limits(model)[free, 1], -DIFFERENCE, DIFFERENCE)
    differences = np.concatenate((inward, np.full(L, DIFFERENCE)))
    for part, local in zip(moves, at.local, strict=True):
        sets, lanes = np.tile(at.shared, (own + P + L, 1)), np.tile(local, (own + P + L, 1, 1))
        for row, k in enumerate(free):
            sets[own + row, k] += inward[row]
        for j in range(L):
            lanes[own + P + j, :, j] += DIFFERENCE
        r = misfits(part, model, sets, lanes)
        rows.append(r[0] if known is None else known[begin : begin + r.shape[1]])
        slopes.append((r[own:] - rows[-1]) / differences[:, None])
        counts += np.diff(part.ends).tolist()
        begin += r.shape[1]
    J = np.hstack(slopes).T
    J = np.where(np.abs(J) < OVERFLOWN, J, 0.0)
    shared, own_slopes = np.ascontiguousarray(J[:, :P]), np.ascontiguousarray(J[:, P:])
    return np.concatenate(rows), Slopes(shared, own_slopes, np.cumsum(counts))


def cost(at: Point, r: FloatArray, scale: float, free: Free) -> float:
    """Half the sum of squares with the priors, infinite where the simulation ran away."""
    total = 0.5 * float(r @ r) / scale**2 + 0.5 * float(np.sum(priors(at, free) ** 2))
    return total if np.isfinite(total) else np.inf


def trials(moves: Sequence[Moves], model: Model, points: Sequence[Point]) -> FloatArray:
    """Residuals of several points (points, N)."""
    shared = np.stack([p.shared for p in points])
    return np.hstack(
        [misfits(part, model, shared, np.stack([p.local[k] for p in points])) for k, part in enumerate(moves)]
    )


def damped(H: FloatArray, g: FloatArray, dampings: FloatArray) -> FloatArray:
    """Steps (D, …, n) from information (…, n, n), gradient (…, n) and dampings (D, …), of at most 2 in any
    coordinate."""
    raised = H + dampings[..., None, None] * (H * np.eye(H.shape[-1]))
    steps = -np.linalg.solve(raised, np.broadcast_to(g, raised.shape[:-1])[..., None])[..., 0]
    return np.asarray(steps * np.minimum(1.0, 2.0 / np.max(np.abs(steps), axis=-1, keepdims=True)))


def own_slopes(
    part: Moves, model: Model, shared: FloatArray, own: FloatArray, here: FloatArray
) -> FloatArray:
    """Derivative (N, L) of a recording's residuals, `here` (N,), with respect to every move's own coordinates
    (T, L)."""
    L = own.shape[1]
    lanes = np.tile(own, (L, 1, 1))
    for j in range(L):
        lanes[j, :, j] += DIFFERENCE
    return np.asarray((misfits(part, model, np.tile(shared, (L, 1)), lanes) - here).T / DIFFERENCE)


def own_information(
    part: Moves, slopes: FloatArray, own: FloatArray, here: FloatArray, scale: float
) -> tuple[FloatArray, FloatArray]:
    """Information (T, L, L) and gradient (T, L) of every move's own coordinates (T, L), by the `slopes` (N, L) of its
    residuals `here` (N,)."""
    begins, rows = part.ends[:-1], np.nan_to_num(slopes.T)
    H = np.add.reduceat(rows[:, None] * rows, begins, axis=-1) / scale**2
    g = np.add.reduceat(rows * np.nan_to_num(here), begins, axis=-1) / scale**2
    return np.moveaxis(H, -1, 0) + np.eye(own.shape[1]), g.T + own


def own_step(
    part: Moves,
    model: Model,
    shared: FloatArray,
    own: FloatArray,
    here: FloatArray,
    slopes: FloatArray,
    scale: float,
    dampings: FloatArray,
) -> tuple[FloatArray, FloatArray, NDArray[np.int64], float]:
    """One step of every move's own coordinates (T, L) by these `slopes` (N, L) of its residuals `here` (N,), with that
    of the `dampings` (D, T) which suits the move: the coordinates and residuals (N,) then, which damping it was, -1
    where none gained, and what was gained of cost."""
    H, g = own_information(part, slopes, own, here, scale)
    tried = np.concatenate((own[None], np.clip(own + damped(H, g, dampings), -OWN_FAR, OWN_FAR)))
    said = misfits(part, model, np.tile(shared, (len(dampings), 1)), tried[1:])
    said = np.concatenate((here[None], said))
    squares = np.add.reduceat(said**2, part.ends[:-1], axis=1) / scale**2 + np.sum(tried**2, axis=2)
    squares = np.nan_to_num(squares, nan=np.inf)
    best, every_move = np.argmin(squares, axis=0), np.arange(len(own))
    gained = 0.5 * float(np.sum(squares[0] - squares[best, every_move]))
    rows = said[np.repeat(best, np.diff(part.ends)), np.arange(part.ends[-1])]
    return tried[best, every_move], rows, best - 1, gained


def settle_locally(
    moves: Sequence[Moves],
    model: Model,
    at: Point,
    scale: float,
    known: FloatArray,
    slopes: FloatArray | None = None,
) -> tuple[Point, FloatArray]:
    """One step of every move's own coordinates, the shared ones held: each move with the damping that suits it.

    `known` and what is returned with the point are the residuals there (N,); `slopes` (N, L) are their derivatives,
    there or close by, if they are at hand: every move takes a step only if it gains.
    """
    local, rows = [], []
    begin = 0
    for part, own, here in zip(moves, at.local, of_recordings(moves, known), strict=True):
        end = begin + part.ends[-1]
        near = own_slopes(part, model, at.shared, own, here) if slopes is None else slopes[begin:end]
        dampings = np.tile(OWN_LADDER[:, None], len(own))
        own, here, _, _ = own_step(part, model, at.shared, own, here, near, scale, dampings)
        local.append(own)
        rows.append(here)
        begin = end
    return replace(at, local=tuple(local)), np.concatenate(rows)


def of_recordings(moves: Sequence[Moves], r: FloatArray) -> list[FloatArray]:
    """Residuals (N,) of several recordings, those of each."""
    return np.split(r, np.cumsum([part.ends[-1] for part in moves])[:-1])


def fit_each(moves: Sequence[Moves], model: Model, at: Point, rounds: int, tolerance: float) -> Fitted:
    """Levenberg-Marquardt of every move's own coordinates, the shared ones held, so that the moves are independent and
    each has a damping of its own. As many steps as a fit of all takes in so many rounds; ends when one gains less than
    `tolerance` of cost."""
    at = within(model, at)
    of_samples = np.concatenate([part.of_samples for part in moves])
    with np.errstate(all="ignore"):
        r = trials(moves, model, [at])[0]
        dampings = [np.full(len(own), 0.1) for own in at.local]
        for _ in range(STEPS_A_ROUND * rounds if np.all(np.isfinite(r)) else 0):
            scale, gained = misfit_scale(r, of_samples), 0.0
            local, rows = list(at.local), of_recordings(moves, r)
            for k, part in enumerate(moves):
                tried = dampings[k] * EACH_LADDER[:, None]
                slopes = own_slopes(part, model, at.shared, local[k], rows[k])
                local[k], rows[k], which, gain = own_step(
                    part, model, at.shared, local[k], rows[k], slopes, scale, tried
                )
                kept = tried[which, np.arange(len(which))]
                dampings[k] = np.clip(np.where(which < 0, 100.0 * dampings[k], kept), 1e-6, 1e6)
                gained += gain
            at, r = replace(at, local=tuple(local)), np.concatenate(rows)
            if gained < tolerance:
                break
    return fitted(moves, model, at, r, np.zeros(0, dtype=np.int64), of_samples)


def fit(
    moves: Sequence[Moves],
    model: Model,
    at: Point,
    rounds: int,
    *,
    free: Free | None = None,
    tolerance: float = 0.3,
) -> Fitted:
    """Levenberg-Marquardt, several dampings at once; ends when a round gains less than `tolerance` of cost. What the
    motors say counts in the cost and is no part of the fit's residuals."""
    damping, free, at = 1e-2, every(model) if free is None else free, within(model, at)
    if not len(free):
        return fit_each(moves, model, at, rounds, tolerance)
    of_samples = np.concatenate([part.of_samples for part in moves])
    with np.errstate(all="ignore"):
        r = trials(moves, model, [at])[0]
        for _ in range(rounds if np.all(np.isfinite(r)) else 0):
            r, J = jacobian(moves, model, at, free, r)
            scale = misfit_scale(r, of_samples)
            H, g = J.normal(r)
            H, g = H / scale**2 + np.eye(len(H)), g / scale**2 + priors(at, free)
            held = np.flatnonzero(stopped(model, at, free, g))
            H[held], H[:, held], g[held] = 0.0, 0.0, 0.0
            H[held, held] = 1.0
            dampings = damping * LADDER
            points = [moved(model, at, step, free) for step in damped(H, g, dampings)]
            before = cost(at, r, scale, free)
            tried = trials(moves, model, points)
            costs = [cost(p, row, scale, free) for p, row in zip(points, tried, strict=True)]
            best = int(np.argmin(costs))
            if costs[best] < before:
                at, r, damping = points[best], tried[best], float(np.clip(dampings[best], 1e-6, 1e6))
            else:
                damping *= 1e4
            gained = costs[best] < before
            at, r = settle_locally(moves, model, at, scale, r, J.own)
            if before - cost(at, r, scale, free) < tolerance and (gained or damping > 1e3):
                break
    return fitted(moves, model, at, r, free, of_samples)


def misfit_scale(r: FloatArray, of_samples: NDArray[np.bool_]) -> float:
    """What residuals are divided by beside the noise: the present misfit, where that is more."""
    return max(1.0, float(np.sqrt(np.mean(r[of_samples] ** 2))))


def fitted(
    moves: Sequence[Moves],
    model: Model,
    at: Point,
    r: FloatArray,
    free: Free,
    of_samples: NDArray[np.bool_],
) -> Fitted:
    """What a fit ends with, by its residuals (N,) of samples and motors."""
    r = np.nan_to_num(r, nan=OVERFLOWN)
    return Fitted(model, tuple(map(unasked, moves)), at, r[of_samples], free, r[~of_samples])
