"""95 % intervals: from the scatter of the steps and the spread between rival ways of estimating.

The covariance of one fit alone covers far too rarely (see estimator.md): it knows the noise, but neither a
wrong structure nor an error of its own input. Steps repeat the noise and much of the input's error;
rival structures show what the choice of structure is worth.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from service.recording import FloatArray


def robust_mean(values: FloatArray) -> tuple[float, float, NDArray[np.bool_]]:
    """Mean of the steps without outliers, its standard error, and which steps were kept.

    A step further than 4 robust deviations (MAD) from the median is left out; chosen: for normal scatter
    that drops one step in 16,000.

    Returns
    -------
    mean, standard error [unit of values], kept (n,) bool
    """
    median = float(np.median(values))
    spread = 1.4826 * float(np.median(np.abs(values - median)))
    kept = np.abs(values - median) <= (4.0 * spread if spread > 0.0 else np.inf)
    inside = values[kept]
    error = float(np.std(inside, ddof=1) / np.sqrt(len(inside))) if len(inside) > 1 else float("inf")
    return float(np.mean(inside)), error, kept


def half_width_95(standard_error: float, degrees: int, rivals: Sequence[float], value: float) -> float:
    """Half width of the 95 % interval.

    Parameters
    ----------
    standard_error : of the value by the steps' scatter or the fit's covariance
    degrees : of freedom behind it, for Student's t
    rivals : the same quantity by other structures or windows; their root mean square distance from the
        value is taken as one more standard deviation, a systematic one
    value : what the interval is for
    """
    t = float(stats.t.ppf(0.975, max(degrees, 1)))
    systematic = float(np.sqrt(np.mean((np.asarray(rivals) - value) ** 2))) if len(rivals) else 0.0
    return float(np.hypot(t * standard_error, 1.96 * systematic))
