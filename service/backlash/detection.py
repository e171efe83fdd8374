"""When the flanks part and when they meet: t1 and t2 of eqs. (11) and (12), and how well they are known.

While the gap is passed the load runs ahead of the braking motor. The forward difference d = ẍ̄_mot − ẍ_mas
falls below zero from t1 on, and jumps above it when the flanks meet: the motor is pushed on, the load held
back. The inequalities are printed "for all t > t1" and "for all t > t2", which can only mean up to the next
event; here t1 and t2 are followed backwards from the lowest and the highest d around the blow. The blow is the
first large rise of d: later ones are the rebound, and the corner of the jerk at three quarters of the move, which
rings the drive.

gamma_t1 is chosen by hand in the paper. Here it is a multiple of what d does at standstill: from then on
something other than noise drives motor and load apart. d falls about as the jerk, so that t1 is late by about
gamma_t1/j_lim, some 0.5 ms, and b is low by 3(dt/T)², of second order.

Symbols
-------
d : ẍ̄_mot − ẍ_mas, forward [m/s²]
t1, t2 : the flanks part, the flanks meet [s]
gamma_t1, gamma_t2 : thresholds of d [m/s²], gamma_t1 counted downwards
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from service.backlash.results import Reason, Refusal
from service.backlash.signals import StepSignals
from service.recording import FloatArray

IntArray = NDArray[np.int64]

SEARCH = (0.35, 0.95)
"""Where in the move the pass is looked for, share of its duration. Chosen: before a third the axis rings from
the gap at the start of the move; flanks that meet after 0.95 meet because the motor has stopped."""

FIRST_RISE = 0.5
"""Rise of d from below to above zero, over the largest one, that is taken for the blow. Chosen: ringing after
an impact can be as high as the blow itself, but no rise before it is half as high."""

GAMMA_T1_NOISE = 4.0
"""gamma_t1 over the noise of d at standstill: passed by chance once in 16,000 samples."""

GAMMA_T1_SAMPLE = 0.1
"""Least gamma_t1, over what d falls in one sampling time at j_lim: a tenth of a sample, the best a crossing between
samples can mean; it counts where there is no noise."""

GAMMA_T2_SHARE = 0.5
"""gamma_t2 over the largest d: eq. (12)."""

LOUDEST = 0.3
"""gamma_t1 over the lowest d, at most. Chosen: b is then low by 3·0.3², a quarter; more is no detection."""

SHALLOWEST = 0.1
"""Lowest d over what the jerk alone would make of it, j_lim·(t2 − t1), at least. Chosen: friction of the guide
and the pull of a gantry's partner leave a quarter, flanks that stay in touch hardly anything."""

WEAKEST = 0.4
"""Highest d over the lowest, at least. Chosen: an impact gives about one and more; a load that was left to its
friction until the motor stood gives friction over a_max."""

LATEST = 0.77
"""Share of the move by which the flanks must have met. From three quarters on the motor brakes less and less, so
that d rises by itself and no threshold tells a blow from it; a little later for the lag of the controller."""

FEWEST_PERIODS = 2.0
"""Sampling periods of the slower channel in a pass, at least: section III asks for much more than one."""


@dataclass(frozen=True)
class Pass:
    """One pass of the gap, times [s] on the recording's clock.

    Attributes
    ----------
    t1, t2 : by the thresholds
    t1_range : d changes its sign, or as long before t1 as it takes to half way down, where a scale error of the
        sensor keeps d off zero; d is half way down: the flanks part no earlier and, if a partner's pull and
        not the release began the fall, hardly later
    t2_range : d changes its sign (the relative speed is largest), d is highest: the flanks meet in between
    """

    t1: float
    t2: float
    t1_range: tuple[float, float]
    t2_range: tuple[float, float]


def standstill_noise(signals: StepSignals) -> float:
    """Standard deviation of d before the move [m/s²], robust (MAD)."""
    d = signals.difference[signals.time < signals.move.start]
    return 1.4826 * float(np.median(np.abs(d - np.median(d))))


def run_noise(steps: Sequence[StepSignals]) -> float:
    """Standard deviation of d at standstill [m/s²] of the whole run: the median over its steps."""
    return float(np.median([standstill_noise(signals) for signals in steps])) if steps else 0.0


def find_pass(signals: StepSignals, noise: float) -> Pass | Refusal:
    """The pass of the gap in one step, or why there is none to be seen; noise of d at standstill [m/s²]."""
    d = signals.difference
    bottom, top = _blow(d, np.flatnonzero(signals.within(*SEARCH)))
    gamma_t1 = max(GAMMA_T1_NOISE * noise, GAMMA_T1_SAMPLE * signals.move.jerk * signals.speed.period)
    refusal = _events(d[bottom], d[top], gamma_t1)
    if refusal:
        return refusal
    found = _pass(signals.time, d, bottom, top, gamma_t1)
    return _shape(signals, found, float(d[bottom])) or found


