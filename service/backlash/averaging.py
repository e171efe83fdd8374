"""Ten steps make one experiment: their mean, its 95 % interval, and whether they agree (section V)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

FEWEST_STEPS = 3
"""Sound steps that one experiment needs. Chosen: below three, the scatter of the steps cannot be told."""

OUTLIER = 5.0
"""A step so many robust standard deviations from the median is not averaged. Chosen: by chance never."""

LEAST_SPREAD = 0.02
"""Scatter of the steps below which none is called an outlier, as a share of the median. Chosen: the method's own
resolution, a tenth of a 1 kHz sampling time in a pass of 10 ms (db/b = 3 dt/T)."""

LARGEST_SPREAD = 0.3
"""Scatter of the steps, over their mean, beyond which they do not measure one quantity. Chosen: half again the
20 % of section V."""


@dataclass(frozen=True)
class StepValue:
    """b of one step [m] and the bounds that the events' uncertainty leaves it [m]."""

    b: float
    lower: float
    upper: float


@dataclass(frozen=True)
class Average:
    """Mean of the kept steps [m], 95 % interval [m], standard deviation of one step [m], which were kept."""

    b: float
    interval_95: tuple[float, float]
    spread: float
    kept: tuple[bool, ...]


def average(values: Sequence[StepValue]) -> Average:
    """Mean of the steps, and an interval that holds what is random and what is not.

    Random is the scatter of the steps, divided over them (Student's t). The uncertainty of t1 and t2 is the
    same in every step, ten steps do not reduce it: the bounds are averaged and the random part is put outside them.

    Parameters
    ----------
    values : at least two steps
    """
    b = np.array([value.b for value in values])
    kept = _agreeing(b)
    inside = b[kept]
    n = len(inside)
    spread = float(np.std(inside, ddof=1)) if n > 1 else float("inf")
    random = float(stats.t.ppf(0.975, max(n - 1, 1))) * spread / np.sqrt(n)
    lower = float(np.mean(np.array([value.lower for value in values])[kept])) - random
    upper = float(np.mean(np.array([value.upper for value in values])[kept])) + random
    return Average(float(np.mean(inside)), (lower, upper), spread, tuple(bool(k) for k in kept))


def _agreeing(b: np.ndarray) -> np.ndarray:
    middle = np.median(b)
    spread = max(1.4826 * np.median(np.abs(b - middle)), LEAST_SPREAD * abs(middle))
    return np.asarray(np.abs(b - middle) <= OUTLIER * spread)
