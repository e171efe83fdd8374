"""When the flanks part and when they meet: t1 and t2 of eqs. (11) and (12), with what is known of their error.

In the paper's figures the load is ahead of the motor while the gap is passed, so the forward difference
d = ẍ̄_mot − ẍ_mas falls below zero from t1 on, and jumps above it when the flanks meet: the motor is pushed on,
the load held back. The inequalities are printed for "all t > t1" and "all t > t2"; they hold until the next
event, which is what is searched for here: from the highest d backwards.

Symbols
-------
t0 : the nominal acceleration changes its sign, the middle of the move
t1, t2 : the flanks part, the flanks meet
gamma_t1, gamma_t2 : thresholds of d [m/s²]
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from service.backlash.signals import StepSignals
from service.recording import FloatArray

SEARCH = (0.35, 0.95)
"""Where in the move the pass is looked for, share of its duration. Before a third the axis still rings from the
gap at the start of the move (section III); a gap that is met after 0.95 is met by the end of the braking."""

GAMMA_T1_NOISE = 4.0
"""gamma_t1 over the noise of d at standstill: passed by chance once in 16,000 samples."""

GAMMA_T2_SHARE = 0.5
"""gamma_t2 over the largest d: eq. (12)."""

NOISE_SHARE = 0.3
"""gamma_t1 may be at most this share of the lowest d. Chosen: more, and the release is found so late that the
load's speed at t1 differs from the motor's by a tenth of their difference at t2 (0.3² of it)."""


@dataclass(frozen=True)
class Pass:
    """One pass of the gap [s on the recording's clock].

    Attributes
    ----------
    t1, t2 : by the thresholds
    t1_range, t2_range : no earlier, no later than this: t1 between the change of sign of d and half of its
        way down, t2 between its change of sign (the relative speed is greatest) and its peak
    lowest, highest : d before and after the impact [m/s²]
    """

    t1: float
    t2: float
    t1_range: tuple[float, float]
    t2_range: tuple[float, float]
    lowest: float
    highest: float


def standstill_noise(signals: StepSignals) -> float:
    """Standard deviation of d before the move [m/s²], robust (MAD)."""
    d = signals.difference[signals.time < signals.move.start]
    return 1.4826 * float(np.median(np.abs(d - np.median(d))))


def find_pass(signals: StepSignals, gamma_t1: float) -> Pass | None:
    """The pass of the gap in one step, None when d shows no descent and jump.

    Parameters
    ----------
    gamma_t1 : > 0, how far d must fall [m/s²]; the paper's eq. (11) carries the sign in the threshold
    """
    time, d, move = signals.time, signals.difference, signals.move
    inside = np.flatnonzero(
        (time > move.start + SEARCH[0] * move.duration) & (time < move.start + SEARCH[1] * move.duration)
    )
    if len(inside) < 5:
        return None
    top = int(inside[np.argmax(d[inside])])
    earlier = inside[inside < top]
    if len(earlier) < 3:
        return None
    bottom = int(earlier[np.argmin(d[earlier])])
    if not d[bottom] < -gamma_t1 < 0 < d[top]:
        return None
    return Pass(
        t1=_falls_through(time, d, bottom, -gamma_t1),
        t2=_rises_through(time, d, top, GAMMA_T2_SHARE * d[top]),
        t1_range=(_falls_through(time, d, bottom, 0.0), _falls_through(time, d, bottom, 0.5 * d[bottom])),
        t2_range=(_rises_through(time, d, top, 0.0), float(time[top])),
        lowest=float(d[bottom]),
        highest=float(d[top]),
    )


def _falls_through(time: FloatArray, d: FloatArray, bottom: int, level: float) -> float:
    """Last time before sample `bottom` at which d falls through `level`, between samples by a straight line."""
    above = np.flatnonzero(d[:bottom] >= level)
    k = int(above[-1]) if len(above) else 0
    return _crossing(time, d, k, level)


def _rises_through(time: FloatArray, d: FloatArray, top: int, level: float) -> float:
    """Last time before sample `top` at which d rises through `level`, between samples by a straight line."""
    below = np.flatnonzero(d[:top] <= level)
    k = int(below[-1]) if len(below) else 0
    return _crossing(time, d, k, level)


def _crossing(time: FloatArray, d: FloatArray, k: int, level: float) -> float:
    share = (level - d[k]) / (d[k + 1] - d[k])
    return float(time[k] + np.clip(share, 0.0, 1.0) * (time[k + 1] - time[k]))
