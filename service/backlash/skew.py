"""What the phases in which the flanks touch tell: how late the accelerometer's clock is, how soft the drive.

In contact the load follows the motor up to the wind-up of the drive, so that the distance between them is

    D(t) = x̄_mot − x_mas = D_0 + v_0·t + τ·v̄_mot + c·ẍ_mas + e·d³x_mas/dt³

with a D_0 and v_0 for each phase and τ, c, e common to all: a stamp that is late by τ moves the load's
position by v·τ, and the drive is wound up by c = M/k times the acceleration. One linear least-squares solve.

- τ: an error of t2 is of first order, db/b = 3 dt/T, half a millisecond is several percent; so the skew is taken
  out of the stamps before anything is compared.
- c: the drive unwinds while the acceleration falls, so that at t1 the load is faster than the motor by c·j_lim,
  which eq. (10) leaves out. The paper's value stays as it is; its interval knows.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from service.backlash.detection import Pass
from service.backlash.signals import BoolArray, StepSignals, derivative, running_integral
from service.recording import FloatArray

CONTACT = (0.30, 0.94)
"""Share of the move's duration between which the flanks touch, but for the pass. Chosen: before, the axis
rings from the gap at the start; after, the controller settles."""

CLEAR = 0.003
"""Time left out before t1 and after t2 [s]. Chosen: both are smeared by the Savitzky-Golay filter."""

DERIVATIVE_WIDTH = 5
"""Samples of the filter for d³x_mas/dt³, a nuisance term whose noise does not matter. Chosen."""

FEWEST_SAMPLES = 8
"""Samples of a phase that is used: its line and three regressors leave three to say something. Chosen."""

SMALLEST, SMALLEST_GANTRY = 0.3e-3, 1e-3
"""Skew that is left alone [s], of a single axis and of one of a gantry. Chosen: what the solve makes of machines
without any, see test_skew; the pull of the partner, of which the law above knows nothing, imitates more."""


class Contact(NamedTuple):
    """τ [s] by which the accelerometer's stamps are late, 0 where too small to be told; c = M/k [s²], ≥ 0."""

    tau: float
    c: float


def contact(steps: Sequence[tuple[StepSignals, Pass]], smallest: float) -> Contact:
    """Skew and softness of a whole run, from its steps and their passes; both 0 when no phase is long enough.

    A skew below `smallest` [s] cannot be told and counts as none.
    """
    parts = [part for signals, found in steps for part in _phases(signals, found)]
    if not parts:
        return Contact(0.0, 0.0)
    X, D = (np.concatenate([part[k] for part in parts]) for k in (0, 1))
    tau, c, _ = np.linalg.lstsq(X, D, rcond=None)[0]
    return Contact(float(tau) if abs(tau) > smallest else 0.0, max(float(c), 0.0))


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
