"""The stages of a gantry's fit: from no guess at all to the fit of both axes over all steps.

Simulated from a wrong machine, the two sides of a gantry soon do something else than the recorded ones did, and no
local fit finds back. So the search begins along the loads' *measured* motion, on which forces are balanced and
nothing is simulated; there fits are cheap and minima few. The forces needed for that motion say at the same time how
the motors moved between their samples. Then the machine is simulated: with one mass per drive, which has fewer
minima, then with gear and pinion, and with what the axes do beyond the paper's model, first on a few steps, then on
all. It takes some 10 s on one core, three times that where several starts have to be carried on.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from service.backlash.model_fit_data import (
    Measured,
    measure,
    problem_of,
    swings_fast,
    with_reconstructed_motion,
)
from service.backlash.model_fit_motion import with_following_motors
from service.backlash.model_fit_one_build import WAYS, begun_alike, other_drives
from service.backlash.model_fit_onward import onward
from service.backlash.model_fit_problem import Fit, Point, Problem, fit
from service.backlash.model_fit_stages import (
    DIVERGING,
    HOPELESS,
    Effort,
    Outcome,
    Reconstruction,
    Staged,
    differently_shared,
    following_force,
    lowest,
    passes,
    settled,
    sound_drives,
    split,
    with_impurities,
)
from service.backlash.model_fit_start import SEARCH_STEPS, best_starts, candidates
from service.dynamics.driven_model import Model
from service.recording import Recording

LONGER = 20
"""Rounds of the best fits along the measured motion: a gap that is too small is pulled out to its size by some
micrometres a round."""

STATES = 4
"""Rounds in which the initial states are found for the machine as it is."""

NEAR = 3.0
"""Misfit of the lighter chain at which no further start is tried: the heavier one does the rest."""

BEGUN, OTHERS = 3, 3
"""Rounds that a start with other drives is fitted for, and how many of them go on."""

CLOSE = 1.3
"""Misfit of the lighter chain at which no other drives are tried: two lumps leave less, other drives would not."""

LITTLE = Effort(candidates=1500, tried=12, brief=8, starts=3)
"""Where only a comparison is asked for."""

POOR = 3.0
"""Misfit from which on a wrong minimum is suspected."""

NEARER = 0.75
"""Share of the cost on a few steps below which another search's start is worth a fit of all steps."""

ONLY_NOISE = 1.03
"""Misfit on the few steps at which no other sharing is tried: 2,000 samples tell 3 %."""

CARRIED = 3
"""Starts that go on to gear and pinion at most."""

ABANDONED = 5.0
"""Starts whose misfit is this many times the best one's are left: another minimum."""

ENOUGH = 1.5
"""Misfit on a few steps of the heavier chain at which no further start is tried: other minima are far above."""

NOWHERE = 30.0
"""Misfit, five times the noise, from which on a fit is not refined: from one of a few steps all are fitted for one
round only, and from one of all no following motors are tried. What came no nearer was refused anyway."""

AWAY = 1.5
"""Cost over that of the best pass beyond which motion and machine drive each other away."""

SETTLED = 8
"""Cycles in which the motors' motion over all steps is made to agree with the machine that a few steps gave."""

ANSWERED = 2
"""Starts that are fitted further with motors that answer the forces."""

SAME = 1.01
"""Cost over that of another start up to which both are taken to have ended in the same minimum."""

ANSWERING = (3,) * 10
"""Rounds of the passes in which the motors answer. Few between reconstructions: a machine that is fitted to the end on
one of them takes the input's error into its parameters."""

ANSWERING_ALL = (4, 4, 4)
"""The same over all steps, where following motors come after them."""

FINER = 5
"""Rounds of the last fit, with a finer contact."""

STILL = 0.03
"""Share of the cost by which a pass of the search has to lower it for another to follow."""


def gantry_fit(measured: Measured, effort: Effort) -> Staged:
    """All stages, and once more from other random machines where the fit is poor, already of a few steps, and these
    come nearer along the measured motion: if they do not, what is left is not the search's fault."""
    few = problem_of(measured, Model(measured.axes, 1))
    few = few.first_steps(SEARCH_STEPS).along_measured()
    balanced = balanced_fits(few, effort)
    found = simulated_from(measured, few, balanced, effort)
    if min(found.best.fit.misfit, found.starts[-1].fit.misfit) < POOR:
        return found
    others = balanced_fits(few, replace(effort, seed=effort.seed + 1))
    if others[0].cost > NEARER * balanced[0].cost:
        return found
    again = simulated_from(measured, few, others, effort)
    return min(found, again, key=lambda staged: staged.best.fit.cost)


