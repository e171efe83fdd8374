"""What the accelerometer hears between the moves: the axis stands there, and what it excited swings on freely, at its
own frequency and whatever the model of the axis is."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from service.backlash.rest_noise import noise_at_rest
from service.recording import Recording, Trace

AFTER, BEFORE = 0.03, 0.005
"""Time left out after a move, in which the axis comes to rest, and before the next one [s]."""
LENGTH = 1 << 16
"""Length to which the samples of a rest are padded: lines are found between those of its own length."""
SHORTEST = 2.0
"""Periods that a rest must hold."""
HIGHEST = 250.0
"""Frequency up to which parts of a machine swing by themselves [Hz]."""
HEARD = 20.0
"""Power of a line over that of the sensor's noise from which on it is none (chosen): of some hundred lines of noise,
the mean of ten rests, the strongest has about twice as much, and where the axis is still coming to rest, ten times."""


def heard_at_rest(recording: Recording, axes: Sequence[str]) -> float | None:
    """Frequency [Hz] of the strongest line in the accelerations between the moves; None where there is only noise."""
    heard = [line_of(recording.traces[axis, "acceleration"], recording) for axis in axes]
    strength, frequency = max(heard)
    return frequency if strength > HEARD else None


def line_of(trace: Trace, recording: Recording) -> tuple[float, float]:
    """The strongest line of the mean spectrum of all rests: power over that of the sensor's noise, and frequency [Hz].

    The noise is that of the samples: a mass that throws the load from flank to flank is in all lines at once.
    """
    h, power, lowest = float(np.median(np.diff(trace.time))), np.zeros(LENGTH // 2 + 1), 0.0
    noise, samples = noise_at_rest(trace, recording), 0.0
    for move, following in zip(recording.moves, recording.moves[1:], strict=False):
        rest = trace.between(move.end + AFTER, following.start - BEFORE).value
        if len(rest) * h * HIGHEST > SHORTEST:
            line = np.polynomial.Polynomial.fit(np.arange(len(rest)), rest, 1)(np.arange(len(rest)))
            window = np.hanning(len(rest))
            power += np.abs(np.fft.rfft((rest - line) * window, LENGTH)) ** 2
            samples += float(np.sum(window**2))
            lowest = max(lowest, SHORTEST / (len(rest) * h))
    frequency = np.fft.rfftfreq(LENGTH, h)
    within = (frequency > lowest) & (frequency < HIGHEST)
    peak = within[1:-1] & (power[1:-1] > power[:-2]) & (power[1:-1] >= power[2:])
    if not np.any(peak):
        return 0.0, 0.0
    best = 1 + int(np.argmax(power[1:-1] * peak))
    return float(power[best] / max(noise**2 * samples, 1e-300)), float(frequency[best])
