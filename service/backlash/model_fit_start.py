"""Where a fit starts: many random machines around the closed form's answer, all simulated in one pass.

A local fit ends in the nearest minimum. Which of a few hundred plausible machines comes nearest is found first,
on a few steps, because lanes are cheap.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from service.backlash.contact_regression import contact_steps, solve
from service.backlash.contact_steps import ContactStep
from service.backlash.model_fit_problem import Point, Problem, accelerations, residuals
from service.dynamics.driven_model import Parameter
from service.recording import FloatArray, Recording

SEARCH_STEPS = 4

AT_ONCE = 40
"""Machines simulated in one pass: more gain no speed and cost 1 MB each."""


SMALL = (8e-6, 8e-5)
"""Gaps to begin with along the measured motion [m]: one that is too small is always touched and is pulled out to its
size; one too large is never passed, and nothing pulls at it."""


MIDDLE = 0.25
"""Share of the time in the gap left out at each of its ends, which the closed form places roughly."""


@dataclass(frozen=True)
class Guess:
    """What the closed form says of one axis: b [m], M/k [s²], skew [s], and per moved mass friction and a constant
    force [m/s²]; None where it says nothing."""

    backlash: float | None = None
    compliance: float | None = None
    skew: float | None = None
    friction: float | None = None
    constant: float | None = None


def closed_form(recording: Recording, axis: str) -> Guess:
    """The contact regression's answer as a guess, and what acts on the load between the flanks; the regression's
    coefficient of the speed is the skew and a little friction."""
    steps = contact_steps(recording, axis)
    if len(steps) < 2:
        return Guess()
    found = solve(steps)
    b, c, f = float(np.median(found.b)), float(found.shared[1]), float(found.shared[0])
    return Guess(
        b if b > 2e-6 else None,
        c if 2e-7 < c < 5e-5 else None,
        -f if abs(f) < 5e-3 else None,
        *forces_in_the_gap(steps),
    )


def forces_in_the_gap(steps: Sequence[ContactStep]) -> tuple[float | None, float | None]:
    """Friction and constant force per moved mass: between the flanks nothing else acts on the load."""
    seen: dict[int, list[float]] = {1: [], -1: []}
    for step in steps:
        margin = MIDDLE * (step.t2 - step.t1)
        inside = (step.time > step.t1 + margin) & (step.time < step.t2 - margin)
        if np.any(inside):
            seen[step.s].append(float(np.median(step.a_mas[inside])))
    if not all(seen.values()):
        return None, None
    ahead, back = (float(np.median(seen[s])) for s in (1, -1))
    friction = 0.5 * (back - ahead)
    return (friction, 0.5 * (back + ahead)) if friction > 0.0 else (None, None)


def scattered(
    parameter: Parameter, centre: float | None, wide: float, rng: np.random.Generator, n: int
) -> FloatArray:
    """Coordinates (n,) around a known value, `wide` in the parameter's own sense, every third five times as wide;
    from the prior where nothing is known."""
    if centre is None:
        return rng.normal(0.0, 0.7, n)
    widths = np.where(np.arange(n) % 3 == 2, 5.0 * wide, wide) / parameter.spread
    return parameter.internal(centre) + widths * rng.normal(0.0, 1.0, n)


def candidates(problem: Problem, guesses: dict[str, Guess], n: int, seed: int) -> list[Point]:
    """Points drawn around the guesses, from a given seed: the same recording gives the same answer."""
    rng = np.random.default_rng(seed)
    springs = 1 + problem.model.lumps
    shared = np.zeros((n, len(problem.model.parameters)))
    for k, p in enumerate(problem.model.parameters):
        axis, _, name = p.name.rpartition(".")
        guess = guesses.get(axis, Guess())
        if name == "backlash" and problem.seen is not None:
            shared[:, k] = p.internal(np.exp(rng.uniform(np.log(SMALL[0]), np.log(SMALL[1]), n)))
        elif name == "backlash":
            shared[:, k] = scattered(p, guess.backlash, 0.1, rng, n)
        elif name.endswith("stiffness") and axis:
            centre = springs / guess.compliance if guess.compliance else None
            shared[:, k] = scattered(p, centre, 0.3, rng, n)
        elif name == "coulomb":
            shared[:, k] = scattered(p, guess.friction, 0.2, rng, n)
        elif name == "constant":
            shared[:, k] = scattered(p, guess.constant, 0.02, rng, n)
        elif name == "skew":
            shared[:, k] = scattered(p, guess.skew, 1e-4, rng, n) * (rng.random(n) < 0.6)
        else:
            shared[:, k] = rng.normal(0.0, 0.7, n)
    local = np.zeros(problem.local_shape)
    return [Point(row, local) for row in shared]


def best_starts(problem: Problem, points: list[Point], keep: int) -> list[Point]:
    """The points with the smallest residuals on a few steps, best first."""
    few = problem.first_steps(SEARCH_STEPS)
    size = np.concatenate([misfits(few, points[k : k + AT_ONCE]) for k in range(0, len(points), AT_ONCE)])
    return [points[k] for k in np.argsort(size)[:keep]]


def misfits(few: Problem, points: list[Point]) -> FloatArray:
    """Mean absolute residual of each point (n,) on a few steps, infinite where the simulation ran away."""
    shared = np.stack([p.shared for p in points])
    local = np.stack([p.local[:SEARCH_STEPS] for p in points])
    with np.errstate(all="ignore"):
        r = residuals(few, accelerations(few, shared, local))
    return np.where(np.isfinite(r).all(axis=1), np.mean(np.minimum(np.abs(r), 1e6), axis=1), np.inf)
