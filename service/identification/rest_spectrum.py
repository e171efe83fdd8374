"""What the accelerometer hears between the moves: the axis stands there, and what it excited swings on freely, at its
own frequency and whatever the model of the axis is."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from service.backlash.rest_noise import noise_at_rest
from service.recording import FloatArray, Recording, Trace

AFTER, BEFORE = 0.03, 0.005
"""Time left out after a move, in which the axis comes to rest, and before the next one [s]."""
LENGTH = 1 << 16
"""Length to which the samples of a rest are padded: lines are found between those of its own length."""
SHORTEST = 2.0
"""Periods that a rest must hold."""
HIGHEST = 250.0
"""Frequency up to which parts of a machine swing by themselves [Hz]."""
PERIODS = 1.5
"""Last ones before a move in which a swing is looked for: it decays, and another one is not told from it in less
(chosen)."""
HEARD = 20.0
"""Power of a line over that of the sensor's noise from which on it is none (chosen): of some hundred lines of noise,
the mean of ten rests, the strongest has about twice as much, and where the axis is still coming to rest, ten times."""


def heard_at_rest(recording: Recording, axes: Sequence[str]) -> float | None:
    """Frequency [Hz] of the strongest line in the accelerations between the moves; None where there is only noise."""
    heard = [line_of(recording.traces[axis, "acceleration"], recording) for axis in axes]
    strength, frequency = max(heard)
    return frequency if strength > HEARD else None


def swings_before(
    recording: Recording, axes: Sequence[str], frequency: float, starts: FloatArray
) -> FloatArray:
    """Displacement [m] and speed [m/s], (T, 2), at the times `starts` (T,) of what swings so fast [Hz] under all `axes`
    while they rest before a move, by least squares in the last of its periods; 0 where there was no rest of one."""
    omega, out = 2.0 * np.pi * frequency, np.zeros((len(starts), 2))
    traces = [recording.traces[axis, "acceleration"] for axis in axes]
    begin = max(float(trace.time[0]) for trace in traces)
    ends = np.array([move.end + AFTER for move in recording.moves])
    for t, start in enumerate(starts):
        last = float(start) - BEFORE
        first = max([begin, last - PERIODS / frequency, *ends[ends < start]])
        if (last - first) * frequency < 1.0:
            continue
        found = []
        for trace in traces:
            rest = trace.between(first, last)
            phase = omega * (rest.time - float(start))
            waves = np.column_stack((np.cos(phase), np.sin(phase), np.ones_like(phase)))
            found.append(np.linalg.lstsq(waves, rest.value, rcond=None)[0])
        even, odd, _ = np.mean(found, axis=0)
        out[t] = -even / omega**2, -odd / omega
    return out


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
