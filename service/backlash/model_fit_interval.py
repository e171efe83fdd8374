"""The standard error of a fit's backlash, from what its residual says by itself.

The fit is linearised at its end; each residual then moves the backlash by its influence. Three things move it here
(what the speed's noise moves it by is in model_fit_input_noise):

noise       The residuals are neither white nor alike: what an error of the input leaves rings on after the impact.
            Their covariance is taken as they are, of their local size and with their own correlation over lags,
            apart for what differs from step to step and for what repeats in every step (the "sandwich" of an
            estimator whose residuals are coloured).
structure   What is above the noise was partly taken up by the parameters, and no residual shows that part. It is taken
            to be as large as what the residuals show, to last as long as a flank's swing, and to repeat from step to
            step as they do: what the model lacks repeats, an input that the speed's noise has bent does not.
directions  The gap is the same both ways; a difference beyond the steps' own scatter is half believed either way.
repeating   Of a single axis: what repeats in every step of a direction is no sensor's noise. Something acts that the
            model lacks, such as a partner that nobody declared, and of the backlash several times as large a share is
            in doubt as it leaves of the acceleration.

Nothing here is fitted to any recording: the only numbers are times of the physics.

Shapes: T steps, X axes, K samples, P shared coordinates.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from service.backlash.model_fit_problem import DIFFERENCE, OVERFLOWN, Point, Problem, jacobian
from service.dynamics.driven_model import Model
from service.dynamics.driven_motion import StepGrid
from service.recording import FloatArray

LASTING = 0.004
"""How long what the model lacks stays alike [s]: half a swing of the contact, the onset of an impact, a share of the
passage; also the width over which a residual's local size is taken."""

REMEMBERED = 0.012
"""Longest lag at which residuals are correlated [s]: a contact has swung out by then."""


FEWEST = 3
"""Steps of a direction from which on what repeats in them is told from what does not."""

BY_CHANCE = 0.1
"""Variance over the noise that may repeat by chance (chosen: three standard errors with five steps of a direction)."""

JUMP = 1.0
"""Difference of the derivatives from both sides that is a jump: over the lesser, and beside one noise a coordinate."""


@dataclass(frozen=True)
class Step:
    """One step of the linearised fit: which axis and sample each residual is (n,), residuals over the noise r (n,),
    and their derivatives by the shared coordinates S (n, P) and by the step's own (n, L), as they were and (`cleared`)
    with the step's own initial states taken out of S."""

    axis: FloatArray
    sample: FloatArray
    r: FloatArray
    shared: FloatArray
    own: FloatArray
    cleared: FloatArray


@dataclass(frozen=True)
class Linearised:
    """The fit of a model to the samples on some grids, at its end: its steps and the inverse information on the shared
    coordinates (P, P)."""

    model: Model
    grids: tuple[StepGrid, ...]
    at: Point
    steps: tuple[Step, ...]
    covariance: FloatArray

    def slope(self, k: int) -> float:
        """Unit of parameter k per unit of its coordinate."""
        p, u = self.model.parameters[k], self.at.shared[k]
        return float((p.value(u + 1e-4) - p.value(u - 1e-4)) / 2e-4)

    def field(self, of_step: list[FloatArray], fill: float) -> FloatArray:
        """Values (n,) of every step's residuals, in travel's direction, on the grid (T, X, K)."""
        K = max(grid.measured.shape[1] for grid in self.grids)
        out = np.full((len(self.grids), len(self.model.axes), K), fill)
        for t, (grid, step, value) in enumerate(zip(self.grids, self.steps, of_step, strict=True)):
            out[t, step.axis, step.sample] = float(grid.s) * value
        return out

    @property
    def residual(self) -> FloatArray:
        """(T, X, K), NaN where no sample is compared."""
        return self.field([step.r for step in self.steps], np.nan)

    def influence(self, k: int) -> FloatArray:
        """What a unit of every residual moves parameter k, in its unit: (T, X, K)."""
        row = self.slope(k) * self.covariance[:, k]
        return self.field([step.cleared @ row for step in self.steps], 0.0)


def linearised(problem: Problem, at: Point) -> Linearised:
    """The fit linearised at its end; everything is free there."""
    _, r, J = jacobian(problem, at)
    J = gentler(J, jacobian(problem, at, -DIFFERENCE)[2])
    P, L = len(at.shared), at.local[0].size
    step_of = np.nonzero(np.stack([grid.used for grid in problem.grids]))[0]
    own = np.concatenate([J[step_of == t, P + t * L : P + (t + 1) * L] for t in range(len(problem.grids))])
    return from_slopes(problem.model, problem.grids, at, r, J[:, :P], own)


def from_slopes(
    model: Model, grids: tuple[StepGrid, ...], at: Point, r: FloatArray, shared: FloatArray, own: FloatArray
) -> Linearised:
    """A fit by its residuals (n,), step after step, and their derivatives by the shared coordinates (n, P) and by those
    of each residual's own step (n, L)."""
    r = np.clip(np.nan_to_num(r), -OVERFLOWN, OVERFLOWN)
    step_of, axis, sample = np.nonzero(np.stack([grid.used for grid in grids]))
    steps, information = [], np.eye(shared.shape[1])
    for t in range(len(grids)):
        of = step_of == t
        S, mine = shared[of], own[of]
        cleared = S - mine @ np.linalg.solve(mine.T @ mine + np.eye(mine.shape[1]), mine.T @ S)
        information += S.T @ cleared
        steps.append(Step(axis[of], sample[of], r[of], S, mine, cleared))
    covariance = np.asarray(np.linalg.inv(information), dtype=np.float64)
    return Linearised(model, grids, at, tuple(steps), covariance)


