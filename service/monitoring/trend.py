"""The trend of an axis' backlash: a running median with an interval, and a robust slope.

Chosen, and why:

* The level is the **median of the last W = 9 accepted values**. A mean would follow one wild value; the
  median of nine stays where it is until five values agree. By value and not by calendar day: after a repair
  five checks in a row bring the level home, which five nights of waiting would not do better.
* The interval is taken from the order statistics: between the k-th smallest and the k-th largest of n
  independent values lies the median of their distribution with probability 1 - 2 P(Bin(n, 1/2) < k), whatever
  that distribution is (David and Nagaraja, Order Statistics, 3rd ed., sec. 7.1). The largest k that keeps 95
  % is used: k = 2 for n = 9 (96.1 %), so that one wild value does not widen the interval either. Below six
  values no such interval reaches 95 % and none is given.
* Values that depend on one another (a warm and a cold machine) make that interval too narrow; the alarm
  therefore does not rest on it, but on the tolerance band and on delays (see ``alarm``).
* The slope is Theil-Sen's, the median of the slopes of all pairs, over the last 60 values.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binom, theilslopes

Array = NDArray[np.float64]

WINDOW = 9
SLOPE_VALUES = 60
SLOPE_SPAN = 7 * 86_400.0
"""Shortest span of time [s] over which a slope is stated; chosen: over less, noise is steeper than wear."""


@dataclass(frozen=True)
class Trend:
    """Where the backlash stands.

    ``level`` [m], its 95 % ``interval`` [m] (None below six values), ``slope`` [m/s] and its 95 %
    ``slope_interval`` [m/s] (None below nine values or a week), ``count`` of the values under the level.
    """

    level: float
    interval: tuple[float, float] | None
    slope: float | None
    slope_interval: tuple[float, float] | None
    count: int


def median_rank(n: int, confidence: float = 0.95) -> int | None:
    """Rank k such that [k-th smallest, k-th largest] of n values covers the median; None if no rank does.

    Parameters
    ----------
    n : int
        Number of independent values.
    confidence : float
        Probability with which the interval holds the median.
    """
    ranks = np.arange(1, n // 2 + 1)
    coverage = 1.0 - 2.0 * binom.cdf(ranks - 1, n, 0.5)
    good = ranks[coverage >= confidence]
    return int(good[-1]) if good.size else None


def median_interval(b: Array, confidence: float = 0.95) -> tuple[float, float] | None:
    """Distribution-free interval [m] of the median of ``b`` [m] (n,); None where n is too small for it."""
    k = median_rank(b.size, confidence)
    if k is None:
        return None
    ordered = np.sort(b)
    return float(ordered[k - 1]), float(ordered[-k])


def levels(b: Array, window: int = WINDOW) -> Array:
    """Running median: entry i is the median of the ``window`` values up to and including b[i].

    Parameters
    ----------
    b : (n,) array
        Accepted values, oldest first [m].
    window : int
        Number of values under one level; the first entries have fewer.

    Returns
    -------
    (n,) array
        The level after each value [m].
    """
    short = [float(np.median(b[: i + 1])) for i in range(min(window - 1, b.size))]
    if b.size < window:
        return np.asarray(short, dtype=np.float64)
    full = np.median(np.lib.stride_tricks.sliding_window_view(b, window), axis=-1)
    return np.concatenate([np.asarray(short, dtype=np.float64), full])


def trend(t: Array, b: Array, window: int = WINDOW) -> Trend | None:
    """Level, interval and slope of a history; None for an empty one.

    Parameters
    ----------
    t : (n,) array
        Times of the accepted values, ascending [s].
    b : (n,) array
        Accepted values of one method and one series [m].
    window : int
        Number of values under the level.
    """
    if t.shape != b.shape or t.ndim != 1:
        raise ValueError(f"a history needs one time per value, got shapes {t.shape} and {b.shape}")
    if not (np.isfinite(t).all() and np.isfinite(b).all()):
        raise ValueError("a history holds accepted values only, got one that is not finite")
    if b.size == 0:
        return None
    recent = b[-window:]
    slope, slope_interval = _slope(t[-SLOPE_VALUES:], b[-SLOPE_VALUES:], window)
    return Trend(float(np.median(recent)), median_interval(recent), slope, slope_interval, int(recent.size))


def _slope(t: Array, b: Array, window: int) -> tuple[float | None, tuple[float, float] | None]:
    if b.size < window or t[-1] - t[0] < SLOPE_SPAN:
        return None, None
    fit = theilslopes(b, t, 0.95)
    return float(fit.slope), (float(fit.low_slope), float(fit.high_slope))
