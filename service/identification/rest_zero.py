"""What the accelerometer says of its own zero between the moves: nothing accelerates an axis that stands there, so a
mean that goes its way from rest to rest is the sensor's, whatever the model of the axis is."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from service.backlash.rest_noise import noise_at_rest
from service.identification.rest_spectrum import AFTER, BEFORE
from service.recording import FloatArray, Recording, Trace

SHORTEST = 0.05
"""Time that a rest must hold for its mean [s]."""
FEWEST = 6
"""Rests from which on a course is told from scatter: it has three numbers."""
WANDERS = 0.32
"""Standard deviation of the zero over the noise of a sample from which on it is one of the things that a model may lack
(chosen): it makes 1.05 of an RMS of 1, more than a right model leaves. A zero that keeps still has no course at all."""
SMOOTH = 0.5
"""Scatter of the rests about the zero's course, over its own standard deviation, up to which it is a course: what
swings on in the rests, or moves the axis a little, goes up and down from rest to rest."""


def zero_wanders(recording: Recording, axes: Sequence[str]) -> bool:
    """Whether the zero of one of the axes' accelerometers goes its way while the axis rests."""
    return any(wander(recording.traces[axis, "acceleration"], recording) > WANDERS for axis in axes)


def wander(trace: Trace, recording: Recording) -> float:
    """Standard deviation of the zero's smooth course over that of one sample; 0 where there is none."""
    time, mean, error = means_at_rest(trace, recording)
    if len(time) < FEWEST:
        return 0.0
    course = np.polynomial.Polynomial.fit(time, mean, 2)(time)
    scatter = np.sqrt(np.sum((mean - course) ** 2) / (len(time) - 3))
    spread = float(np.std(course, ddof=1))
    smooth = scatter < SMOOTH * spread and spread > 2.0 * error
    return spread / noise_at_rest(trace, recording) if smooth else 0.0


def means_at_rest(trace: Trace, recording: Recording) -> tuple[FloatArray, FloatArray, float]:
    """Time [s] and mean [m/s²] of every rest, (n,) each, and the standard error of a mean by the samples' noise."""
    begin, time, mean, samples = float(trace.time[0]), [], [], 1
    for move in recording.moves:
        rest = trace.between(begin, move.start - BEFORE)
        if len(rest) > 2 and rest.time[-1] - rest.time[0] > SHORTEST:
            time.append(float(np.mean(rest.time)))
            mean.append(float(np.mean(rest.value)))
            samples = len(rest)
        begin = move.end + AFTER
    return np.array(time), np.array(mean), noise_at_rest(trace, recording) / float(np.sqrt(samples))
