"""The stages of a single axis' fit around those of model_fit_stages: a further search, and a motor that follows.

The search is done once more from other random machines where the first one comes nowhere near on the few steps, or
where more than noise, the speed's too, is left over all steps. That may be the motor's motion between its samples as
well: then further passes follow in which it obeys all that its samples, its torque and the force say together.
"""

from __future__ import annotations

from dataclasses import replace

from service.backlash.model_fit_data import Measured, problem_of
from service.backlash.model_fit_input_noise import expected_misfit
from service.backlash.model_fit_motion import with_following_motors
from service.backlash.model_fit_problem import Problem, fit
from service.backlash.model_fit_stages import (
    GOOD,
    HOPELESS,
    STANDSTILL,
    Effort,
    Outcome,
    Staged,
    following_force,
    from_starts,
    lowest,
    passes,
    refined,
)
from service.backlash.model_fit_start import Guess
from service.dynamics.driven_model import Model

AGAIN = Effort(candidates=320, starts=2, rounds=(3,), refine=(3, 4, 5), settling=2, seed=2, sharings=False)
"""The further search. Few rounds between reconstructions: where the contact swings near half the rate of the speed
samples, a machine that is fitted to the end on one reconstruction takes the input's error into its parameters, and its
reconstruction is worse for it."""

FURTHER = (4, 5)
"""Rounds in which the best of its starts is carried on."""

NOWHERE = 10.0
"""Misfit on the few steps from which on the search is done once more before anything else."""

OTHER = 0.9
"""Share of the cost on the few steps below which another search's start is in another minimum. Which part of the drive
is soft was mistaken with a third of the noise's square left, and cost two micrometres."""

FOLLOWED = 1.5
"""Misfit over all steps from which on the motor's motion is suspected: as much again as half the noise."""

FOLLOWING = (5, 4, 4, 4, 4, 4)
"""Rounds of the passes in which the motor follows."""


def single_fit(measured: Measured, guesses: dict[str, Guess], effort: Effort) -> Staged:
    """All stages of a single axis."""
    model = Model(measured.axes, 2)
    problem = problem_of(measured, model)
    starts = from_starts(measured, problem, guesses, effort)
    if starts[0].fit.misfit > NOWHERE:
        return from_nowhere(measured, problem, starts, searched_again(measured, problem, guesses), effort)
    found = followed(measured, refined(measured, problem, starts, effort))
    if not more_than_noise(measured, found.best, GOOD):
        return found
    others = from_starts(measured, problem, guesses, replace(effort, seed=effort.seed + 1))
    if others[0].fit.cost > OTHER * starts[0].fit.cost:
        return found
    again = followed(measured, refined(measured, problem, others, effort))
    return min(found, again, key=lambda staged: staged.best.fit.cost)


def from_nowhere(
    measured: Measured, problem: Problem, starts: list[Outcome], other: Outcome, effort: Effort
) -> Staged:
    """The stages after a search that came nowhere near, and what the further one found."""
    # Whichever is nearer: how the drive is shared out is the least that is wrong.
    if other.fit.cost < starts[0].fit.cost:
        return followed(measured, refined(measured, problem, [other], AGAIN))
    once = replace(effort, sharings=False, refine=effort.refine[:1])
    return followed(measured, refined(measured, problem, starts, once))


def searched_again(measured: Measured, problem: Problem, guesses: dict[str, Guess]) -> Outcome:
    """The best that other random machines lead to on the few steps, their motor answering the forces."""
    first = from_starts(measured, problem, guesses, AGAIN)[0]
    if not first.fit.misfit < HOPELESS:
        return first
    begun = following_force(measured, first.problem, first.fit)
    return lowest([first, *passes(measured, begun, first.fit.point, FURTHER, following_force)])


def more_than_noise(measured: Measured, found: Outcome, least: float) -> bool:
    """Whether the misfit is above `least`, not hopeless, and above what the noise of the speed adds."""
    return least < found.fit.misfit < HOPELESS and found.fit.misfit > expected_misfit(measured, found)


def followed(measured: Measured, found: Staged) -> Staged:
    """The same with passes in which the motor follows, where more than noise is left, of the speed too, and for as long
    as each is better than the one before by more than a little."""
    best, ends = found.best, list(found.ends)
    for rounds in FOLLOWING if more_than_noise(measured, best, FOLLOWED) else ():
        motors = with_following_motors(measured, replace(best.problem, echoes=()), best.fit)
        end = Outcome(motors, fit(motors, best.fit.point, rounds, 0.3, dearest=best.fit.cost))
        gained = best.fit.cost - end.fit.cost
        if gained < 0.0:
            break
        best = Outcome(motors.judged(), end.fit)
        ends.append(best)
        if gained < STANDSTILL * max(0.0, 1.0 - 1.0 / best.fit.misfit) * best.fit.cost:
            break
    return replace(found, best=best, ends=ends)
