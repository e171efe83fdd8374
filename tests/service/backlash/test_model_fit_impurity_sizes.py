"""The widths of the impurities' priors by the evidence: on linear problems of which everything is known."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from service.backlash.model_fit_impurities import MeshError
from service.backlash.model_fit_impurity_sizes import by_evidence
from service.backlash.model_fit_interval import Linearised, Step
from service.backlash.model_fit_mesh_waves import band
from service.backlash.model_fit_problem import Point
from service.dynamics.driven_model import Model
from service.recording import FloatArray

NAMES = ("X1.backlash", "X1.mesh_1", "X1.mesh_2", "X1.mesh_3")
T, N = 5, 40


def design(P: int) -> FloatArray:
    """Derivatives (T, N, P) of the residuals: the backlash and the first mesh error are nearly alike, the others are
    plain to see."""
    rng = np.random.default_rng(11)
    columns = rng.standard_normal((T, N, P))
    columns[..., 1] = columns[..., 0] + 0.05 * columns[..., 1]
    return columns


def fitted(
    true: FloatArray, seed: int, names: tuple[str, ...] = NAMES, effects: tuple[MeshError, ...] = ()
) -> Linearised:
    """A fit at its end of residuals with noise 1, all priors standard normal."""
    S = design(len(true))
    noise = np.random.default_rng(seed).standard_normal((T, N))
    information = np.eye(len(true)) + np.tensordot(S, S, ((0, 1), (0, 1)))
    covariance = np.linalg.inv(information)
    u = covariance @ np.tensordot(S, S @ true + noise, ((0, 1), (0, 1)))
    left = S @ (u - true) - noise
    parameters = [SimpleNamespace(name=name) for name in names]
    model = SimpleNamespace(parameters=parameters, effects=effects, axes=("X1",))
    index = np.arange(N)
    steps = [Step(0 * index, index, r, s, np.zeros((N, 0)), s) for r, s in zip(left, S, strict=True)]
    return Linearised(cast(Model, model), (), Point(u, np.zeros((T, 1, 0))), tuple(steps), covariance)


def test_a_clean_mesh_sharpens_the_backlash() -> None:
    clean = np.array([0.3, 0.0, 0.0, 0.0])
    pairs = [(fit, by_evidence(fit, 1.0)[0]) for fit in (fitted(clean, seed) for seed in range(200))]
    errors = np.array([[before.at.shared[0] - 0.3, after.at.shared[0] - 0.3] for before, after in pairs])
    plain, shrunk = np.sqrt(np.mean(errors**2, axis=0))
    assert shrunk < 0.6 * plain


def test_a_flank_that_is_not_bent_sharpens_the_backlash_too() -> None:
    """One coordinate is less evidence than three, but is not to be told from the backlash either."""
    straight, names = np.array([0.3, 0.0, 0.0, 0.0]), ("X1.backlash", "X1.bend", "X1.mesh_1", "X1.mesh_2")
    errors = []
    for seed in range(200):
        fit = fitted(straight, seed, names)
        errors.append([fit.at.shared[0] - 0.3, by_evidence(fit, 1.0)[0].at.shared[0] - 0.3])
    plain, shrunk = np.sqrt(np.mean(np.square(errors), axis=0))
    assert shrunk < 0.8 * plain


def test_a_mesh_error_that_is_plain_to_see_keeps_its_prior() -> None:
    fit = fitted(np.array([0.3, 1.2, 1.0, -0.8]), 3)
    same, unsure = by_evidence(fit, 1.0)
    assert same.covariance[0, 0] == pytest.approx(fit.covariance[0, 0], rel=0.25)
    assert abs(same.at.shared[0] - fit.at.shared[0]) < 0.5 * np.sqrt(fit.covariance[0, 0])
    assert unsure[0, 0] < fit.covariance[0, 0]


def test_what_the_interval_adds_up_to_is_the_scatter_of_the_estimates() -> None:
    """Sound machines with mesh errors of every size within the widths, evenly in the logarithm."""
    z = []
    for seed in range(300):
        rng = np.random.default_rng(1000 + seed)
        width = 2.0 ** -rng.uniform(0.0, 4.0)
        true = np.array([0.3, *(width * rng.standard_normal(3))])
        fit, unsure = by_evidence(fitted(true, seed), 1.0)
        z.append((fit.at.shared[0] - 0.3) / np.sqrt(fit.covariance[0, 0] + unsure[0, 0]))
    assert 0.8 < np.std(z) < 1.15


def test_residuals_move_with_the_parameters() -> None:
    fit = fitted(np.array([0.3, 0.0, 0.0, 0.0]), 5)
    after, _ = by_evidence(fit, 1.0)
    for before, step in zip(fit.steps, after.steps, strict=True):
        assert step.r == pytest.approx(before.r + before.shared @ (after.at.shared - fit.at.shared))


def test_the_bows_of_a_wave_say_how_steep_it_is() -> None:
    """Waves of one tooth's length and any phase, on a stroke of a little less."""
    length, rng = 5e-3, np.random.default_rng(6)
    names = ("X1.backlash", *(f"X1.{p.name}" for p in MeshError.own))
    root = np.linalg.cholesky(band(length, 6.2e-3, 6.4e-3))
    errors = []
    for seed in range(200):
        true = np.array([0.3, *(root @ rng.standard_normal(len(root)))])
        known, unknown = (
            by_evidence(fitted(true, seed, names, effects), 1.0)[0].at.shared[0] - 0.3
            for effects in ((MeshError(("X1",), 0.0, length),), ())
        )
        errors.append([known, unknown])
    with_waves, without = np.sqrt(np.mean(np.square(errors), axis=0))
    assert with_waves < 0.7 * without
