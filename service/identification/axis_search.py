"""Starts for the fit: the cost has several valleys, so many random machines are simulated before any is fitted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.stats import norm, qmc

from service.identification.axis_effects import AxisEffect
from service.identification.axis_fit import (
    AxisModel,
    Fit,
    declared_model,
    errors,
    extended,
    fit,
    residuals,
    rms,
)
from service.identification.axis_problem import AxisProblem, one_axis
from service.recording import FloatArray

MACHINES = 512
ZEROS = (0.0, 0.7, 1.3, 2.0)
"""Places of the pinion that are tried at the start of a move, in half backlashes across the gap."""


def window_costs(problem: AxisProblem, R: FloatArray) -> FloatArray:
    """Sum of squares (W, L) of each move; what is not finite counts as infinite."""
    window = problem.windows()
    sums = np.stack([np.sum(R[window == w] ** 2, axis=0) for w in range(len(problem.moves))])
    return np.where(np.isfinite(sums), sums, np.inf)


def placed(problem: AxisProblem, z: float) -> FloatArray:
    """Zeros (W, A): every pinion ``z`` half backlashes away from the flank that braked it."""
    side = np.where(problem.motion.came_from == 0.0, 1.0, problem.motion.came_from)
    first = np.where(problem.motion.came_from == 0.0, z - 1.0, z)
    return np.asarray(first * side)


def scored(problem: AxisProblem, model: AxisModel, Z: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Best cost (L,) of the lanes Z over the pinion's places, and those places (L, W, A), move by move."""
    places = np.stack([placed(problem, z) for z in ZEROS])
    costs = []
    for place in places:
        R = residuals(problem, model, Z, np.repeat(place[None], len(Z), axis=0))
        costs.append(window_costs(problem, R))
    table = np.stack(costs)
    best = np.argmin(table, axis=0)
    zeros = places[best.T, np.arange(len(problem.moves))]
    return table.min(axis=0).sum(axis=0), zeros


def zeros_found(problem: AxisProblem, model: AxisModel, share: float = 1.0, rounds: int = 5) -> Fit:
    """The model with the pinion's zeros found again, judged by the first ``share`` of each move.

    Each move has its own zero, so a grid over one number per move and axis finds all of them at once; it is
    narrowed four times. In a gantry the sides are found in turn, twice.
    """
    early = early_samples(problem, share)
    zeros = placed(problem, 0.0)
    for _ in range(2 if len(problem.axes) == 2 else 1):
        for axis in range(len(problem.axes)):
            zeros = _zeros_of(problem, model, zeros, axis, early, rounds)
    return Fit(model, zeros)


def judged(problem: AxisProblem, found: Fit, train: AxisProblem, share: float) -> Fit:
    """The model on another recording: only the zeros are found again, in the first ``share`` of each move.

    They are searched from scratch, and also near where they were on average on train; the better counts.
    """
    early = early_samples(problem, share)
    searched = zeros_found(problem, found.model, share)
    if len(problem.axes) == 1:
        return searched
    usual = np.zeros_like(searched.offsets)
    if len(found.offsets) == len(train.moves):
        side = np.where(train.motion.came_from == 0.0, np.nan, train.motion.came_from)
        usual = np.nanmean(found.offsets * side, axis=0) * problem.motion.came_from
    usual[0] = searched.offsets[0]
    fits = [fit(problem, Fit(found.model, z), 6, free=[], weight=early) for z in (searched.offsets, usual)]
    return min(fits, key=lambda f: rms(errors(problem, f) * early))


def _zeros_of(
    problem: AxisProblem, model: AxisModel, zeros: FloatArray, axis: int, early: FloatArray, rounds: int
) -> FloatArray:
    side = np.where(problem.motion.came_from == 0.0, 1.0, problem.motion.came_from)[:, axis]
    centre, reach = np.where(problem.motion.came_from[:, axis] == 0.0, 0.0, 1.0), 1.25
    for _ in range(rounds + 1):
        tried = centre + reach * np.linspace(-1.0, 1.0, 11)[:, None]
        lanes = np.repeat(zeros[None], len(tried), axis=0)
        lanes[:, :, axis] = tried * side
        R = residuals(problem, model, np.repeat(model.z[None], len(tried), axis=0), lanes)
        best = np.argmin(window_costs(problem, R * early[:, None]), axis=1)
        centre, reach = tried[best, np.arange(len(best))], reach / 4.0
    zeros = zeros.copy()
    zeros[:, axis] = centre * side
    return zeros


