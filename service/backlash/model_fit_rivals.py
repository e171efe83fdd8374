"""What other minima of a fit say of the backlash, weighed by their likelihood.

How a drive's softness and mass are shared out shows in little but the onset of the contact, and sharings that explain a
recording alike may differ in the backlash by more than the standard error of any of them. None of them is the right
one then: the value is their mean, and what they differ by belongs to its interval.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from service.backlash.model_fit_stages import Staged, backlashes


class Rivals(NamedTuple):
    """By how much the mean of all minima is off the best one [m], and their variance around it [m²]."""

    shift: float
    variance: float


def weighed(staged: Staged, x: int) -> Rivals:
    """The best fit and its rivals for axis x. Residuals are taken as large as they are: with a misfit above 1 the
    likelihood is that much flatter."""
    ends = (staged.best, *staged.rivals)
    costs = np.array([end.fit.cost for end in ends]) / max(1.0, staged.best.fit.misfit)
    weights = np.exp(costs.min() - costs)
    weights /= weights.sum()
    b = np.array([backlashes(end.problem, end.fit)[x] for end in ends])
    mean = float(weights @ b)
    return Rivals(mean - float(b[0]), float(weights @ (b - mean) ** 2))
