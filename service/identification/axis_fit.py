"""Fit of the axis model by damped least squares with broad priors; all perturbations run as lanes of one pass."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from service.identification.axis_effects import AxisEffect
from service.identification.axis_problem import AxisProblem, read_sensor
from service.identification.axis_simulation import simulate
from service.recording import FloatArray

DAMPINGS = (1e-2, 1e-1, 1.0, 10.0, 100.0, 1e3)
STEP = 2e-3
"""Finite-difference step in the fit's coordinates, whose unit is one prior standard deviation (chosen: large
against the jaggedness of fixed time steps, small against the curvature)."""


@dataclass(frozen=True)
class Coordinate:
    """One fitted number: value = typical·exp(spread·z) if logarithmic, else typical + spread·z; prior z ~ N(0, 1)."""

    name: str
    axis: int | None
    typical: float
    spread: float
    logarithmic: bool
    bounds: tuple[float, float]
    unit: str

    def value(self, z: FloatArray) -> FloatArray:
        v = self.typical * np.exp(self.spread * z) if self.logarithmic else self.typical + self.spread * z
        return np.asarray(np.clip(v, *self.bounds))

    def internal(self, value: float) -> float:
        if self.logarithmic:
            return float(np.log(value / self.typical) / self.spread)
        return (value - self.typical) / self.spread


def declared_coordinates(axes: int) -> tuple[Coordinate, ...]:
    """The declared model's numbers for every axis.

    Priors are those of machine axes of 50 to 5,000 kg with contacts of 30 to 300 Hz; they keep a fit sane, the
    data decide. The drive's mass is that of gearbox and pinion over the moved mass.
    """
    rows = (
        ("backlash", 5e-5, 1.5, True, (1e-7, 2e-3), "m"),
        ("contact_stiffness", 4e5, 1.2, True, (1e3, 1e8), "1/s^2"),
        ("contact_damping", 60.0, 1.2, True, (0.0, 2e3), "1/s"),
        ("drive_stiffness", 1e6, 1.0, True, (1e3, 1e8), "1/s^2"),
        ("drive_damping", 100.0, 1.2, True, (0.0, 2e3), "1/s"),
        ("drive_mass", 0.04, 0.7, True, (2e-3, 2.0), "1"),
        ("coulomb", 0.3, 1.0, True, (0.0, 20.0), "m/s^2"),
        ("viscous", 1.0, 1.0, True, (0.0, 100.0), "1/s"),
        ("turnover_speed", 5e-4, 0.7, True, (5e-5, 1e-2), "m/s"),
    )
    return tuple(Coordinate(n, a, t, s, g, b, u) for n, t, s, g, b, u in rows for a in range(axes))


def effect_coordinates(effect: AxisEffect, axes: int) -> tuple[Coordinate, ...]:
    """An effect's numbers; a dose is a tenth of the prior's width for linear ones, so that data decide."""
    out = []
    for p in effect.parameters:
        spread = p.dose if p.logarithmic else 10.0 * p.dose
        typical = p.starts[0] if p.logarithmic else 0.0
        where: Sequence[int | None] = (None,) if p.shared else tuple(range(axes))
        out += [Coordinate(p.name, a, typical, spread, p.logarithmic, p.bounds, p.unit) for a in where]
    return tuple(out)


@dataclass(frozen=True)
class AxisModel:
    """A model with its numbers: effects that are in, coordinates, and where they stand (n,)."""

    axes: int
    effects: tuple[AxisEffect, ...]
    coordinates: tuple[Coordinate, ...]
    z: FloatArray

    def values(self, Z: FloatArray) -> dict[str, FloatArray]:
        """Parameter arrays (L, 1, A) of the lanes Z (L, n)."""
        P: dict[str, FloatArray] = {}
        for column, c in enumerate(self.coordinates):
            value = c.value(Z[:, column])
            table = P.setdefault(c.name, np.empty((len(Z), 1, self.axes)))
            table[:, 0, slice(None) if c.axis is None else slice(c.axis, c.axis + 1)] = value[:, None]
        return P

    def at(self, z: FloatArray) -> AxisModel:
        return AxisModel(self.axes, self.effects, self.coordinates, z)

    def value(self, name: str, axis: int) -> float:
        """One parameter's present value."""
        return float(self.values(self.z[None])[name][0, 0, axis])

    def index(self, name: str) -> list[int]:
        return [k for k, c in enumerate(self.coordinates) if c.name == name]


def declared_model(axes: int) -> AxisModel:
    coordinates = declared_coordinates(axes)
    return AxisModel(axes, (), coordinates, np.zeros(len(coordinates)))