def early_samples(problem: AxisProblem, share: float) -> FloatArray:
    """1.0 for samples (m,) in the first ``share`` of their move, else 0.0."""
    ends = np.array([m.start + share * m.duration for m in problem.moves])
    return np.concatenate([(s.time < ends[s.window]).astype(float) for s in problem.samples])


def random_machines(model: AxisModel, count: int) -> FloatArray:
    """Lanes (count, n) spread evenly over the priors (Sobol sequence, so that a result can be repeated)."""
    even = qmc.Sobol(len(model.z), seed=1).random(count)
    return np.asarray(0.9 * norm.ppf(np.clip(even, 0.02, 0.98)))


def best_starts(problem: AxisProblem, model: AxisModel, Z: FloatArray, keep: int) -> list[Fit]:
    """The ``keep`` best lanes, made ready for the fit."""
    cost, zeros = scored(problem, model, Z)
    return [Fit(model.at(Z[k]), zeros[k]) for k in np.argsort(cost)[:keep]]


def best_fit(problem: AxisProblem, starts: Sequence[Fit], iterations: int) -> Fit:
    """The best of the fits from several starts."""
    fits = [fit(problem, start, iterations) for start in starts]
    return min(fits, key=lambda f: rms(errors(problem, f)))


def settled(problem: AxisProblem, start: Fit, iterations: int = 15) -> Fit:
    """Zeros searched and numbers fitted in turn until that helps no more."""
    best = start
    for _ in range(3):
        searched = zeros_found(problem, best.model)
        near = min([best, searched], key=lambda f: rms(errors(problem, f)))
        now = fit(problem, near, iterations)
        if rms(errors(problem, now)) > 0.98 * rms(errors(problem, best)):
            return now
        best = now
    return best


def declared_fit(problem: AxisProblem) -> tuple[Fit, FloatArray]:
    """The declared model's fit, and the best random machines (32, n), which later searches start from.

    The two axes of a gantry are declared as two axes of their own, so each is fitted by itself.
    """
    if len(problem.axes) == 2:
        return _two_axes([declared_fit(one_axis(problem, axis)) for axis in range(2)])
    model = declared_model(1)
    Z = random_machines(model, MACHINES)
    cost, zeros = scored(problem, model, Z)
    order = np.argsort(cost)
    starts = [Fit(model.at(Z[k]), zeros[k]) for k in order[:3]]
    return settled(problem, best_fit(problem, starts, 15)), Z[order[:32]]


def _two_axes(found: Sequence[tuple[Fit, FloatArray]]) -> tuple[Fit, FloatArray]:
    """Two single fits and pools as one of a gantry, whose coordinates alternate between the axes."""
    model = declared_model(2)
    z = np.stack([f.model.z for f, _ in found], axis=-1).ravel()
    pool = np.stack([p for _, p in found], axis=-1).reshape(len(found[0][1]), -1)
    return Fit(model.at(z), np.concatenate([f.offsets for f, _ in found], axis=1)), pool


def near_fit(problem: AxisProblem, present: Fit, effect: AxisEffect, iterations: int = 5) -> Fit:
    """The model with one more effect from where it stands, the effect at the best of its grid: a first look."""
    model = extended(present.model, effect)
    return fit(
        problem,
        _nearest(problem, present, model, effect_grid(problem, model, len(present.model.z))),
        iterations,
    )


def candidate_fit(
    problem: AxisProblem, present: Fit, near: Fit, pool: FloatArray, effect: AxisEffect, iterations: int = 10
) -> Fit:
    """A candidate fitted further: from its first look, and from the best of the pool times the effect's grid."""
    model = extended(present.model, effect)
    taken = present.model.z[pool.shape[1] :]
    pool = pool[:16] if effect.stage in ("body", "hung") else pool
    machines = np.hstack([pool, np.repeat(taken[None], len(pool), axis=0)])
    grid = effect_grid(problem, model, len(present.model.z))
    Z = np.hstack([np.repeat(machines, len(grid), axis=0), np.tile(grid, (len(machines), 1))])
    far = best_starts(problem, model, Z, 1)
    return best_fit(problem, [near, *far], iterations)


