"""What motor and load tell of each other: how late the accelerometer's clock is, how soft the drive.

An error of t2 is of first order in b, db/b = 3 dt/T, half a millisecond is several percent; so a skew between the
two streams is taken out of the stamps before anything is compared.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from service.backlash.detection import Pass
from service.backlash.signals import BoolArray, StepSignals, derivative, running_integral
from service.recording import FloatArray

SMALLEST = 0.3e-3
"""Skew that is left alone [s]. Chosen: what `lag` makes of machines without any, see test_alignment."""

LARGEST = 5e-3
"""Skew beyond which the streams are not two views of one step [s]. Chosen: half a pass."""

SEARCHED, SPACING = 12e-3, 0.5e-3
"""Lags that are tried, up to and by [s]. Chosen: twice the largest that is accepted; a parabola does the rest."""

CONTACT = (0.30, 0.94)
"""Share of the move's duration between which the flanks touch, but for the pass. Chosen: before, the axis
rings from the gap at the start; after, the controller settles."""

CLEAR = 0.003
"""Time left out before t1 and after t2 [s]. Chosen: both are smeared by the Savitzky-Golay filter."""

REBOUND = 0.008
"""Time after t2 in which motor and load speed have not come together again [s]. Chosen: a period of 125 Hz."""

DERIVATIVE_WIDTH = 5
"""Samples of the filter for d³x_mas/dt³, a nuisance term whose noise does not matter. Chosen."""

FEWEST_SAMPLES = 8
"""Samples of a phase that is used: its line and three regressors leave three to say something. Chosen."""


def lag(steps: Sequence[StepSignals], passes: Mapping[int, Pass] | None = None) -> float:
    """Time [s] by which the accelerometer's stamps are late, the median over the steps; 0 without a step.

    It is the lag at which load speed and motor speed agree best. While the gap is passed they do not agree: a first
    value is high by 3T⁴/(32 T_j³), half a millisecond at 120 µm. With the passes known, by index, the time
    from t1 until the rebound has died down is left out.
    """
    known = passes or {}
    return float(np.median([_lag(signals, known.get(signals.index)) for signals in steps])) if steps else 0.0


def _lag(signals: StepSignals, found: Pass | None) -> float:
    """Lag [s] of one step: the lowest sum of squares over the lags, by a parabola through three of them."""
    used = signals.within(0.0, 1.0)
    if found is not None:
        used &= (signals.time < found.t1_range[0] - CLEAR) | (signals.time > found.t2 + REBOUND)
    lags = np.arange(-SEARCHED, SEARCHED + SPACING / 2, SPACING)
    misfit = [_misfit(signals, used, float(late)) for late in lags]
    k = min(max(int(np.argmin(misfit)), 1), len(lags) - 2)
    before, at, after = misfit[k - 1 : k + 2]
    bend = before - 2.0 * at + after
    share = 0.5 * (before - after) / bend if bend > 0.0 else 0.0
    return float(lags[k] + SPACING * min(max(share, -1.0), 1.0))


def _misfit(signals: StepSignals, used: BoolArray, late: float) -> float:
    """Sum of squares of v̄_mot less v_mas, scaled to fit best: a sensor's scale error must not look like a lag."""
    v_mas = np.interp(signals.time[used] + late, signals.acceleration.time, signals.load_speed)
    v_mot = signals.speed.value[used]
    return float(np.sum(v_mot**2) - np.sum(v_mot * v_mas) ** 2 / np.sum(v_mas**2))


def softness(steps: Sequence[tuple[StepSignals, Pass]]) -> float:
    """c = M/k [s²], the wind-up of the drive per acceleration, not below 0; 0 when no phase is long enough.

    In contact the load follows the motor up to this wind-up, so that the distance between them is

        D(t) = x̄_mot − x_mas = D_0 + v_0·t + τ·v̄_mot + c·ẍ_mas + e·d³x_mas/dt³

    with a D_0 and v_0 for each phase, and τ (what is left of the skew), c, e common to all: one least-squares
    solve. While the acceleration falls the drive unwinds, so that at t1 the load is faster than the motor by
    c·j_lim, which eq. (10) leaves out. The paper's value stays as it is; its interval knows.
    """
    parts = [part for signals, found in steps for part in _phases(signals, found)]
    if not parts:
        return 0.0
    X, D = (np.concatenate([part[k] for part in parts]) for k in (0, 1))
    return max(float(np.linalg.lstsq(X, D, rcond=None)[0][1]), 0.0)


def _phases(signals: StepSignals, found: Pass) -> list[tuple[FloatArray, FloatArray]]:
    """Regressors (n, 3) and D (n,) of both contact phases of one step, each phase's own line taken out."""
    v_mot, period = signals.speed.value, signals.speed.period
    D = running_integral(v_mot - signals.v_mas, period)
    X = np.column_stack([v_mot, signals.a_mas, derivative(signals.a_mas, period, DERIVATIVE_WIDTH)])
    inside = signals.within(*CONTACT)
    before = inside & (signals.time < found.t1_range[0] - CLEAR)
    after = inside & (signals.time > found.t2 + CLEAR)
    long = [phase for phase in (before, after) if np.count_nonzero(phase) >= FEWEST_SAMPLES]
    return [_without_line(signals.time, X, D, phase) for phase in long]


def _without_line(
    time: FloatArray, X: FloatArray, D: FloatArray, phase: BoolArray
) -> tuple[FloatArray, FloatArray]:
    t = time[phase] - np.mean(time[phase])
    line = np.linalg.qr(np.column_stack([np.ones(len(t)), t]))[0]
    return X[phase] - line @ (line.T @ X[phase]), D[phase] - line @ (line.T @ D[phase])
