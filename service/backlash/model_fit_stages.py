"""The stages of the fit: starts on a few steps, all steps, then the motor's motion between its samples.

Rounds and numbers of starts are chosen so that a single axis takes some 2 s on one core, three times that where one
search does not do. A gantry's own stages are in model_fit_gantry.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from service.backlash.model_fit_data import Measured, problem_of, with_reconstructed_motion
from service.backlash.model_fit_impurities import impurities
from service.backlash.model_fit_problem import Fit, Point, Problem, fit
from service.backlash.model_fit_start import SEARCH_STEPS, Guess, best_starts, candidates
from service.dynamics.driven_model import LINKS, Model
from service.recording import FloatArray

HOPELESS = 1e5
"""Misfit from which on a start is given up: hundreds of times the noise, the motor's force means nothing."""


SHARINGS = tuple(
    (soft, heavy)
    for soft in ((0.15, 0.15, 0.7), (0.6, 0.2, 0.2), (0.2, 0.6, 0.2), (0.4, 0.2, 0.4))
    for heavy in ((0.7, 0.3), (0.3, 0.7))
)
"""Shares of gear, pinion and contact in the compliance and of gear and pinion in the drive's mass."""

GLIMPSE, PROMISING = 2, 2
"""Rounds that each sharing is fitted for, and how many of them go on."""


SOUND = 1.0
"""Prior deviations within which a drive's masses and damping begin where it cannot be simulated otherwise: so light a
pinion swings too fast for the grid."""

STANDSTILL = 0.05
"""Share of what is above the noise that is not worth another reconstruction."""

DIVERGING = 1.02
"""Cost over that of the best pass over all steps beyond which motion and machine drive each other away."""

SETTLES = 0.8
"""Share of the misfit that a cycle of settling has to leave at most for another to follow."""

SETTLED = 8
"""Cycles of settling over all steps, each of which has to gain."""

GOOD = 1.15
"""Misfit at which no further start and no other sharing is tried: only noise is left."""


@dataclass(frozen=True)
class Effort:
    """candidates : random machines; tried : those fitted for `brief` rounds, of which the best `starts` go on; rounds,
    heavier, refine, following : of each pass over few steps, over few steps of a gantry's heavier chain, over all
    steps, and over all steps with motors that follow; seed of the random machines; settling : cycles in which a
    start's motor motion is made to agree with it before it is fitted; sharings : whether others of softness and mass
    are tried; in_vain : misfit of a single axis' few steps from which on all steps are not fitted, as another machine
    would have to be found first."""

    candidates: int = 160
    starts: int = 3
    tried: int = 0
    brief: int = 6
    rounds: tuple[int, ...] = (7, 5, 5)
    heavier: tuple[int, ...] = ()
    refine: tuple[int, ...] = (6, 5, 5)
    following: tuple[int, ...] = ()
    seed: int = 1
    settling: int = 0
    sharings: bool = True
    in_vain: float = np.inf


@dataclass(frozen=True)
class Outcome:
    """A fit and the problem (with its motor motion) that it solved."""

    problem: Problem
    fit: Fit

    def kept(self, best: Outcome) -> Outcome:
        """The best outcome as it is, any other lean."""
        return self if self is best else self.lean()

    def lean(self) -> Outcome:
        """Without the motors' following, which is large; what was fitted stays."""
        return Outcome(replace(self.problem, following=None), self.fit)


@dataclass(frozen=True)
class Staged:
    """best : of all steps; ends : of each pass over all steps that led to it; starts : of each over a few steps."""

    best: Outcome
    ends: list[Outcome]
    starts: list[Outcome]


Reconstruction = Callable[[Measured, Problem, Fit], Problem]
"""A problem with the motors' motion between their samples by the forces of a fit."""


def backlashes(problem: Problem, found: Fit) -> FloatArray:
    """(X,) backlash of every axis [m]."""
    return np.array([found.value(problem.model, f"{axis}.backlash") for axis in problem.model.axes])


def following_force(measured: Measured, problem: Problem, found: Fit) -> Problem:
    """The problem with the motors' motion by a fit; it follows the force while the machine is fitted."""
    return with_reconstructed_motion(measured, problem, found, echoed=True)


def passes(
    measured: Measured,
    problem: Problem,
    start: Point,
    rounds: tuple[int, ...],
    motors: Reconstruction,
    still: float = 0.0,
    dearer: float = np.inf,
) -> list[Outcome]:
    """A fit, then fits with the motor's motion reconstructed from the one before; not every pass is better.

    They end where the cost stands still: within half a unit, within the share `still` of it, or within STANDSTILL of
    what is above the noise; where it rises twice in a row; and where one costs `dearer` times the best.
    """
    found = fit(problem, start, rounds[0], 1.0)
    problem = problem.judged()
    out = [Outcome(problem, found)]
    for more in rounds[1:]:
        if found.misfit > HOPELESS:
            break
        best = lowest(out)
        problem = motors(measured, problem, found)
        found = fit(problem, found.point, more, 0.3, dearest=dearer * best.fit.cost)
        problem = problem.judged()
        out = [*(o.kept(best) for o in out), Outcome(problem, found)]
        above = STANDSTILL * max(0.0, 1.0 - 1.0 / found.misfit)
        if abs(out[-2].fit.cost - found.cost) < max(0.5, max(still, above) * found.cost):
            break
        rising = [o.fit.cost for o in out[-3:]]
        if found.cost > dearer * best.fit.cost or (len(out) > 2 and rising == sorted(rising)):
            break
    return [o.kept(lowest(out)) for o in out]


