"""How large a machine's impurities are, by its own recording, and the backlash that goes with them.

The slope of the mesh's error at the middle of the stroke is hardly to be told from the backlash, nor is how a flank's
force is bent where the sensor is noisy, and under priors as wide as MESH and BEND either costs up to a micrometre, on
clean machines too. But a mesh's error of that size is bent as well, and its bows shake the load: the recording says
how large the error of this machine is. So the priors' widths are unknown too. For each of a few the fit at its end,
taken linear, says what the backlash would be and how likely the recording is; the backlash is their mean by those
likelihoods (a hierarchical prior, its widths evenly in the logarithm).
"""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from service.backlash.model_fit_data import Measured
from service.backlash.model_fit_impurities import MeshError
from service.backlash.model_fit_interval import Linearised
from service.backlash.model_fit_problem import FAR, Point, Problem
from service.backlash.model_fit_problem import fit as fit_from
from service.backlash.model_fit_stages import Outcome, Reconstruction, passes
from service.dynamics.driven_model import Model
from service.recording import FloatArray

WIDTHS = (1 / 16, 1 / 8, 1 / 4, 1 / 2, 1.0)
"""Of the impurities' priors, over those of the fit. The least is a mesh error of 0.2 µm: it moves no backlash any more.
"""

ROUNDS, PASSES = 4, (8, 6, 6)
"""Of a fit under another width, and of each pass without impurities."""


class Weighed(NamedTuple):
    """What a linearised fit says under each pair of W widths, those of the mesh errors and of the bends.

    Attributes
    ----------
    share : (W·W,) how likely each pair is, together 1, the widths of the mesh errors slowest
    moved : (W·W, P) what it moves the shared coordinates by
    covariance : (W·W, P, P) of them at true noise
    """

    share: FloatArray
    moved: FloatArray
    covariance: FloatArray


def weighed(fit: Linearised, misfit: float) -> Weighed:
    """The linearised fit under every pair of widths. Residuals are taken as large as they are: the likelihood of a fit
    with a `misfit` above 1 is that much flatter."""
    u, mesh, bend = fit.at.shared, meshes(fit.model), bends(fit.model)
    information = np.linalg.inv(fit.covariance) / max(1.0, misfit)
    moved, covariances, weights = [], [], []
    for of_mesh, of_bend in product(WIDTHS, WIDTHS if np.any(bend) else WIDTHS[-1:]):
        width = np.where(mesh, of_mesh, np.where(bend, of_bend, 1.0))
        tighter = width**-2.0 - 1.0
        covariance = np.linalg.inv(information + np.diag(tighter))
        step = -covariance @ (tighter * u)
        cost = 0.5 * step @ information @ step + 0.5 * np.sum(tighter * (u + step) ** 2)
        volume = 0.5 * np.linalg.slogdet(covariance)[1] - np.sum(np.log(width))
        moved.append(step)
        covariances.append(covariance / max(1.0, misfit))
        weights.append(volume - cost)
    share = np.exp(np.array(weights) - max(weights))
    return Weighed(share / np.sum(share), np.stack(moved), np.stack(covariances))


def meshes(model: Model) -> NDArray[np.bool_]:
    """(P,) which of the shared coordinates are mesh errors."""
    return np.array([".mesh_" in p.name for p in model.parameters])


def bends(model: Model) -> NDArray[np.bool_]:
    """(P,) which of the shared coordinates are bends of contacts."""
    return np.array([p.name.endswith(".bend") for p in model.parameters])


def by_evidence(fit: Linearised, misfit: float) -> tuple[Linearised, FloatArray]:
    """The linearised fit as the mean over the widths by their likelihood, and the variance of all shared coordinates
    (P, P) that not knowing the width adds."""
    share, moved, covariances = weighed(fit, misfit)
    mean = share @ moved
    apart = moved - mean
    steps = tuple(replace(step, r=step.r + step.cleared @ mean) for step in fit.steps)
    covariance = np.tensordot(share, covariances, 1)
    return (
        replace(fit, at=Point(fit.at.shared + mean, fit.at.local), steps=steps, covariance=covariance),
        np.asarray((share[:, None] * apart).T @ apart),
    )


def likeliest_width(fit: Linearised, misfit: float) -> float:
    """Of the mesh errors' prior, over that of the fit."""
    share = weighed(fit, misfit).share.reshape(len(WIDTHS), -1)
    return WIDTHS[int(np.argmax(np.sum(share, axis=1)))]


def narrowed(best: Outcome, width: float) -> Outcome:
    """The best fit, found again under a mesh errors' prior of another width."""
    problem, at = of_width(best.problem, best.fit.point, width)
    return Outcome(problem, fit_from(problem, at, ROUNDS, 0.3))


def of_width(problem: Problem, at: Point, width: float) -> tuple[Problem, Point]:
    """The problem with a mesh errors' prior of another width, and the same point of it."""
    shared = np.where(meshes(problem.model), np.clip(at.shared / width, -FAR, FAR), at.shared)
    effects = tuple(replace(e, width=width) if isinstance(e, MeshError) else e for e in problem.model.effects)
    return replace(problem, model=replace(problem.model, effects=effects)), Point(shared, at.local)


def without_impurities(measured: Measured, best: Outcome, motors: Reconstruction) -> list[Outcome]:
    """Passes from the best fit on, its impurities gone and kept small: a sound machine that is near by."""
    model, at = best.problem.model, best.fit.point
    clean = Point(np.where(meshes(model) | bends(model), 0.0, at.shared), at.local)
    return passes(measured, *of_width(best.problem, clean, WIDTHS[0]), PASSES, motors)
