"""How large a machine's impurities are, by its own recording, and the backlash that goes with them.

The slope of the mesh's error at the middle of the stroke is hardly to be told from the backlash, nor is how a flank's
force is bent where the sensor is noisy, and under priors as wide as MESH and BEND either costs up to a micrometre, on
clean machines too. But a mesh's error of that size is bent as well, and its bows shake the load: the recording says
how large the error of this machine is, and how long its waves are (model_fit_mesh_waves). So the priors' widths and the
waves' length are unknown too. For each of a few the fit at its end, taken linear, says what the backlash would be and
how likely the recording is; the backlash is their mean by those likelihoods (a hierarchical prior, its widths evenly in
the logarithm).
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
from service.backlash.model_fit_mesh_waves import of_waves
from service.backlash.model_fit_problem import FAR, Point, Problem
from service.backlash.model_fit_problem import fit as fit_from
from service.backlash.model_fit_stages import Outcome, Reconstruction, lowest, passes
from service.dynamics.driven_model import Model
from service.recording import FloatArray

WIDTHS = (1 / 16, 1 / 8, 1 / 4, 1 / 2, 1.0)
"""Of the impurities' priors, over those of the fit. The least is a mesh error of 0.2 µm: it moves no backlash any more.
"""

ROUNDS, PASSES = 4, (8, 6, 6)
"""Of a fit under another width, and of each pass without impurities."""
PART = WIDTHS[2]
"""What is kept of impurities at first that a fit is led out of by and by (chosen)."""


class Weighed(NamedTuple):
    """What a linearised fit says under each of M priors: for each kind of waves, each of the W widths of the mesh
    errors, and each of the W widths of the bends, the last fastest.

    Attributes
    ----------
    share : (M,) how likely each prior is, together 1
    moved : (M, P) what it moves the shared coordinates by
    covariance : (M, P, P) of them at true noise
    """

    share: FloatArray
    moved: FloatArray
    covariance: FloatArray


def weighed(fit: Linearised, misfit: float) -> Weighed:
    """The linearised fit under every prior. Residuals are taken as large as they are: the likelihood of a fit with a
    `misfit` above 1 is that much flatter."""
    u, bend, scale = fit.at.shared, bends(fit.model), max(1.0, misfit)
    seen = (np.linalg.inv(fit.covariance) - np.eye(len(u))) / scale
    moved, covariances, weights = [], [], []
    for waves, of_mesh in product(priors_of_waves(fit.model), WIDTHS):
        for of_bend in WIDTHS if np.any(bend) else WIDTHS[-1:]:
            width = np.where(meshes(fit.model), of_mesh, np.where(bend, of_bend, 1.0))
            prior = waves / np.outer(width, width)
            covariance = np.linalg.inv(seen + prior)
            # At the end of the fit the samples pull by u, against its prior.
            step = covariance @ (u / scale - prior @ u)
            cost = 0.5 * step @ seen @ step - u @ step / scale + 0.5 * (u + step) @ prior @ (u + step)
            moved.append(step)
            covariances.append(covariance / scale)
            weights.append(0.5 * np.linalg.slogdet(covariance)[1] + 0.5 * np.linalg.slogdet(prior)[1] - cost)
    share = np.exp(np.array(weights) - max(weights))
    return Weighed(share / np.sum(share), np.stack(moved), np.stack(covariances))


def priors_of_waves(model: Model) -> list[FloatArray]:
    """Inverse priors (P, P) of all shared coordinates, one for each kind of waves: all axes run on one kind of rack."""
    names = [p.name for p in model.parameters]
    mesh = next((e for e in model.effects if isinstance(e, MeshError)), None)
    out = [np.eye(len(names))] if mesh is None else []
    for kind in () if mesh is None else of_waves(mesh.length):
        prior = np.eye(len(names))
        for axis in model.axes:
            those = [names.index(f"{axis}.{p.name}") for p in MeshError.own]
            prior[np.ix_(those, those)] = np.linalg.inv(kind)
        out.append(prior)
    return out


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
    share = weighed(fit, misfit).share.reshape(len(priors_of_waves(fit.model)), len(WIDTHS), -1)
    return WIDTHS[int(np.argmax(np.sum(share, axis=(0, 2))))]


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
    return with_less(measured, best, 0.0, WIDTHS[0], motors)


def by_and_by(measured: Measured, best: Outcome, motors: Reconstruction) -> list[Outcome]:
    """The same with a part of the impurities kept at first: what else they had bent follows them back."""
    less = with_less(measured, best, PART, PART, motors)
    return without_impurities(measured, lowest(less), motors)


def with_less(
    measured: Measured, best: Outcome, kept: float, width: float, motors: Reconstruction
) -> list[Outcome]:
    """Passes from the best fit on, with a share `kept` of its impurities, under a prior of another width."""
    model, at = best.problem.model, best.fit.point
    shared = np.where(meshes(model) | bends(model), kept * at.shared, at.shared)
    return passes(measured, *of_width(best.problem, Point(shared, at.local), width), PASSES, motors)
