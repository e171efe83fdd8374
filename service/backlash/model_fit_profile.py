"""Where the backlash lies with everything else following: value and interval where the fit is no parabola.

The standard error takes the fit for linear. A flank that is only just reached is not: a gap that is a little wider
is not reached at all, and from there on the recording hardly says anything. So values beside the fit's are held and
all else fitted again, outwards until they are out of the question. Where what is left sticks out of the interval, the
interval is widened to hold it, and the value is its middle: the likeliest value may lie at one end.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from service.backlash.model_fit_problem import FAR, Point, fit
from service.backlash.model_fit_stages import Outcome

EXCLUDED = 6.0
"""Fall of the logarithm of the likelihood from which on a value is out of the question: 3.5 standard deviations."""

DOUBLINGS = 4
"""Times that a held value is moved out, each twice as far as before."""

ROUNDS = 6

SETTLING = 3
"""Rounds in which the initial states follow a machine that is led away."""

ALIKE = 0.2
"""Share by which the cost may differ from a parabola's."""

TAIL = 0.025

POINTS = 2000
"""Of the density between the outermost values."""


def widened(outcome: Outcome, name: str, half: float) -> tuple[float, float]:
    """Value and half width [m] of the backlash `name` of a fit, whose interval is `half` [m] wide to either side where
    the fit is a parabola."""
    value = outcome.fit.value(outcome.problem.model, name)
    fall = {0.0: 0.0} | fallen(outcome, name, value, -half) | fallen(outcome, name, value, half)
    held = sorted(fall)
    beside = np.linspace(held[0], held[-1], POINTS)
    # Between two held values the root of a parabola is a straight line.
    density = np.exp(-(np.interp(beside, held, np.sqrt([fall[at] for at in held])) ** 2))
    whole = np.cumsum(density) / np.sum(density)
    low = min(-half, float(np.interp(TAIL, whole, beside)))
    high = max(half, float(np.interp(1.0 - TAIL, whole, beside)))
    return value + 0.5 * (low + high), 0.5 * (high - low)


def fallen(outcome: Outcome, name: str, value: float, step: float) -> dict[float, float]:
    """How much the logarithm of the likelihood falls, the residuals being as large as they are, at distances [m] from
    the value in the direction of `step` [m]."""
    found: dict[float, float] = {}
    for doubling in range(DOUBLINGS + 1):
        beside = step * 2.0**doubling
        if value + beside <= 0.0:
            break
        rise = cost_held(outcome, name, value + beside) - outcome.fit.cost
        found[beside] = max(0.0, rise / max(1.0, outcome.fit.misfit))
        if found[beside] > EXCLUDED:
            break
    return found


def cost_held(outcome: Outcome, name: str, value: float) -> float:
    """The least cost with the parameter held at a value: where the linear fit leads, if the cost there is a parabola's,
    else by fitting everything else again."""
    problem, at, covariance = outcome.problem, outcome.fit.point, outcome.fit.covariance
    k = [p.name for p in problem.model.parameters].index(name)
    away = float(problem.model.parameters[k].internal(value)) - at.shared[k]
    following = np.clip(at.shared + covariance[:, k] / covariance[k, k] * away, -FAR, FAR)
    following[k] = at.shared[k] + away
    still = replace(problem, free=(False,) * len(problem.free))
    found = fit(still, Point(following, at.local), SETTLING, 0.3)
    rise, parabola = found.cost - outcome.fit.cost, 0.5 * away**2 / covariance[k, k]
    if abs(rise - parabola) < ALIKE * parabola + 0.3:
        return found.cost
    free = tuple(j != k and freed for j, freed in enumerate(problem.free))
    return fit(replace(problem, free=free), found.point, ROUNDS, 0.3).cost