def bridged_fit(problem: AxisProblem, present: Fit, effect: AxisEffect) -> Fit:
    """Two axes and their bridge from a search of its own: each axis' fit alone has bent itself to the other's pull.

    Machines scattered around the present fit and over the priors, with bridges over four decades of stiffness
    and relaxed at offsets of some tens of micrometres; the best of them are fitted.
    """
    model = extended(present.model, effect)
    n = len(present.model.z)
    wide = random_machines(model, MACHINES)
    wide[: MACHINES // 2, :n] = present.model.z + 0.6 * wide[: MACHINES // 2, :n]
    low, high = (model.coordinates[n].internal(edge) for edge in (1e3, 1e6))
    share = 0.5 + 0.5 * np.clip(wide[:, n] / 1.9, -1.0, 1.0)
    wide[:, n] = low + share * (high - low)
    wide[:, n + 2] *= 0.4
    return best_fit(problem, best_starts(problem, model, wide, 4), 15)


def finished(problem: AxisProblem, found: Fit, pool: FloatArray) -> Fit:
    """A candidate's fit with more starts: random machines that have the effect as it was found."""
    n = pool.shape[1]
    Z = np.hstack([pool, np.repeat(found.model.z[n:][None], len(pool), axis=0)])
    starts = [found, *best_starts(problem, found.model, Z, 1)]
    return settled(problem, best_fit(problem, starts, 20))


def without_last(found: Fit, declared: int) -> Fit:
    """The fit without its last effect; ``declared`` is the number of coordinates that stay."""
    m = found.model
    return Fit(
        replace(m, effects=m.effects[:-1], coordinates=m.coordinates[:declared], z=m.z[:declared]),
        found.offsets,
    )


def _nearest(problem: AxisProblem, present: Fit, model: AxisModel, grid: FloatArray) -> Fit:
    """The present fit with the effect at the best of its grid."""
    Z = np.hstack([np.repeat(present.model.z[None], len(grid), axis=0), grid])
    R = residuals(problem, model, Z, np.repeat(present.offsets[None], len(Z), axis=0))
    best = int(np.argmin(window_costs(problem, R).sum(axis=0)))
    return Fit(model.at(Z[best]), present.offsets)


def effect_grid(problem: AxisProblem, model: AxisModel, n: int) -> FloatArray:
    """Values of the last effect's coordinates to start from (G, new): doses of both signs times shapes."""
    new = model.coordinates[n:]
    effect = model.effects[-1]
    if effect.stage in ("body", "hung"):
        return _mode_grid(problem, model, n)
    first = effect.parameters[0]
    shape = next((p for p in effect.parameters if p.logarithmic and len(p.starts) > 1), None)
    rows = []
    for dose in _doses(first.dose, first.bounds, first.logarithmic, first.starts):
        for value in shape.starts if shape is not None and shape is not first else (0.0,):
            row = model.z[n:].copy()
            for k, c in enumerate(new):
                if c.name == first.name:
                    row[k] = c.internal(dose)
                elif shape is not None and c.name == shape.name:
                    row[k] = c.internal(value)
            rows.append(row)
    return np.array(rows)


def _mode_grid(problem: AxisProblem, model: AxisModel, n: int) -> FloatArray:
    """Starts of a swinging mass: what rings in the rests, and frequencies a third of an octave and more apart.

    In a rest the carriage stands on the body and swings with it, so the body alone is faster by its share.
    """
    effect, rows = model.effects[-1], []
    for ratio in (0.03, 0.1, 0.3):
        own = problem.ring * (np.sqrt(1.0 + ratio) if effect.stage == "body" else 1.0)
        for frequency in (own, 0.97 * own, 1.03 * own, *effect.parameters[1].starts[1::3]):
            for damping in (0.01, 0.04):
                start = dict(
                    zip((p.name for p in effect.parameters), (ratio, frequency, damping), strict=True)
                )
                rows.append([c.internal(start[c.name]) for c in model.coordinates[n:]])
    return np.array(rows)


def _doses(
    dose: float, bounds: tuple[float, float], logarithmic: bool, starts: tuple[float, ...]
) -> tuple[float, ...]:
    """Amounts that are tried: doses of both signs over a factor of thirty, or the effect's own starts."""
    if logarithmic or len(starts) > 1:
        return starts
    steps = [dose * f for f in (-10.0, -3.0, -1.0, 1.0, 3.0, 10.0, 30.0)]
    return tuple(step for step in steps if bounds[0] <= step <= bounds[1])