def explained(recording: Recording, axes: tuple[str, ...]) -> float:
    """How far a few steps are from any gantry, along the loads' measured motion: a cost for comparisons."""
    return balanced_fits(few_steps(recording, axes)[1], LITTLE)[0].cost


def explained_closely(recording: Recording, axes: tuple[str, ...]) -> float:
    """The same with the gantry simulated, which tells more and takes seconds."""
    measured, few = few_steps(recording, axes)
    return starts_of(measured, few, balanced_fits(few, LITTLE), LITTLE)[0].fit.cost


def few_steps(recording: Recording, axes: tuple[str, ...]) -> tuple[Measured, Problem]:
    """The first steps of a recording, and the problem of them along the loads' measured motion."""
    measured, model = measure(recording, axes, range(min(SEARCH_STEPS, len(recording.moves)))), Model(axes, 1)
    return measured, problem_of(measured, model).along_measured()


def simulated_from(measured: Measured, few: Problem, balanced: list[Fit], effort: Effort) -> Staged:
    """The stages that simulate, from what was found along the measured motion."""
    starts = starts_of(measured, few, balanced, effort)
    motors: Reconstruction = with_reconstructed_motion
    heavy = problem_of(measured, Model(measured.axes, 2))
    ends = carried(measured, heavy, starts, effort.heavier, motors)
    ends += alike(measured, ends, effort.heavier, motors)
    found = lowest(ends)
    if found.fit.misfit > POOR and swings_fast(measured, found.problem, found.fit):
        answering = [answered(measured, start) for start in apart(starts)[:ANSWERED]]
        ends += carried(measured, heavy, answering, ANSWERING, following_force)
        motors, found = following_force, lowest(ends)
        # How the drives are shared out shows once the motors move as they did.
        effort = replace(effort, sharings=found.fit.misfit < ENOUGH, refine=ANSWERING_ALL)
    found = impure(measured, found, effort, motors)
    whole = replace(heavy, model=found.problem.model, free=found.problem.free)
    whole, at = onward(measured, whole, found, motors)
    if found.fit.misfit > NOWHERE:
        effort = replace(effort, refine=(1,))
    last = over_all_steps(measured, whole, at, effort, motors)
    return Staged(with_finer_contact(lowest(last)), last, [*starts, *ends, found])


def apart(starts: list[Outcome]) -> list[Outcome]:
    """The starts, best first, without those that ended in the same minimum as the one before."""
    costs = [start.fit.cost for start in starts]
    return [start for k, start in enumerate(starts) if k == 0 or costs[k] > SAME * costs[k - 1]]


def carried(
    measured: Measured,
    heavy: Problem,
    starts: list[Outcome],
    rounds: tuple[int, ...],
    motors: Reconstruction,
) -> list[Outcome]:
    """The best starts carried on to gear and pinion, until one comes near."""
    ends: list[Outcome] = []
    for start in starts[:CARRIED]:
        if start.fit.misfit > ABANDONED * starts[0].fit.misfit:
            break
        ends.append(with_gear_and_pinion(measured, heavy, start, rounds, motors))
        if ends[-1].fit.misfit < ENOUGH:
            break
    return ends


def alike(
    measured: Measured, ends: list[Outcome], rounds: tuple[int, ...], motors: Reconstruction
) -> list[Outcome]:
    """Where none came near: the best one's passes with both drives of one build, until one does."""
    found, tried = lowest(ends), list[Outcome]()
    if not POOR < found.fit.misfit < HOPELESS:
        return []
    for way in WAYS:
        again = passes(measured, found.problem, begun_alike(found, way), rounds, motors, STILL, AWAY)
        tried.append(lowest(again))
        if tried[-1].fit.misfit < ENOUGH:
            break
    return tried


def answered(measured: Measured, start: Outcome) -> Outcome:
    """A start fitted further with motors that answer the forces while the machine is fitted."""
    return min(
        passes(measured, start.problem, start.fit.point, ANSWERING, following_force, dearer=AWAY),
        key=lambda o: o.fit.cost,
    )


