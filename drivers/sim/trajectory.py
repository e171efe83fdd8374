"""The drive's own trajectory generator: jerk-limited or linear ramps from rest to rest, and the stop ramp.

Written for the device's side of the wire and on purpose not shared with the service's closed form, so
that an error of one cannot hide behind the other. Units are those of the motor shaft: rad, rad/s, …
"""

from __future__ import annotations

from dataclasses import dataclass
from math import copysign, inf, sqrt

import numpy as np

from drivers.sim.physics import FloatArray

Phase = tuple[float, float, float]
"""Duration [s], acceleration at its beginning [rad/s²], jerk [rad/s³]."""


@dataclass(frozen=True)
class Profile:
    """A motion that is cubic between knots; the last knot is rest at the end position.

    Attributes
    ----------
    knots : (k,) [s] from the start of the motion
    position, speed, acceleration, jerk : (k,) at the knots, after any jump [rad], [rad/s], …
    """

    knots: FloatArray
    position: FloatArray
    speed: FloatArray
    acceleration: FloatArray
    jerk: FloatArray

    @property
    def duration(self) -> float:
        return float(self.knots[-1])

    @property
    def end(self) -> float:
        return float(self.position[-1])

    def at(self, tau: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Position, speed and acceleration at times ``tau`` (n,) >= 0 [s] from the start, each (n,)."""
        k = np.searchsorted(self.knots, tau, side="right") - 1
        u = tau - self.knots[k]
        x, v, a, j = self.position[k], self.speed[k], self.acceleration[k], self.jerk[k]
        return x + u * (v + u * (a / 2 + u * j / 6)), v + u * (a + u * j / 2), a + u * j


def point_to_point(
    start: float, target: float, speed: float, acceleration: float, deceleration: float, jerk: float = inf
) -> Profile:
    """The fastest motion from rest at ``start`` to rest at ``target`` [rad] within the limits, all > 0.

    Without a jerk limit the ramps of the speed are linear.
    """
    distance = abs(target - start)
    peak = _peak_speed(distance, speed, acceleration, deceleration, jerk)
    up, down = _ramp(peak, acceleration, jerk), _ramp(peak, deceleration, jerk)
    cruise = max(0.0, (distance - _covered(peak, up) - _covered(peak, down)) / peak) if peak > 0 else 0.0
    phases = [*up, (cruise, 0.0, 0.0), *((time, -a, -j) for time, a, j in down)]
    return _join(start, 0.0, copysign(1.0, target - start), phases, end=target)


def stop_ramp(position: float, speed: float, deceleration: float) -> Profile:
    """Brake from ``speed`` to rest at constant ``deceleration`` > 0 [rad/s²]."""
    end = position + speed * abs(speed) / (2 * deceleration)
    phases = [(abs(speed) / deceleration, -deceleration, 0.0)]
    return _join(position, abs(speed), copysign(1.0, speed), phases, end=end)


def _ramp(speed: float, acceleration: float, jerk: float) -> list[Phase]:
    """From rest to ``speed`` with the acceleration back at zero: jerk up, constant, jerk down."""
    reached = min(acceleration, sqrt(speed * jerk)) if speed > 0 else 0.0
    if reached == 0:
        return []
    rise = reached / jerk
    return [(rise, 0.0, jerk), (speed / reached - rise, reached, 0.0), (rise, reached, -jerk)]


def _covered(speed: float, ramp: list[Phase]) -> float:
    """Distance of a ramp between rest and ``speed``: it is symmetric, hence half its duration at full speed."""
    return speed / 2 * sum(time for time, _, _ in ramp)


def _peak_speed(
    distance: float, speed: float, acceleration: float, deceleration: float, jerk: float
) -> float:
    """The highest speed <= ``speed`` whose two ramps fit into ``distance``, by bisection to the last bit."""

    def needed(peak: float) -> float:
        return _covered(peak, _ramp(peak, acceleration, jerk)) + _covered(
            peak, _ramp(peak, deceleration, jerk)
        )

    if distance == 0 or needed(speed) <= distance:
        return speed if distance else 0.0
    low, high = 0.0, speed
    while low < (middle := (low + high) / 2) < high:
        low, high = (middle, high) if needed(middle) <= distance else (low, middle)
    return low


def _join(start: float, speed: float, sign: float, phases: list[Phase], end: float) -> Profile:
    """Chain the phases from ``start`` at ``speed`` >= 0 along ``sign``; the last knot is rest at ``end``."""
    knots, t, x, v = [], 0.0, start, sign * speed
    for time, a, j in phases:
        if time <= 0:
            continue
        a, j = sign * a, sign * j
        knots.append((t, x, v, a, j))
        t, x, v = t + time, x + time * (v + time * (a / 2 + time * j / 6)), v + time * (a + time * j / 2)
    knots.append((t, end, 0.0, 0.0, 0.0))
    return Profile(*np.array(knots, dtype=np.float64).T)