def extended(model: AxisModel, effect: AxisEffect) -> AxisModel:
    """The model with one more effect, at the effect's first start values."""
    new = effect_coordinates(effect, model.axes)
    starts = {p.name: p.starts[0] for p in effect.parameters}
    z = np.array([c.internal(starts[c.name]) for c in new])
    return AxisModel(
        model.axes, (*model.effects, effect), (*model.coordinates, *new), np.concatenate([model.z, z])
    )


@dataclass(frozen=True)
class Fit:
    """A fitted model on one recording: the model, and the pinion's zeros ``offsets`` (W, A) in half backlashes.

    Where the pinion stands in its gap is found again for every move: it creeps in every rest (gravity, a
    settling controller). The prior's standard deviation is half a backlash.
    """

    model: AxisModel
    offsets: FloatArray


def residuals(problem: AxisProblem, model: AxisModel, Z: FloatArray, offsets: FloatArray) -> FloatArray:
    """Measured minus predicted over the noise (m, L); lanes Z (L, n), offsets (L, W, A) in prior units."""
    P = model.values(Z)
    speed = simulate(problem.motion, P, model.effects, offsets)
    return problem.target()[:, None] - read_sensor(problem, speed, P)


def errors(problem: AxisProblem, fitted: Fit) -> FloatArray:
    """Measured minus predicted over the noise (m,)."""
    return residuals(problem, fitted.model, fitted.model.z[None], fitted.offsets[None])[:, 0]


def rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def jacobian(problem: AxisProblem, fitted: Fit, free: Sequence[int]) -> tuple[FloatArray, FloatArray]:
    """Residual (m,) and its derivatives (m, len(free) + W·A): numbers, then offsets.

    A zero acts on its own move only, so one lane per axis moves the zeros of all moves at once.
    """
    A, W, F = len(problem.axes), len(problem.moves), len(free)
    Z = np.repeat(fitted.model.z[None], F + A + 1, axis=0)
    Z[np.arange(1, F + 1), list(free)] += STEP
    offsets = np.repeat(fitted.offsets[None], F + A + 1, axis=0)
    for axis in range(A):
        offsets[F + 1 + axis, :, axis] += STEP
    R = residuals(problem, fitted.model, Z, offsets)
    J = (R[:, 1:] - R[:, :1]) / STEP
    window = problem.windows()
    zeros = [J[:, F + axis] * (window == number) for number in range(W) for axis in range(A)]
    return R[:, 0], np.column_stack([J[:, :F], *zeros])


def fit(
    problem: AxisProblem,
    start: Fit,
    iterations: int = 12,
    free: Sequence[int] | None = None,
    weight: FloatArray | None = None,
) -> Fit:
    """Damped least squares (Levenberg-Marquardt) from a start; ``free`` numbers move, all zeros always do.

    Residuals are divided by max(1, present RMS), so that the priors hold while the fit is still bad.
    ``weight`` (m,) of 0 or 1 says which samples count.
    """
    free = list(range(len(start.model.z)) if free is None else free)
    n, shape = len(free), start.offsets.shape
    now, damping = start, 1.0
    w = np.ones(len(problem.target())) if weight is None else weight
    for _ in range(iterations):
        r, J = jacobian(problem, now, free)
        r, J = np.nan_to_num(r * w), np.nan_to_num(J * w[:, None])
        scale = max(1.0, float(r @ r) / float(w.sum()))
        place = np.concatenate([now.model.z[free], now.offsets.ravel()])
        H = J.T @ J / scale + np.eye(len(place))
        g = J.T @ r / scale + place
        trial = np.repeat(place[None], len(DAMPINGS), axis=0)
        for row, factor in zip(trial, DAMPINGS, strict=True):
            row -= np.clip(np.linalg.solve(H + np.diag(damping * factor * np.diag(H)), g), -1.0, 1.0)
        Z = np.repeat(now.model.z[None], len(trial), axis=0)
        Z[:, free] = trial[:, :n]
        R = residuals(problem, now.model, Z, trial[:, n:].reshape(-1, *shape)) * w[:, None]
        cost = np.sum(R**2, axis=0) / scale + np.sum(trial**2, axis=1)
        cost = np.where(np.isfinite(cost), cost, np.inf)
        before = float(r @ r / scale + place @ place)
        best = int(np.argmin(cost))
        if cost[best] >= before:
            damping *= 1e3
            if damping > 1e6:
                break
            continue
        now = Fit(now.model.at(Z[best]), trial[best, n:].reshape(shape))
        damping = max(1e-6, damping * DAMPINGS[best])
        if before - cost[best] < 3e-4 * before:
            break
    return now
