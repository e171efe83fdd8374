"""What a fit's backlash costs beside its value, everything else following.

Fitting everything else again for every value that is looked at takes as long as the fit itself, and is needed where
the answer of the machine changes its kind: where a flank is reached no more. Elsewhere the backlash alone is moved and
simulated, and what the others make up for is linear. They follow along a bent valley, so a machine led along its
straight line would be far off; what they make up for is not.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from service.backlash.model_fit_impurity_sizes import meshes, narrowed
from service.backlash.model_fit_interval import Linearised
from service.backlash.model_fit_problem import Point, fit, residuals_at
from service.backlash.model_fit_stages import Outcome
from service.recording import FloatArray

ALIKE = 0.2
"""Share by which the rise of the cost may differ from a parabola's for nothing else to be looked at."""

LITTLE = 0.3
"""And what it may differ by in any case: less than a standard deviation."""

ROUNDS = 6

INPUT_OFF = 1.5
"""Misfit from which on the motors' motion is what is wrong, not the machine."""


@dataclass(frozen=True)
class Beside:
    """A gantry's best fit, linearised, with the mesh errors' prior of the given width over that of the fit; and the
    best pass with the coarser contact, which is faster fitted again, and differs by as much beside as at its end."""

    best: Outcome
    linear: Linearised
    width: float
    coarse: Outcome

    def rise(self, k: int, value: float) -> float:
        """How much the least cost lies higher with parameter k held at a value.

        Where more than noise is left, linear is good enough: fitted again, the others would take up the input's error.
        """
        u = float(self.best.problem.model.parameters[k].internal(value))
        shared = self.linear.at.shared.copy()
        shared[k] = u
        r = residuals_at(self.best.problem, [Point(shared, self.linear.at.local)])[0]
        rise = self.least(r, shared, held=k)[0] - self.lowest[0]
        away = u - self.linear.at.shared[k] - self.lowest[1][k]
        parabola = 0.5 * away**2 / float(np.linalg.inv(self.information)[k, k])
        if self.best.fit.misfit > INPUT_OFF or abs(rise - parabola) < ALIKE * parabola + LITTLE:
            return rise
        name = self.best.problem.model.parameters[k].name
        apart = self.coarse.fit.value(self.coarse.problem.model, name) - self.best.fit.value(
            self.best.problem.model, name
        )
        return self.fitted(k, value + apart) - self.narrow.fit.cost

    @cached_property
    def prior(self) -> FloatArray:
        """(P,) weight of every shared coordinate's prior."""
        return np.where(meshes(self.best.problem.model), self.width**-2.0, 1.0)

    @cached_property
    def information(self) -> FloatArray:
        """(P, P) on the shared coordinates, the steps' own following."""
        seen = np.linalg.inv(self.linear.covariance) - np.eye(len(self.prior))
        return np.asarray(seen + np.diag(self.prior))

    @cached_property
    def lowest(self) -> tuple[float, FloatArray]:
        """The least cost with nothing held, and what it moves the shared coordinates by."""
        return self.least(np.concatenate([step.r for step in self.linear.steps]), self.linear.at.shared)

    def least(self, r: FloatArray, shared: FloatArray, held: int | None = None) -> tuple[float, FloatArray]:
        """Least cost from residuals (n,) on, everything not held following linearly, and what follows (P,)."""
        total, slope, first = 0.5 * float(self.prior @ shared**2), self.prior * shared, 0
        for step, local in zip(self.linear.steps, self.linear.at.local, strict=True):
            v = r[first : first + len(step.r)] - step.own @ local.ravel()
            first += len(step.r)
            own = step.own.T @ v
            total += 0.5 * float(v @ v - own @ np.linalg.solve(step.own.T @ step.own + np.eye(len(own)), own))
            slope = slope + step.cleared.T @ v
        free = np.arange(len(shared)) != held
        moved = np.zeros(len(shared))
        moved[free] = -np.linalg.solve(self.information[np.ix_(free, free)], slope[free])
        return total + 0.5 * float(slope @ moved), moved

    @cached_property
    def narrow(self) -> Outcome:
        """The coarser fit under the narrower prior."""
        return narrowed(self.coarse, self.width)

    def fitted(self, k: int, value: float) -> float:
        """The least cost with parameter k held at a value, everything else fitted again."""
        problem, at = self.narrow.problem, self.narrow.fit.point
        shared = at.shared.copy()
        shared[k] = problem.model.parameters[k].internal(value)
        free = tuple(j != k and freed for j, freed in enumerate(problem.free))
        return fit(replace(problem, free=free), Point(shared, at.local), ROUNDS, 0.3).cost
