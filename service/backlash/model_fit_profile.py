"""Where the backlash lies with everything else following: value and interval where the fit is no parabola.

The standard error takes the fit for linear. A flank that is only just reached is not: a gap that is a little wider
is not reached at all, and from there on the recording hardly says anything. So values beside the fit's are held and
all else fitted again, outwards until they are out of the question. Where what is left sticks out of the interval, the
interval is widened to hold it, and the value is its middle: the likeliest value may lie at one end.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

EXCLUDED = 6.0
"""Fall of the logarithm of the likelihood from which on a value is out of the question: 3.5 standard deviations."""

FARTHER, OUTERMOST = (2.0, 8.0), 16.0
"""How many times as far the next value is held, and the last one over the first: each costs a fit. Of a parabola the
next one is out of the question; what hardly rises is followed by large strides."""

SMALLEST = 0.1
"""Share of the value below which none is held: a gap has a width."""

TAIL = 0.025

POINTS = 2000
"""Of the density between the outermost values."""


def widened(rise: Callable[[float], float], value: float, half: float, misfit: float) -> tuple[float, float]:
    """Value and half width [m] of a backlash whose interval is `half` [m] wide to either side where the fit is a
    parabola; `rise` says how much more a value [m] costs, its residuals being as large as the misfit says."""
    fall = {0.0: 0.0} | fallen(rise, value, -half, misfit) | fallen(rise, value, half, misfit)
    held = sorted(fall)
    beside = np.linspace(held[0], held[-1], POINTS)
    # Between two held values the root of a parabola is a straight line.
    density = np.exp(-(np.interp(beside, held, np.sqrt([fall[at] for at in held])) ** 2))
    whole = np.cumsum(density) / np.sum(density)
    low = min(-half, float(np.interp(TAIL, whole, beside)))
    high = max(half, float(np.interp(1.0 - TAIL, whole, beside)))
    return value + 0.5 * (low + high), 0.5 * (high - low)


def fallen(rise: Callable[[float], float], value: float, step: float, misfit: float) -> dict[float, float]:
    """How much the logarithm of the likelihood falls, the residuals being as large as they are, at distances [m] from
    the value in the direction of `step` [m]."""
    found: dict[float, float] = {}
    times, last = 1.0, OUTERMOST if step > 0.0 else min(OUTERMOST, (1.0 - SMALLEST) * value / -step)
    while times <= last:
        fall = max(0.0, rise(value + step * times) / max(1.0, misfit))
        found[step * times] = fall
        if fall > EXCLUDED or times == last:
            break
        stride = float(np.clip(np.sqrt(1.5 * EXCLUDED / max(fall, 1e-9)), *FARTHER))
        times = min(times * stride, last)
    return found
