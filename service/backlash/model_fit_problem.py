"""Output-error problem: what is fitted, residuals, and a Gauss-Newton fit with all perturbations in one pass.

Free are the model's shared parameters, in coordinates in which their prior is standard normal, and for each
step and axis the load's position and speed at the first grid point, as nuisance; on a gantry the motor's position
too, since what the integrated speeds say of the distance of the two motors wanders from step to step. Residuals
are divided by the sensor's noise times max(1, present misfit), so that the priors hold while the fit is still bad.

Shapes: P shared coordinates, T steps, X axes, K samples; local (T, X, L) in units of `local_spread`, L = 2 or 3.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import PPoly
from scipy.linalg import cho_factor, cho_solve

from service.backlash.model_fit_following import Following
from service.dynamics.driven import Course, Response, course_of
from service.dynamics.driven_balance import Along, Balanced, along, balance
from service.dynamics.driven_model import LINKS, Model, Values
from service.dynamics.driven_motion import StepGrid, of_motors
from service.dynamics.driven_recoil import Recoil
from service.dynamics.driven_reconstruction import Echo, answered
from service.recording import FloatArray

DIFFERENCE = 1e-6
"""Step of the difference quotients in the fit's coordinates: the simulation is exact to 1e-12. A frequency may be known
to 1e-5 of its prior, and along a valley slopes of many parameters cancel: with quotients over 1e-4 fits ended there."""


FAR = 4.0
"""How far a parameter may go from its prior's centre, in its standard deviations."""

OVERFLOWN = 1e8
"""A derivative beyond this is a lane that left the range of numbers; its direction is left alone."""

BALANCE_TIME = 0.004
"""Time over which the motor's acceleration is averaged for where the flank holds the load at the start [s]: long
against a speed sample, so that it does not hang on how the motor's motion is interpolated."""

LADDER = np.array([1e-4, 1e-2, 0.1, 0.5, 2.0, 10.0, 1e3])
"""Dampings tried at once around the last good one: lanes cost less than another round."""

FEW_RUNGS = np.array([1e-4, 0.5, 1e3])
"""The same where only initial states are free, which are nearly linear."""

LOOK = 2
"""Rounds after which a fit is given up that is not worth going on: what they leave differs by percents from the end."""

TOGETHER = 64
"""Steps of all sets simulated in one pass: more gain no speed and cost 0.1 to 0.3 MB each."""

PROBE = 0.1
"""Share of a step at which the residuals' curvature along it is measured."""

BENT = 0.75
"""Greatest length of the curvature's part over the step's own; beyond it two terms say nothing."""


