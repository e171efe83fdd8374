"""A single axis' backlash by its whole moves, where the middle of the steps does not tell enough.

The stages before compare the part of each step in which the paper's model holds whatever the axis did before. How the
load sets off and how it stops says more of the same stiffness, masses, damping and friction, and so of a backlash that
noise keeps from being known. It is not asked first: where in its gap the pinion rested is then unknown in every move,
friction turns over, and a fit that begins at another machine ends in another swing. So it begins where the other one
ended. Residuals are whitened by what the noise of the speed makes of them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from service.backlash.interval import half_width_95
from service.backlash.model_fit_impurity_sizes import by_evidence
from service.backlash.model_fit_interval import Linearised, from_slopes, noise_variance, structure_variance
from service.backlash.model_fit_problem import Point
from service.backlash.model_fit_stages import HOPELESS, Outcome
from service.backlash.moves import TAIL, moves_of
from service.backlash.moves_begun import point_at, with_expected_errors
from service.backlash.moves_fit import Fitted, fit
from service.backlash.moves_refined import reconstructed
from service.recording import FloatArray, Recording

UNSURE = (2e-7, 0.0035)
"""Half width [m], or share of the backlash, by noise alone from which on the whole moves are fitted: two thirds of the
accuracy that is asked of a single axis."""

ONLY_NOISE = 1.25
"""Misfit of the middle of the steps up to which noise is what keeps the backlash unsure (chosen): beyond it the machine
is, or how its motor moves between the samples, and whole moves do not mend that."""

SETTLING, ROUNDS = (4, 3), 8
"""Rounds in which every move's zeros are found before and after its motor's motion is reconstructed, and of the fit."""

NEAR = 2.0
"""Misfit of whole moves from which on they say nothing: how the axis sets off or stops is not the model's."""


@dataclass(frozen=True)
class Estimate:
    """A backlash and half the width of its 95 % interval [m]."""

    value: float
    half: float


def unsure(fit: Linearised, misfit: float, k: int) -> bool:
    """Whether noise alone leaves parameter k, a backlash, as unsure as is worth a fit of whole moves."""
    if misfit > ONLY_NOISE:
        return False
    by_size, spread = by_evidence(fit, misfit)
    half = 1.96 * abs(by_size.slope(k)) * float(np.sqrt(by_size.covariance[k, k] + spread[k, k]))
    least, share = UNSURE
    return half > max(least, share * float(fit.model.parameters[k].value(fit.at.shared[k])))


def whole_moves(recording: Recording, best: Outcome) -> Fitted | None:
    """The model of a fit, with its impurities, fitted to whole moves from there on; None where it does not come near
    them."""
    model, held = replace(best.problem.model, friction="whole_move"), np.zeros(0, dtype=np.int64)
    values = {p.name: best.fit.value(best.problem.model, p.name) for p in best.problem.model.parameters}
    moves = [moves_of(recording, model.axes, TAIL)]
    found = fit(moves, model, point_at(model, values, moves), SETTLING[0], free=held)
    found = fit(reconstructed(found, follow=False), model, found.at, SETTLING[1], free=held)
    if not found.rms**2 < HOPELESS:
        return None
    white = [replace(with_expected_errors(part, found, fitted=True), white=True) for part in found.moves]
    found = fit(white, model, found.at, ROUNDS)
    return found if found.rms**2 < NEAR else None


def linearised_moves(found: Fitted) -> Linearised:
    """A fit of the moves of one recording, linearised at its end."""
    grids, local, slopes = found.moves[0].grids, found.at.local[0][:, None], found.slopes
    return from_slopes(found.model, grids, Point(found.at.shared, local), found.r, slopes.shared, slopes.own)


def estimate(found: Fitted, degrees: int) -> Estimate:
    """What a fit of the moves of one recording says of the backlash; `degrees` of freedom of its error."""
    k = [p.name for p in found.model.parameters].index(f"{found.model.axes[0]}.backlash")
    misfit = found.rms**2
    linear, spread = by_evidence(linearised_moves(found), misfit)
    value = float(found.model.parameters[k].value(linear.at.shared[k]))
    variance = float(spread[k, k]) * linear.slope(k) ** 2
    variance += noise_variance(linear, k) + structure_variance(linear, k, misfit)
    return Estimate(value, half_width_95(float(np.sqrt(variance)), degrees, [], value))


def together(one: Estimate, other: Estimate) -> Estimate:
    """Two estimates from one recording as one, by their variances. They share most of their errors, so their half
    widths do not shrink by being two; what they differ by belongs to the interval."""
    each: FloatArray = np.array([[e.value, e.half] for e in (one, other)])
    share = each[:, 1] ** -2.0 / np.sum(each[:, 1] ** -2.0)
    value, half = share @ each
    apart = 1.96 * np.sqrt(share @ (each[:, 0] - value) ** 2)
    return Estimate(float(value), float(np.hypot(half, apart)))
