"""The stages of a single axis' fit around those of model_fit_stages: a further search, and a motor that follows.

The search is done once more from other random machines where the first one comes nowhere near on the few steps, or
where the fit of all steps ends far above the noise. What is left above the noise may be the motor's motion between its
samples: then further passes follow in which it obeys all that its samples, its torque and the force say together.
"""

from __future__ import annotations

from dataclasses import replace

from service.backlash.model_fit_data import Measured, problem_of
from service.backlash.model_fit_motion import with_following_motors
from service.backlash.model_fit_problem import Problem, fit
from service.backlash.model_fit_stages import (
    HOPELESS,
    NEARER,
    Effort,
    Outcome,
    Staged,
    from_starts,
    local_spread,
    refined,
)
from service.backlash.model_fit_start import Guess
from service.dynamics.driven_model import Model

AGAIN = Effort(candidates=320, starts=2, refine=(3, 4, 5), settling=2, seed=2, sharings=False)
"""The further search. Few rounds between reconstructions: where the contact swings near half the rate of the speed
samples, a machine that is fitted to the end on one reconstruction takes the input's error into its parameters, and its
reconstruction is worse for it."""

NOWHERE = 10.0
"""Misfit on the few steps from which on the search is done once more before anything else."""

POOR = 3.0
"""Misfit over all steps from which on a local minimum is suspected."""

HALVED = 0.5
"""Share of the cost that following motors leave at most where their motion was what is wrong, not the minimum."""

FOLLOWED = 1.5
"""Misfit over all steps from which on the motor's motion is suspected: as much again as half the noise."""

FOLLOWING = (5, 4, 4)
"""Rounds of the passes in which the motor follows."""


def single_fit(measured: Measured, guesses: dict[str, Guess], effort: Effort) -> Staged:
    """All stages of a single axis."""
    model = Model(measured.axes, 2)
    problem = problem_of(measured, model, local_spread(model))
    starts = from_starts(measured, problem, guesses, effort)
    if starts[0].fit.misfit > NOWHERE:
        others = from_starts(measured, problem, guesses, AGAIN)
        starts, effort = (others, AGAIN) if others[0].fit.cost < starts[0].fit.cost else (starts, effort)
        return followed(measured, refined(measured, problem, starts, effort))
    held = refined(measured, problem, starts, effort)
    found = followed(measured, held)
    if found.best.fit.misfit < POOR or found.best.fit.cost < HALVED * held.best.fit.cost:
        return found
    return searched_again(measured, problem, guesses, found)


def searched_again(measured: Measured, problem: Problem, guesses: dict[str, Guess], found: Staged) -> Staged:
    """The better of a fit and another from other random machines, if these come nearer on the few steps: if not, what
    is left is not the search's fault."""
    starts = from_starts(measured, problem, guesses, AGAIN)
    if starts[0].fit.cost > NEARER * found.starts[0].fit.cost:
        return found
    other = followed(measured, refined(measured, problem, starts, AGAIN))
    return min(found, other, key=lambda staged: staged.best.fit.cost)


def followed(measured: Measured, found: Staged) -> Staged:
    """The same with passes in which the motor follows, where more than noise is left and for as long as each is better
    than the one before."""
    best, ends = found.best, list(found.ends)
    for rounds in FOLLOWING if FOLLOWED < best.fit.misfit < HOPELESS else ():
        motors = with_following_motors(measured, replace(best.problem, echoes=()), best.fit)
        end = Outcome(motors, fit(motors, best.fit.point, rounds, 0.3))
        if end.fit.cost > best.fit.cost:
            break
        best = Outcome(motors.judged(), end.fit)
        ends.append(best)
    return replace(found, best=best, ends=ends)
