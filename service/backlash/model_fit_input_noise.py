"""What the noise of a motor's speed moves a fit's backlash by.

The model is driven by the measured speed. Its noise is an error of the input: integrated, the motor's position wanders
within a step, and stiff flanks turn that into accelerations. What of them looks like another machine the parameters
take up, and no residual shows it; so each sample's own error is taken through the simulation, and what it moves the
backlash by through the residuals' influence. The samples' errors are taken as independent of each other.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from scipy.interpolate import CubicSpline

from service.backlash.model_fit_data import Measured
from service.backlash.model_fit_problem import Point, Problem, course_at
from service.backlash.model_fit_stages import Outcome
from service.backlash.rest_noise import sample_noise
from service.dynamics.driven_motion import between
from service.recording import FloatArray

BEYOND = 4
"""Samples before and after a step whose error reaches into it through the spline."""


def errors_of_samples(
    time: FloatArray, size: FloatArray, starts: Sequence[float], h: float, K: int
) -> FloatArray:
    """Motion that an error of each speed sample adds on T grids: (samples, T, K, 5), beginning at zero.

    Parameters
    ----------
    time, size : of the samples [s] and their errors [m/s] at the output, (n,) each
    starts : (T,) first grid points [s], K intervals of length h [s] each
    """
    parts = []
    for start in starts:
        near = np.flatnonzero((time > start) & (time < start + K * h))
        near = np.arange(max(0, near[0] - BEYOND), min(near[-1] + BEYOND + 1, len(time)))
        position = CubicSpline(time[near], np.diag(size[near])).antiderivative()
        points = start + h * np.arange(K + 1)
        x, v, a = (np.asarray(position(points, nu)).T for nu in range(3))
        parts.append(between(x - x[:, :1], v, a, h))
    out = np.zeros((max(len(part) for part in parts), len(parts), K, 5))
    for step, part in enumerate(parts):
        out[: len(part), step] = part
    return out


def moved_by_samples(measured: Measured, outcome: Outcome) -> Iterator[FloatArray]:
    """What one standard deviation of each speed sample does to the residuals of a fit, (S, T, X, K) for a few samples
    at a time."""
    problem, fit = outcome.problem, outcome.fit
    T, X, _ = problem.local_shape
    still = predicted(problem, fit.point, np.zeros((1, T, problem.samples, X, 5)))
    for x, axis in enumerate(measured.axes):
        speed = measured.recording.traces[axis, "motor_speed"]
        noise = sample_noise(speed, measured.recording) * measured.recording.axis(axis).transmission
        skew = fit.value(problem.model, f"{axis}.skew")
        starts = [grid.start + skew for grid in problem.grids]
        size = np.full(len(speed), noise)
        errors = errors_of_samples(speed.time, size, starts, problem.grids[0].h, problem.samples)
        for part in np.array_split(errors, -(-len(errors) // problem.together)):
            shifts = np.zeros((*part.shape[:3], X, 5))
            shifts[:, :, :, x] = part
            yield np.nan_to_num((predicted(problem, fit.point, shifts) - still) / problem.noise[:, None])


def input_variance(measured: Measured, best: Outcome, influence: FloatArray) -> float:
    """Variance of a parameter, in its unit squared, by the noise of the motors' speeds; `influence` (T, X, K) is what
    a unit of every residual moves it by."""
    moved = (
        np.einsum("stxk,txk,t->st", change, influence, best.problem.s)
        for change in moved_by_samples(measured, best)
    )
    return sum(float(np.sum(part**2)) for part in moved)


def expected_misfit(measured: Measured, outcome: Outcome) -> float:
    """Misfit that a right machine would have before it is fitted, by its sensor's noise and that of the speeds."""
    used = np.stack([grid.used for grid in outcome.problem.grids])
    squares = sum(np.sum(change**2, axis=0) for change in moved_by_samples(measured, outcome))
    return 1.0 + float(np.mean(np.asarray(squares)[used]))


def predicted(problem: Problem, at: Point, shifts: FloatArray) -> FloatArray:
    """Accelerations (S, T, X, K) with the motors moved by `shifts` (S, T, K, X, 5)."""
    S = len(shifts)
    lanes = np.tile(at.shared, (S, 1)), np.tile(at.local, (S, 1, 1, 1))
    return problem.predicted(course_at(problem, *lanes, shifts))