def _blow(d: FloatArray, inside: IntArray) -> tuple[int, int]:
    """Samples of the lowest d before, and of the highest d after the first large rise through zero.

    Without a rise both are the lowest: that step shows no blow.
    """
    runs = np.split(inside, np.flatnonzero(np.diff(d[inside] > 0.0)) + 1)
    rises = [
        (int(below[np.argmin(d[below])]), int(above[np.argmax(d[above])]))
        for below, above in pairwise(runs)
        if d[above[0]] > 0.0
    ]
    if not rises:
        lowest = int(inside[np.argmin(d[inside])])
        return lowest, lowest
    largest = max(d[top] - d[bottom] for bottom, top in rises)
    return next(rise for rise in rises if d[rise[1]] - d[rise[0]] >= FIRST_RISE * largest)


def _pass(time: FloatArray, d: FloatArray, bottom: int, top: int, gamma_t1: float) -> Pass:
    def falls(level: float) -> float:
        return _crossing(time, d, np.flatnonzero(d[:bottom] >= level), level)

    def rises(level: float) -> float:
        return _crossing(time, d, np.flatnonzero(d[:top] <= level), level)

    t1, half_way = falls(-gamma_t1), falls(0.5 * d[bottom])
    return Pass(
        t1=t1,
        t2=rises(GAMMA_T2_SHARE * d[top]),
        t1_range=(max(falls(0.0), t1 - abs(half_way - t1)), half_way),
        t2_range=(rises(0.0), float(time[top])),
    )


def _crossing(time: FloatArray, d: FloatArray, before: IntArray, level: float) -> float:
    """Time at which d crosses `level` after the last of the samples `before`, by a straight line."""
    k = int(before[-1]) if len(before) else 0
    share = (level - d[k]) / (d[k + 1] - d[k]) if d[k + 1] != d[k] else 0.0
    return float(time[k] + min(max(share, 0.0), 1.0) * (time[k + 1] - time[k]))


def _events(lowest: float, highest: float, gamma_t1: float) -> Refusal | None:
    """Refuse a step whose d does not fall clearly and jump clearly."""
    seen = f"The difference of motor and load acceleration falls to {lowest:.2f} m/s²"
    if lowest > -gamma_t1:
        return Refusal(
            Reason.NO_RELEASE,
            f"{seen}, within the noise at standstill ({gamma_t1:.2f}): the flanks did not part; the axis is "
            "clamped, preloaded or free of play, or the sensor sits on the motor's side: check brake and mounting.",
        )
    if gamma_t1 > LOUDEST * -lowest:
        return Refusal(
            Reason.NO_RELEASE,
            f"{seen}, but moves by {gamma_t1:.2f} at standstill already: the release cannot be told from a machine "
            "that swings, or from a loose sensor; lengthen the pause between the steps, check the sensor's screws.",
        )
    if highest < WEAKEST * -lowest:
        return Refusal(
            Reason.NO_RECONTACT,
            f"{seen} and rises to {highest:.2f} only: the flanks parted and did not meet again with a blow; the "
            "step is too short or too gentle for this gap: choose a longer step or a larger jerk.",
        )
    return None


def _shape(signals: StepSignals, found: Pass, lowest: float) -> Refusal | None:
    """Refuse a fall and jump that the pass of a gap does not look like."""
    lasting = found.t2 - found.t1
    period = max(signals.speed.period, signals.acceleration.period)
    if lasting < FEWEST_PERIODS * period:
        return Refusal(
            Reason.GAP_TOO_SHORT,
            f"The pass lasts {lasting * 1e3:.1f} ms, a sample {period * 1e3:.1f} ms: the gap is too small for this "
            "sampling, or the flanks did not part; sample faster, or step with a smaller jerk.",
        )
    share = (found.t2 - signals.move.start) / signals.move.duration
    if share > LATEST:
        return Refusal(
            Reason.EXCITATION,
            f"The flanks meet after {share:.0%} of the move only, when the motor brakes no longer: the step is too "
            "short or too gentle for this gap; choose a longer step or a larger jerk.",
        )
    if -lowest < SHALLOWEST * signals.move.jerk * lasting:
        return Refusal(
            Reason.GAP_NOT_CROSSED,
            f"Motor and load drift apart by {-lowest:.2f} m/s² in {lasting * 1e3:.1f} ms, far less than the braking "
            "motor alone would: the flanks stay in touch, or the load is dragged along; check brake and guides.",
        )
    return None
