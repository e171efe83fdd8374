"""How well an axis' values repeat, and whether its tolerance can be told from that.

A tolerance below three standard deviations of the values is one that chance leaves: the trend, a median of nine, is
outside now and then though nothing has changed, and no drift can be told from the scatter.
"""

from __future__ import annotations

import numpy as np

from service.monitoring.trend import Array

FEWEST = 6
"""Values below which nothing is said; chosen: the same as for the interval of the trend."""

SIGMAS = 3.0
"""Standard deviations that a tolerance should hold: by chance a normal value is outside once in 370."""

_NORMAL = 1.4826
"""Of a normal distribution, standard deviation over the median of the absolute deviations."""


def repeatability(b: Array) -> float | None:
    """Standard deviation of one value [m] from a history b (n,) [m], oldest first; None where n is too small.

    From the differences of neighbours, whose median wear and a single wild value leave alone; their standard
    deviation is √2 times that of a value.
    """
    if b.size < FEWEST:
        return None
    return float(_NORMAL * np.median(np.abs(np.diff(b))) / np.sqrt(2.0))


def tolerance_hint(tolerance: float | None, sigma: float | None) -> str | None:
    """Say when a tolerance [m] is less than three standard deviations sigma [m]; None where it is not, or unknown."""
    if tolerance is None or sigma is None or tolerance >= SIGMAS * sigma:
        return None
    return (
        f"The tolerance of {tolerance * 1e6:.1f} µm is less than three times the scatter of the values "
        f"({sigma * 1e6:.2f} µm): alarms of chance are to be expected. Look for what makes the values scatter, or set "
        f"tolerance_um to {np.ceil(SIGMAS * sigma * 1e7) / 10:.1f} or more"
    )