def starts_of(measured: Measured, few: Problem, balanced: list[Fit], effort: Effort) -> list[Outcome]:
    """Fits of a few steps with one lump per drive from the balanced ones, best first. The forces that were needed for
    the measured motion say how the motors moved between their samples, before anything is simulated.

    The initial states of the measured motion are left behind: they took up what noise and bias integrate to, and from
    them the machine would be bent before they are.
    """
    ends: list[Outcome] = []
    for found in balanced:
        begun = replace(with_reconstructed_motion(measured, few, found), seen=None)
        held = replace(begun, free=(False,) * len(begun.free))
        at = fit(held, Point(found.point.shared, np.zeros(begun.local_shape)), STATES, 1.0).point
        tried = passes(measured, begun, at, effort.rounds, with_reconstructed_motion)
        ends.append(lowest(tried))
        if ends[-1].fit.misfit < NEAR:
            break
    if not lowest(ends).fit.misfit < CLOSE:
        ends += with_other_drives(measured, lowest(ends), effort)
    return sorted(ends, key=lambda o: o.fit.cost)


def with_other_drives(measured: Measured, found: Outcome, effort: Effort) -> list[Outcome]:
    """Passes from the best of what a start becomes with other drives."""
    model, local = found.problem.model, found.fit.point.local
    points = [Point(shared, local) for shared in other_drives(model, found.fit.point.shared)]
    begun = sorted((fit(found.problem, point, BEGUN, 1.0) for point in points), key=lambda f: f.cost)
    return [
        lowest(passes(measured, found.problem, f.point, effort.rounds, with_reconstructed_motion))
        for f in begun[:OTHERS]
    ]


def balanced_fits(few: Problem, effort: Effort) -> list[Fit]:
    """The best of random machines by the balance of forces along the loads' measured motion, best first."""
    drawn = candidates(few, {}, effort.candidates, effort.seed)
    points = best_starts(few, drawn, effort.tried)
    begun = sorted((fit(few, p, effort.brief, 1.0) for p in points), key=lambda f: f.cost)
    return sorted((fit(few, f.point, LONGER, 1.0) for f in begun[: effort.starts]), key=lambda f: f.cost)


def with_gear_and_pinion(
    measured: Measured, heavy: Problem, start: Outcome, rounds: tuple[int, ...], motors: Reconstruction
) -> Outcome:
    """The fit of a few steps with two lumps per drive, from one with one and its motors' motion."""
    few = replace(heavy.first_steps(SEARCH_STEPS), motion=start.problem.motion, force=start.problem.force)
    begun = split(start.problem.model, start.fit, heavy.model)
    tried = passes(measured, few, Point(begun, start.fit.point.local), rounds, motors, STILL, AWAY)
    if not tried[0].fit.misfit < HOPELESS:
        sound = Point(sound_drives(heavy.model, begun), start.fit.point.local)
        tried = passes(measured, few, sound, rounds, motors, STILL, AWAY)
    return lowest(tried)


def impure(measured: Measured, found: Outcome, effort: Effort, motors: Reconstruction) -> Outcome:
    """The fit of a few steps with what the axes do beyond the paper's model, the best of it and of drives that are as
    soft and heavy, differently shared out."""
    impure = with_impurities(found.problem, found.fit.point)
    shared = differently_shared(*impure, effort, ONLY_NOISE)
    tried = passes(measured, shared.problem, shared.fit.point, effort.heavier, motors, STILL, AWAY)
    return lowest([shared, *tried])


def over_all_steps(
    measured: Measured, problem: Problem, begin: Point, effort: Effort, motors: Reconstruction
) -> list[Outcome]:
    """Passes over all steps, the motors' motion first reconstructed by the forces of the last pass, then following
    them: the one settles from afar, the other holds where the load swings near half the rate of the samples."""
    problem, at = settled(measured, problem, begin, SETTLED, motors)
    plain = passes(measured, problem, at, effort.refine, motors)
    best = lowest(plain)
    if not best.fit.misfit < NOWHERE:
        return plain
    return plain + passes(
        measured,
        with_following_motors(measured, replace(best.problem, echoes=()), best.fit),
        best.fit.point,
        effort.following,
        with_following_motors,
        dearer=DIVERGING,
    )


def with_finer_contact(found: Outcome) -> Outcome:
    """The best fit of all steps once more, the contact's force in finer pieces. The coarser ones of the passes before,
    which are faster, are worth 0.01 µm in the median of 200 gantries, and up to half a micrometre."""
    if not found.fit.misfit < POOR:
        return found
    finer = replace(found.problem.model, effects=tuple(e.refined for e in found.problem.model.effects))
    problem = replace(found.problem, model=finer)
    last = fit(problem, found.fit.point, FINER, 0.3)
    return Outcome(problem, last) if last.cost < DIVERGING * found.fit.cost else found