def gentler(forward: FloatArray, backward: FloatArray) -> FloatArray:
    """Derivatives from both sides as one: their mean, or the lesser where only one side meets a jump.

    Where a flank just touches or leaves within a difference's reach the response jumps by a little; over the difference
    that is a derivative of thousands, which would tell the parameter more sharply than any sample can.
    """
    apart = np.abs(forward - backward) > JUMP * np.minimum(np.abs(forward), np.abs(backward)) + JUMP
    lesser = np.where(np.abs(forward) < np.abs(backward), forward, backward)
    return np.where(apart, lesser, 0.5 * (forward + backward))


def coloured(residual: FloatArray, influence: FloatArray, h: float) -> float:
    """Variance that residuals (T, K) of their own size and colour have through their influence (T, K)."""
    there = np.isfinite(residual)
    width = np.ones(max(1, round(LASTING / h)))
    power = local_sum(np.where(there, residual, 0.0) ** 2, width) / np.maximum(local_sum(there, width), 1.0)
    size = np.sqrt(np.maximum(power, 1e-12))
    alike, moved = np.where(there, residual, 0.0) / size, influence * size
    total = white = float(np.sum(moved**2))
    longest = max(1, round(REMEMBERED / h))
    for lag in range(1, min(longest, residual.shape[1])):
        pairs = max(1, int(np.sum(there[:, lag:] & there[:, :-lag])))
        correlation = float(np.sum(alike[:, lag:] * alike[:, :-lag])) / pairs
        total += 2.0 * (1.0 - lag / longest) * correlation * float(np.sum(moved[:, lag:] * moved[:, :-lag]))
    return max(total, white)


def local_sum(value: FloatArray, width: FloatArray) -> FloatArray:
    """Sum over all steps and over neighbouring samples: (T, K) -> (K,)."""
    return np.asarray(np.convolve(np.sum(value, axis=0, dtype=float), width, "same"), dtype=np.float64)


def noise_variance(fit: Linearised, k: int) -> float:
    """Variance of parameter k by the residuals as they are: what differs from step to step, and what repeats beyond the
    share that the differing leaves in the mean of the steps."""
    residual, influence, h = fit.residual, fit.influence(k), fit.grids[0].h
    T = len(residual)
    counted = np.maximum(np.sum(np.isfinite(residual), axis=0), 1)
    seen = np.any(np.isfinite(residual), axis=0)
    mean = np.where(seen, np.nansum(residual, axis=0) / counted, np.nan)
    single = (residual - mean) * np.sqrt(T / max(1, T - 1))
    total = 0.0
    for x in range(residual.shape[1]):
        together = np.sum(influence[:, x], axis=0)
        left = coloured(single[:, x], np.tile(together / T, (T, 1)), h)
        repeated = coloured(mean[None, x], together[None], h)
        total += coloured(single[:, x], influence[:, x], h) + max(0.0, repeated - left)
    return total


def structure_variance(fit: Linearised, k: int, misfit: float) -> float:
    """Variance of parameter k by what the model lacks, which lasts LASTING: alike in every step as far as residuals
    repeat, and what else is above the noise differs from step to step. All repeats where too few steps could show."""
    influence, above = fit.influence(k), max(0.0, misfit - 1.0)
    lag = np.arange(influence.shape[2]) * fit.grids[0].h
    alike = np.exp(-np.abs(lag[:, None] - lag) / LASTING)
    in_each, in_all = (float(np.sum((of @ alike) * of)) for of in (influence, influence.sum(axis=0)))
    found = repeated(fit)
    repeats = above if found is None else max(0.0, found)
    return repeats * in_all + max(0.0, above - repeats) * in_each


def repeated(fit: Linearised) -> float | None:
    """What repeats in the steps of each direction, over the noise: its variance without what the steps' scatter leaves
    in a mean, so where nothing repeats it is as often below zero as above. None where no direction has FEWEST steps."""
    residual, found = fit.residual, []
    direction = np.array([float(grid.s) for grid in fit.grids])
    for s in (1.0, -1.0):
        steps = residual[direction == s]
        count = np.sum(np.isfinite(steps), axis=0)
        seen = count >= FEWEST
        if not np.any(seen):
            continue
        those, n = steps[:, seen], count[seen]
        mean = np.nansum(those, axis=0) / n
        scatter = np.nansum((those - mean) ** 2, axis=0) / (n - 1)
        found.append(float(np.mean(mean**2 - scatter / n)))
    return float(np.mean(found)) if found else None


def repeating(fit: Linearised) -> float:
    """What of the residuals repeats by more than chance, over the noise."""
    return max(0.0, (repeated(fit) or 0.0) - BY_CHANCE)


class Difference(NamedTuple):
    """Mean difference of the directions [m] and its standard error by the steps' scatter [m]."""

    mean: float
    error: float


def difference(b: FloatArray, direction: FloatArray) -> Difference:
    """How the steps b (T,) of positive travel differ from those of negative; NaN where a step says nothing."""
    sides = [b[np.isfinite(b) & (direction == s)] for s in (1, -1)]
    if min(len(side) for side in sides) < 2:
        return Difference(0.0, float("inf"))
    chance = sum(float(np.var(side, ddof=1)) / len(side) for side in sides)
    return Difference(float(np.mean(sides[0]) - np.mean(sides[1])), float(np.sqrt(chance)))


def disagreement(b: FloatArray, direction: FloatArray) -> float:
    """Variance [m²] that a difference of the directions adds: its half squared, less what the scatter of the steps
    makes of it by itself."""
    found = difference(b, direction)
    return max(0.0, 0.25 * (found.mean**2 - found.error**2))