def settled(
    measured: Measured, problem: Problem, start: Point, cycles: int, motors: Reconstruction
) -> tuple[Problem, Point]:
    """The machine held, its initial states and the motor's motion between the samples made to agree with it.

    A machine that is fitted before that bends its parameters to what is only an error of the interpolated input.
    """
    before = np.inf
    for _ in range(cycles):
        held = replace(problem, free=(False,) * len(problem.free))
        found = fit(held, start, 3, 1.0)
        if found.misfit > HOPELESS:
            break
        problem, start = motors(measured, problem, found), found.point
        if found.misfit > SETTLES * before:
            break
        before = found.misfit
    return replace(problem, free=(True,) * len(problem.free)), start


def from_starts(
    measured: Measured, problem: Problem, guesses: dict[str, Guess], effort: Effort
) -> list[Outcome]:
    """Passes on a few steps from each of the starts; the best of each, best first."""
    few = problem.first_steps(SEARCH_STEPS)
    ends: list[Outcome] = []
    for p in among_random(measured, problem, guesses, effort):
        at = Point(p.shared, p.local[:SEARCH_STEPS])
        motors = following_force if effort.settling else with_reconstructed_motion
        begun, at = settled(measured, few, at, effort.settling, motors)
        tried = passes(measured, begun, at, effort.rounds, motors)
        ends.append(min(tried, key=lambda o: o.fit.cost).lean())
        if ends[-1].fit.misfit < GOOD:
            break
    return sorted(ends, key=lambda o: o.fit.cost)


def among_random(
    measured: Measured, problem: Problem, guesses: dict[str, Guess], effort: Effort
) -> list[Point]:
    """Starts of a single axis: the best of random machines around the closed form's answer, and the lighter chain."""
    drawn = candidates(problem, guesses, effort.candidates, effort.seed)
    points = best_starts(problem, drawn, max(effort.starts, effort.tried))
    if effort.tried > effort.starts:
        points = most_promising(problem.first_steps(SEARCH_STEPS), points, effort)
    if problem.model.lumps == 2:
        points.insert(1, from_lighter_chain(measured, problem, guesses, effort))
    return points


def most_promising(few: Problem, points: list[Point], effort: Effort) -> list[Point]:
    """The ends of brief fits from many points on a few steps, the lowest cost first, as many as go on."""
    fits = [fit(few, Point(p.shared, p.local[:SEARCH_STEPS]), effort.brief, 1.0) for p in points]
    return [f.point for f in sorted(fits, key=lambda f: f.cost)[: effort.starts]]


def from_lighter_chain(
    measured: Measured, problem: Problem, guesses: dict[str, Guess], effort: Effort
) -> Point:
    """A start from the chain with one lump, which has fewer minima: its drive split into gear and pinion."""
    light = problem_of(measured, replace(problem.model, lumps=1))
    few = light.first_steps(SEARCH_STEPS)
    points = best_starts(light, candidates(light, guesses, effort.candidates, effort.seed), 2)
    fits = [fit(few, Point(p.shared, p.local[:SEARCH_STEPS]), effort.rounds[0], 1.0) for p in points]
    shared = split(light.model, min(fits, key=lambda f: f.cost), problem.model)
    return Point(shared, np.zeros(problem.local_shape))


def split(light: Model, found: Fit, heavy: Model) -> FloatArray:
    """Coordinates (P,) of a chain of two lumps that is about the found chain of one."""
    values = {p.name: found.value(light, p.name) for p in light.parameters}
    for axis in light.axes:
        values |= split_drive(values, axis)
    return np.array([float(p.internal(values[p.name])) for p in heavy.parameters])


def split_drive(values: dict[str, float], axis: str) -> dict[str, float]:
    """Gear and pinion that together are about as soft and as heavy as one drive lump; chosen: ratios in the middle of
    what gearboxes with a mounted pinion have."""
    k, zeta, mass = (values[f"{axis}.drive_{name}"] for name in ("stiffness", "damping_ratio", "mass"))
    gear = {"gear_stiffness": 1.3 * k, "gear_damping_ratio": zeta, "gear_mass": 0.7 * mass}
    pinion = {"pinion_stiffness": 4.0 * k, "pinion_damping_ratio": 0.03, "pinion_mass": 0.3 * mass}
    return {f"{axis}.{name}": value for name, value in (gear | pinion).items()}


def sound_drives(model: Model, shared: FloatArray) -> FloatArray:
    """The coordinates (P,) with masses and damping within SOUND."""
    drives = [p.name.endswith(("_mass", "_damping_ratio")) for p in model.parameters]
    return np.where(drives, np.clip(shared, -SOUND, SOUND), shared)


