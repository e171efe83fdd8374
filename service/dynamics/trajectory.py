"""The excitation: a jerk-limited step in closed form, seven segments (paper section III, fig. 3).

Symbols of the paper: SL the step length, j_lim, a_lim and v_lim the limits, a_max and v_max the values that
are really reached, t0 the time at which the acceleration changes its sign. All on the output side.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cbrt, isfinite, sqrt

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]

_JERK_SIGNS = np.array([1.0, 0.0, -1.0, 0.0, -1.0, 0.0, 1.0])


@dataclass(frozen=True)
class JerkLimitedStep:
    """A step from rest to rest over ``length`` [m] with piecewise constant jerk ±``jerk`` [m/s³] or 0.

    Attributes
    ----------
    T_j : duration of each of the four segments with jerk [s]
    T_a : duration of each of the two segments with constant acceleration [s], 0 when a_lim is not reached
    T_v : duration of the segment with constant speed [s], 0 when v_lim is not reached
    """

    length: float
    jerk: float
    T_j: float
    T_a: float
    T_v: float

    @property
    def segments(self) -> FloatArray:
        """Durations of the seven segments [s], shape (7,)."""
        return np.array([self.T_j, self.T_a, self.T_j, self.T_v, self.T_j, self.T_a, self.T_j])

    @property
    def duration(self) -> float:
        """Time from rest to rest [s]."""
        return 4 * self.T_j + 2 * self.T_a + self.T_v

    @property
    def a_max(self) -> float:
        """Largest acceleration reached [m/s²]."""
        return self.jerk * self.T_j

    @property
    def v_max(self) -> float:
        """Largest speed reached [m/s]."""
        return self.a_max * (self.T_j + self.T_a)

    @property
    def t0(self) -> float:
        """Time of the acceleration's change of sign [s]: the middle of the step, which is symmetric.

        With a segment of constant speed (``T_v`` > 0) there is no *one* such time, and the step does not
        meet the paper's condition v_max < v_lim.
        """
        return self.duration / 2

    def position(self, t: ArrayLike) -> FloatArray:
        """Position [m] at the times ``t`` [s] after the start, same shape; at rest before and after."""
        return self._evaluate(t)[0]

    def speed(self, t: ArrayLike) -> FloatArray:
        """Speed [m/s] at the times ``t`` [s], same shape."""
        return self._evaluate(t)[1]

    def acceleration(self, t: ArrayLike) -> FloatArray:
        """Acceleration [m/s²] at the times ``t`` [s], same shape."""
        return self._evaluate(t)[2]

    def _evaluate(self, t: ArrayLike) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Position, speed and acceleration: the cubic of the segment that each time falls into."""
        # The second half is the first one run backwards: evaluating it so makes the end exactly SL, at rest.
        time = np.clip(np.asarray(t, dtype=np.float64), 0.0, self.duration)
        late = time > self.t0
        x, v, a = self._first_half(np.where(late, self.duration - time, time))
        return np.where(late, self.length - x, x), v, np.where(late, -a, a)

    def _first_half(self, time: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        starts = np.concatenate([[0.0], np.cumsum(self.segments[:3])])
        jerk = self.jerk * _JERK_SIGNS[:4]
        x, v, a = np.zeros(4), np.zeros(4), np.zeros(4)
        for k, T in enumerate(self.segments[:3]):
            x[k + 1] = x[k] + T * (v[k] + T * (a[k] / 2 + T * jerk[k] / 6))
            v[k + 1] = v[k] + T * (a[k] + T * jerk[k] / 2)
            a[k + 1] = a[k] + T * jerk[k]
        a[3] = 0.0  # the jerk segments cancel; their rounding must not become a ramp
        n = np.clip(np.searchsorted(starts, time, side="right") - 1, 0, 3)
        s = time - starts[n]
        position = x[n] + s * (v[n] + s * (a[n] / 2 + s * jerk[n] / 6))
        return position, v[n] + s * (a[n] + s * jerk[n] / 2), a[n] + s * jerk[n]


def jerk_limited_step(length: float, jerk: float, a_lim: float, v_lim: float) -> JerkLimitedStep:
    """Return the time-optimal jerk-limited step from rest to rest (paper section III, fig. 3).

    Parameters
    ----------
    length : SL [m]
    jerk : j_lim [m/s³]. The paper prints 200 m/s⁴ for its step of 4 mm; a jerk is m/s³, and with
        200 m/s³ the step lasts 86.2 ms with a_max = 4.31 m/s² and v_max = 92.8 mm/s.
    a_lim : acceleration limit [m/s²]
    v_lim : speed limit [m/s]

    Raises
    ------
    ValueError
        when one of the values is not a positive number.
    """
    for name, value in (("length", length), ("jerk", jerk), ("a_lim", a_lim), ("v_lim", v_lim)):
        if not (isfinite(value) and value > 0):
            raise ValueError(f"{name} of a jerk-limited step must be a positive number, got {value!r}")
    T_j, T_a = _ramp_to_speed(v_lim, jerk, a_lim)
    ramps = v_lim * (2 * T_j + T_a)
    if length >= ramps:
        return JerkLimitedStep(length, jerk, T_j, T_a, (length - ramps) / v_lim)
    T_j, T_a = _ramp_over_length(length, jerk, a_lim)
    return JerkLimitedStep(length, jerk, T_j, T_a, 0.0)


def _ramp_to_speed(v: float, jerk: float, a_lim: float) -> tuple[float, float]:
    """T_j and T_a [s] of the quickest ramp from rest to speed v [m/s]."""
    if v * jerk <= a_lim**2:
        return sqrt(v / jerk), 0.0
    return a_lim / jerk, v / a_lim - a_lim / jerk


def _ramp_over_length(length: float, jerk: float, a_lim: float) -> tuple[float, float]:
    """T_j and T_a [s] of a step below the speed limit: SL = jerk T_j (T_j + T_a) (2 T_j + T_a)."""
    T_j = cbrt(length / (2 * jerk))
    if jerk * T_j <= a_lim:
        return T_j, 0.0
    T_j = a_lim / jerk
    return T_j, (sqrt(T_j**2 + 4 * length / a_lim) - 3 * T_j) / 2
