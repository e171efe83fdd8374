"""The noise of a channel's samples, from the rests before the moves."""

from __future__ import annotations

import numpy as np
from scipy.stats import norm

from service.recording import Recording, Trace

SMALLEST_DIGIT = 0.29
"""Standard deviation of rounding, in digits: 1/√12."""


def noise_at_rest(trace: Trace, recording: Recording) -> float:
    """Standard deviation of one sample at rest, in the trace's unit, from the median size of fourth differences, in
    which neither a swing of the machine nor a few impacts count; the median over the rests, so that one disturbed rest
    does not."""
    spreads = []
    for move in recording.moves:
        part = trace.between(move.start - 0.15, move.start - 0.002).value
        if len(part) > 30:
            fourth = np.diff(part, n=4) / np.sqrt(70.0)
            typical = float(np.median(np.abs(fourth))) / norm.ppf(0.75)
            spreads.append(typical or float(np.sqrt(np.mean(fourth**2))))
    return float(np.median(spreads))


def sample_noise(trace: Trace, recording: Recording) -> float:
    """Standard deviation of one sample of a drive's channel, in its unit; at least that of its rounding."""
    steps = np.diff(np.unique(trace.value))
    digit = float(steps.min()) if len(steps) else 0.0
    return max(noise_at_rest(trace, recording), SMALLEST_DIGIT * digit)
