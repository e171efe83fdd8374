"""Distance that motor and load have parted between t1 and t2: eq. (10)."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline

from service.backlash.signals import StepSignals, running_integral

POINTS = 400
"""Of the integration between t1 and t2: 50 µs in the longest pass of 20 ms, far below any sampling time."""


def parted(signals: StepSignals, t1: float, t2: float) -> float:
    """b [m] by eq. (10), the load's speed at t1 [s] being the motor's.

    b = |x̄_mot(t2) − x̄_mot(t1) − ∬ ẍ_mas dt²|. In forward signals the load runs ahead of the braking motor,
    the bracket is negative (LL in the paper's words), and b is what the load has gained on the motor. The paper's
    double integral leaves out the load's speed at t1; it is the motor's, because the flanks touched until then.

    Parameters
    ----------
    signals : low-passed (`for_integration`); between their samples cubic splines are read
    """
    t = np.linspace(t1, t2, POINTS)
    period = float(t[1] - t[0])
    v_mot = CubicSpline(signals.speed.time, signals.speed.value)(t)
    a_mas = CubicSpline(signals.acceleration.time, signals.acceleration.value)(t)
    v_mas = v_mot[0] + running_integral(a_mas, period)
    return float(running_integral(v_mas - v_mot, period)[-1])