@dataclass(frozen=True)
class Problem:
    """Everything that stays fixed during one fit.

    Attributes
    ----------
    motion : (T, X) motor position at the output as a polynomial of time [m]
    noise : (X,) standard deviation of one accelerometer sample [m/s²]
    local_spread : (L,) prior of the load's initial position [m] and speed [m/s] against the contact's own, and where
        there is a third, of the motor's position [m] against its integrated speed
    free : which of the model's parameters are fitted; others stay at their start
    echoes : (T, X) how the motor's motion between its samples follows the force on it, see driven_reconstruction.echo;
        empty where it is held
    force : (T, X, K + 1) the force that `motion` was reconstructed with [m/s²]
    recoil, following : how a gantry's motors give way to the model's forces; None: their motion is held
    seen : the loads' measured motion, along which forces are balanced instead of simulated; None: they are simulated
    """

    model: Model
    grids: tuple[StepGrid, ...]
    motion: tuple[tuple[PPoly, ...], ...]
    noise: FloatArray
    local_spread: FloatArray
    free: tuple[bool, ...]
    echoes: tuple[tuple[Echo, ...], ...] = ()
    force: FloatArray | None = None
    recoil: Recoil | None = None
    following: Following | None = None
    seen: Along | None = None

    @property
    def driven(self) -> Model:
        """The model with the motors giving way."""
        if self.recoil is None:
            return self.model
        return replace(self.model, effects=(*self.model.effects, self.recoil))

    @property
    def s(self) -> FloatArray:
        return np.array([float(g.s) for g in self.grids])

    @property
    def samples(self) -> int:
        return max(int(g.measured.shape[1]) for g in self.grids)

    @property
    def together(self) -> int:
        """How many sets are simulated in one pass."""
        return max(1, TOGETHER // len(self.grids))

    @property
    def local_shape(self) -> tuple[int, int, int]:
        """Steps, axes, and nuisance coordinates of each."""
        return len(self.grids), len(self.model.axes), len(self.local_spread)

    def predicted(self, course: Course | Balanced) -> FloatArray:
        """(S, T, X, K) accelerations of simulated sets, the motors' following taken in."""
        said = course.acceleration()
        return said if self.following is None else self.following.added(said, course.force())

    def response(self, course: Course | Balanced) -> Response:
        """All that is predicted of one simulated set."""
        said = replace(course.response(), acceleration=self.predicted(course))
        if self.following is None or said.recoil is None or not len(self.following.forces):
            return said
        force, e = self.following.settled(said.force[0], said.recoil[0])
        return replace(said, force=force[None], recoil=e[None])

    def judged(self) -> Problem:
        """Without what only the forces need with which the motion is reconstructed further; it is large."""
        return self if self.following is None else replace(self, following=self.following.judged())

    def first_steps(self, n: int) -> Problem:
        """The same problem with the first n steps only."""
        force = None if self.force is None else self.force[:n]
        following = None if self.following is None else self.following.first_steps(n)
        few = replace(self, grids=self.grids[:n], motion=self.motion[:n], following=following)
        seen = None if self.seen is None else self.seen.first_steps(n)
        return replace(few, echoes=self.echoes[:n], force=force, seen=seen)

    def along_measured(self) -> Problem:
        """The same problem with the forces balanced along the loads' measured motion."""
        motors = motor_coefficients(self, np.zeros((1, len(self.model.axes))))[0]
        return replace(self, seen=along(motors, np.stack([g.measured for g in self.grids]), self.grids[0].h))

    def fixed_to(self, names: Sequence[str]) -> Problem:
        """The same problem in which only parameters ending in one of `names` are free."""
        free = tuple(any(p.name.endswith(n) for n in names) for p in self.model.parameters)
        return replace(self, free=free)


@dataclass(frozen=True)
class Point:
    """shared : (P,), local : (T, X, L), both in the fit's coordinates."""

    shared: FloatArray
    local: FloatArray


@dataclass(frozen=True)
class Fit:
    """A point, what it predicts, and how well.

    Attributes
    ----------
    misfit : mean squared residual over noise², degrees of freedom taken off; 1 when only noise is left
    cost : half the sum of squares with priors, at true noise
    """

    point: Point
    response: Response
    misfit: float
    cost: float

    def value(self, model: Model, name: str) -> float:
        """One parameter in its own unit."""
        k = [p.name for p in model.parameters].index(name)
        return float(model.parameters[k].value(self.point.shared[k]))


def motor_coefficients(problem: Problem, skews: FloatArray) -> FloatArray:
    """Motor motion of every set, step and axis on the grid: skews (S, X) [s] -> (S, T, K, X, 5)."""
    starts = np.array([grid.start for grid in problem.grids])
    return of_motors(problem.motion, starts, problem.grids[0].h, problem.samples, skews)


def load_start(problem: Problem, values: Values, c: FloatArray, local: FloatArray) -> FloatArray:
    """Load position and speed at the first grid point (S, T, X, 2), local coordinates (S, T, X, L) counted from
    where the driving flank holds the load at the motor's acceleration."""
    out = np.empty((*c.shape[:2], len(problem.model.axes), 2))
    for x, name in enumerate(problem.model.axes):
        links = (*LINKS[problem.model.lumps], "contact")
        k = 1.0 / np.sum([1.0 / values[f"{name}.{link}_stiffness"] for link in links], axis=0)
        motor, s, n = c[:, :, 0, x], problem.s, max(1, round(BALANCE_TIME / problem.grids[0].h))
        a = (c[:, :, n, x, 1] - motor[..., 1]) / (n * problem.grids[0].h)
        pull = a + s * values[f"{name}.coulomb"][:, None] + values[f"{name}.viscous"][:, None] * motor[..., 1]
        out[:, :, x, 0] = motor[..., 0] - pull / k[:, None] - 0.5 * s * values[f"{name}.backlash"][:, None]
        out[:, :, x, 1] = motor[..., 1]
    return out + (local * problem.local_spread)[..., :2]


def accelerations(problem: Problem, shared: FloatArray, local: FloatArray) -> FloatArray:
    """Simulate sets of coordinates, shared (S, P), local (S, T, X, L), a few at a time: (S, T, X, K)."""
    parts = [slice(k, k + problem.together) for k in range(0, len(shared), problem.together)]
    return np.concatenate(
        [problem.predicted(course_at(problem, shared[part], local[part])) for part in parts]
    )


def course_at(
    problem: Problem, shared: FloatArray, local: FloatArray, shift: FloatArray | None = None
) -> Course | Balanced:
    """Simulate sets of coordinates in one pass: shared (S, P), local (S, T, X, L); `shift` (S, T, K, X, 5), or with
    one T for all steps, is added to the motors' motion."""
    free = problem.model.values(shared)
    values = problem.model.complete(free)
    if problem.seen is not None:
        return balanced(problem, values, problem.seen, local)
    skews = np.stack([values[f"{a}.skew"] for a in problem.model.axes], axis=1)
    c = motor_coefficients(problem, skews)
    if len(problem.local_spread) > 2:
        c[..., 0] += (local[..., 2] * problem.local_spread[2])[:, :, None]

    def simulated(c: FloatArray) -> Course:
        load = load_start(problem, values, c, local)
        moved = c if shift is None else c + shift
        return course_of(problem.driven, free, moved, problem.s, load, problem.grids[0].h)

    course = simulated(c)
    if problem.force is not None and problem.echoes and problem.following is None:
        changed = course.force() - problem.force
        return simulated(c + answered(changed, problem.echoes, problem.grids[0].h))
    return course


def balanced(problem: Problem, values: Values, seen: Along, local: FloatArray) -> Balanced:
    """The loads' accelerations and the forces on the motors along the loads' measured motion."""
    skews = np.stack([values[f"{a}.skew"] for a in problem.model.axes], axis=1)
    motor = seen.motors(skews, (local * problem.local_spread)[..., 2:])
    load = load_start(problem, values, motor.swapaxes(2, 3), local)
    return Balanced(*balance(problem.model, values, problem.s, seen, motor, load))


def residuals(problem: Problem, acceleration: FloatArray) -> FloatArray:
    """(measured − predicted)/noise of the samples used: (S, N)."""
    measured = np.stack([g.measured for g in problem.grids])
    used = np.stack([g.used for g in problem.grids])
    difference = (measured - acceleration) / problem.noise[:, None]
    return np.asarray(difference[:, used])


def jacobian(
    problem: Problem, at: Point, difference: float = DIFFERENCE
) -> tuple[Response, FloatArray, FloatArray]:
    """Response at a point, residuals (N,), and their derivative (N, F + T·X·L), F free shared coordinates."""
    free = np.flatnonzero(problem.free)
    T, X, L = at.local.shape
    S = 1 + len(free) + L * X
    shared, local = np.tile(at.shared, (S, 1)), np.tile(at.local, (S, 1, 1, 1))
    for row, k in enumerate(free):
        shared[1 + row, k] += difference
    for j in range(L * X):
        local[1 + len(free) + j, :, j // L, j % L] += difference
    n = problem.together
    first = course_at(problem, shared[:n], local[:n])
    parts = [problem.predicted(first)]
    if n < S:
        parts.append(accelerations(problem, shared[n:], local[n:]))
    r = residuals(problem, np.concatenate(parts))
    slopes = (r[1:] - r[0]) / difference
    step_of = np.nonzero(np.stack([g.used for g in problem.grids]))[0]
    own = np.zeros((len(step_of), T, L * X))
    own[np.arange(len(step_of)), step_of] = slopes[len(free) :].T
    J = np.hstack((slopes[: len(free)].T, own.reshape(len(step_of), -1)))
    return problem.response(first.only(0)), r[0], np.where(np.abs(J) < OVERFLOWN, J, 0.0)


def moved(problem: Problem, at: Point, step: FloatArray) -> Point:
    """The point after a step of the free coordinates."""
    free = np.flatnonzero(problem.free)
    shared = at.shared.copy()
    shared[free] += step[: len(free)]
    local = at.local + step[len(free) :].reshape(at.local.shape)
    return Point(np.clip(shared, -FAR, FAR), np.clip(local, -10.0 * FAR, 10.0 * FAR))


def priors(problem: Problem, at: Point) -> FloatArray:
    """Residuals of the priors, all coordinates standard normal."""
    return np.concatenate((at.shared[np.flatnonzero(problem.free)], at.local.ravel()))


def cost(problem: Problem, at: Point, r: FloatArray, scale: float) -> float:
    """Half the sum of squares: residuals (N,) at `scale` times the noise, and the priors."""
    return 0.5 * float(r @ r) / scale**2 + 0.5 * float(np.sum(priors(problem, at) ** 2))


def trials(
    problem: Problem, at: Point, r: FloatArray, J: FloatArray, dampings: FloatArray
) -> list[tuple[Point, float]]:
    """Levenberg-Marquardt steps from one linearisation, one per damping, shortened to 2 prior deviations; with the
    curvature along each of them taken in (geodesic acceleration) where two terms say something.

    Stiffnesses and masses of a chain, each sharp and together loose, lie along a bent valley, in which straight
    steps are short.
    """
    scale = max(1.0, float(np.sqrt(np.mean(r**2))))
    H = J.T @ J / scale**2 + np.eye(J.shape[1])
    g = J.T @ r / scale**2 + priors(problem, at)
    solvers = [cho_factor(H + damping * np.diag(np.diag(H))) for damping in dampings]
    steps = [shortened(-cho_solve(solver, g)) for solver in solvers]
    probes = residuals_at(problem, [moved(problem, at, PROBE * step) for step in steps])
    points = []
    for solver, step, probe, damping in zip(solvers, steps, probes, dampings, strict=True):
        bend, taken = 2.0 / PROBE * ((probe - r) / PROBE - J @ step), step
        if np.all(np.isfinite(bend)):
            second = -0.5 * cho_solve(solver, J.T @ bend / scale**2)
            if second @ (np.diag(H) * second) < BENT**2 * (step @ (np.diag(H) * step)):
                taken = shortened(step + second)
        points.append((moved(problem, at, taken), damping))
    return points


def shortened(step: FloatArray) -> FloatArray:
    """A step of at most 2 prior deviations in any coordinate."""
    return np.asarray(step * min(1.0, 2.0 / float(np.max(np.abs(step)))))


def residuals_at(problem: Problem, points: Sequence[Point]) -> FloatArray:
    """Residuals (S, N) of points, simulated in one pass."""
    shared, local = np.stack([p.shared for p in points]), np.stack([p.local for p in points])
    with np.errstate(all="ignore"):
        return residuals(problem, accelerations(problem, shared, local))


def best_trial(problem: Problem, points: Sequence[Point], scale: float) -> tuple[int, float]:
    """Which of the points has the lowest cost, and that cost; all are simulated in one pass."""
    r = residuals_at(problem, points)
    costs = [
        cost(problem, p, row, scale) if np.all(np.isfinite(row)) else np.inf
        for p, row in zip(points, r, strict=True)
    ]
    return int(np.argmin(costs)), float(np.min(costs))


def fit(
    problem: Problem, start: Point, rounds: int = 25, tolerance: float = 0.02, dearest: float = np.inf
) -> Fit:
    """Levenberg-Marquardt, several dampings tried at once.

    Ends when a round gains less than `tolerance` of cost (0.02: a hundredth of a standard deviation in one
    parameter changes it by less), after `rounds`, or after LOOK of them at a cost above `dearest`.
    """
    at, damping = start, 1e-2
    ladder = LADDER if any(problem.free) else FEW_RUNGS
    response, r, J = jacobian(problem, at)
    for remaining in range(rounds if np.all(np.isfinite(r)) else 0, 0, -1):
        scale = max(1.0, float(np.sqrt(np.mean(r**2))))
        points = trials(problem, at, r, J, damping * ladder)
        best, reached = best_trial(problem, [point for point, _ in points], scale)
        gained = cost(problem, at, r, scale) - reached
        if gained <= 0.0:
            if damping > 1e3:
                break
            damping *= 1e4
            continue
        at, damping = points[best][0], float(np.clip(points[best][1], 1e-6, 1e6))
        if gained < tolerance or remaining == 1:
            response, r = answer(problem, at)
            break
        response, r, J = jacobian(problem, at)
        if rounds - remaining + 1 == LOOK and cost(problem, at, r, 1.0) > dearest:
            break
    return finished(problem, at, response, r)


def answer(problem: Problem, at: Point) -> tuple[Response, FloatArray]:
    """Response at a point, and residuals (N,)."""
    course = course_at(problem, at.shared[None], at.local[None])
    return problem.response(course), residuals(problem, problem.predicted(course))[0]


def finished(problem: Problem, at: Point, response: Response, r: FloatArray) -> Fit:
    """Misfit and cost at the end of a fit."""
    r = np.clip(np.nan_to_num(r, nan=OVERFLOWN), -OVERFLOWN, OVERFLOWN)
    misfit = float(r @ r) / max(1, len(r) - sum(problem.free) - at.local.size)
    return Fit(at, response, misfit, cost(problem, at, r, 1.0))