def repeated(problem: Problem, local: FloatArray) -> FloatArray:
    """Nuisance of all steps (T, X, L) from those of the first few: steps repeat, but for their direction."""
    s = problem.s[:, None, None]
    mean = np.mean(s[: len(local)] * local, axis=0)
    return np.concatenate((local, s[len(local) :] * mean))


def staged_fit(measured: Measured, model: Model, guesses: dict[str, Guess], effort: Effort) -> Staged:
    """All stages for one structure."""
    problem = problem_of(measured, model)
    starts = from_starts(measured, problem, guesses, effort)
    return refined(measured, problem, starts, effort)


def refined(measured: Measured, problem: Problem, starts: list[Outcome], effort: Effort) -> Staged:
    """The fit of all steps from the best of the starts; a single axis' impurities are freed with it, and other sharings
    of its drive are tried."""
    begin = starts[0]
    if len(measured.axes) == 1:
        problem, _ = with_impurities(problem, begin.fit.point, fine=True)
        begin = differently_shared(*with_impurities(begin.problem, begin.fit.point), effort, GOOD)
        if begin.fit.misfit > effort.in_vain:
            return Staged(begin, [begin], starts)
    at = Point(begin.fit.point.shared, repeated(problem, begin.fit.point.local))
    ends = over_all_steps(measured, problem, at, effort)
    if not lowest(ends).fit.misfit < HOPELESS:  # too light for the finer contact
        ends = over_all_steps(
            measured, problem, Point(sound_drives(problem.model, at.shared), at.local), effort
        )
    return Staged(lowest(ends), ends, starts)


def lowest(ends: list[Outcome]) -> Outcome:
    """The one with the lowest cost."""
    return min(ends, key=lambda o: o.fit.cost)


def over_all_steps(measured: Measured, problem: Problem, begin: Point, effort: Effort) -> list[Outcome]:
    """Passes over all steps, after the initial states and the motor's motion have settled."""
    problem, begin = settled(measured, problem, begin, SETTLED, following_force)
    return passes(measured, problem, begin, effort.refine, following_force, dearer=DIVERGING)


def differently_shared(few: Problem, begin: Point, effort: Effort, enough: float = 0.0) -> Outcome:
    """The best of fits on the few steps from a point and from chains that are as soft and as heavy as it, differently
    shared out. None is tried at a misfit of `enough`.

    Which part of the drive is soft and which is heavy shows in little but the onset of the contact, and each sharing
    has a minimum of its own: fitted without impurities, a bent contact is taken for a stiff one on a soft pinion.
    """
    found = fit(few, begin, effort.brief, 0.3)
    if not effort.sharings or found.misfit < enough:
        return Outcome(few, found)
    points = [Point(shared_out(few.model, found.point.shared, *way), found.point.local) for way in SHARINGS]
    begun = sorted((fit(few, point, GLIMPSE, 1.0) for point in points), key=lambda f: f.cost)
    ends = [found, *(fit(few, f.point, effort.brief, 0.3) for f in begun[:PROMISING])]
    return Outcome(few, min(ends, key=lambda f: f.cost))


def shared_out(
    model: Model, shared: FloatArray, soft: tuple[float, ...], heavy: tuple[float, ...]
) -> FloatArray:
    """Coordinates (P,) of a chain as soft, as heavy and as damped as the given one: the shares of gear, pinion and
    contact in the compliance, and of gear and pinion in the mass; each link is damped by its share of the softness."""
    values = {p.name: float(p.value(u)) for p, u in zip(model.parameters, shared, strict=True)}
    links = (*LINKS[model.lumps], "contact")
    for axis in model.axes:
        k = np.array([values[f"{axis}.{link}_stiffness"] for link in links])
        zeta = np.array([values[f"{axis}.{link}_damping_ratio"] for link in links])
        compliance, mass = np.sum(1.0 / k), sum(values[f"{axis}.{link}_mass"] for link in links[:-1])
        lasting = float(np.sum(2.0 * zeta * k**-1.5) / compliance)
        for link, share in zip(links, soft, strict=True):
            stiffness = 1.0 / (share * compliance)
            values[f"{axis}.{link}_stiffness"] = stiffness
            values[f"{axis}.{link}_damping_ratio"] = 0.5 * lasting * np.sqrt(stiffness)
        for link, share in zip(links[:-1], heavy, strict=True):
            values[f"{axis}.{link}_mass"] = share * mass
    return np.array([float(p.internal(values[p.name])) for p in model.parameters])


def with_impurities(problem: Problem, begin: Point, fine: bool = False) -> tuple[Problem, Point]:
    """The problem with what its axes do a little beyond the paper's model as further parameters, which begin at
    nothing."""
    model = replace(problem.model, effects=impurities(problem, fine))
    more = len(model.parameters) - len(problem.model.parameters)
    free = problem.free + (True,) * more
    shared = np.concatenate((begin.shared, np.zeros(more)))
    return replace(problem, model=model, free=free), Point(shared, begin.local)
