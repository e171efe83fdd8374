"""An axis so simple that everything about it is known: rigid, no friction, motor exactly on the nominal step.

The flanks part at t0, where the motor begins to brake; the load goes on at constant speed; the distance grows
as j·t³/6 and is b after T = (6b/j)^(1/3). After the impact the load's excess speed j·T²/2 decays exponentially.
No line of the service's code is used, so that its errors cannot cancel.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from service.recording import AxisDescription, FloatArray, Move, Recording, Trace

TRANSMISSION = 0.003
DECAY = 0.002
"""Time constant of the load's excess speed after the impact [s]."""


@dataclass(frozen=True)
class Run:
    """What is recorded, and with what."""

    b: float = 50e-6
    count: int = 10
    length: float = 4e-3
    jerk: float = 200.0
    speed_rate: float = 1000.0
    load_rate: float = 4000.0
    noise: float = 0.0
    bias: float = 0.0
    late: float = 0.0
    seed: int = 1


def nominal(time: FloatArray, length: float, jerk: float) -> tuple[FloatArray, FloatArray]:
    """Speed and acceleration of the pure jerk-limited step starting at 0: four segments of T/4."""
    q = (length / (2 * jerk)) ** (1 / 3)
    t = np.clip(time, 0.0, 4 * q)
    a = jerk * np.where(t < q, t, np.where(t < 3 * q, 2 * q - t, t - 4 * q))
    rising = jerk * t**2 / 2
    falling = jerk * (q**2 - (t - 2 * q) ** 2 / 2)
    ending = jerk * (t - 4 * q) ** 2 / 2
    return np.where(t < q, rising, np.where(t < 3 * q, falling, ending)), a


def excess(time: FloatArray, run: Run) -> FloatArray:
    """Acceleration of the load less that of the motor, move starting at 0 [m/s²]."""
    q = (run.length / (2 * run.jerk)) ** (1 / 3)
    since = time - 2 * q
    T = passing_time(run)
    gap = (since > 0) & (since < T)
    after = since >= T
    blow = -(run.jerk * T**2 / 2) / DECAY * np.exp(-np.clip(since - T, 0.0, None) / DECAY)
    return np.where(gap, run.jerk * since, np.where(after, blow, 0.0))


def passing_time(run: Run) -> float:
    """T [s] of the pass."""
    return float((6 * run.b / run.jerk) ** (1 / 3))


def moves(run: Run) -> tuple[Move, ...]:
    duration = 4 * (run.length / (2 * run.jerk)) ** (1 / 3)
    starts = 0.35 + (duration + 0.35) * np.arange(run.count)
    return tuple(
        Move(float(s), 1 if k % 2 == 0 else -1, run.length, run.jerk, duration) for k, s in enumerate(starts)
    )


def recording(run: Run, axis: str = "X1") -> Recording:
    """The run as it would be recorded."""
    return Recording(
        machine="ideal",
        axes=(AxisDescription(axis, TRANSMISSION),),
        traces=traces(run, axis),
        moves=moves(run),
    )


def traces(run: Run, axis: str) -> dict[tuple[str, str], Trace]:
    plan = moves(run)
    end = plan[-1].end + 0.3
    time, load = (np.arange(round(end * rate)) / rate for rate in (run.speed_rate, run.load_rate))
    # The load's rate is unrelated to the motor's: no sample coincides by luck.
    load = load + 0.37 / run.load_rate
    speed, acceleration = np.zeros(len(time)), np.zeros(len(load))
    for move in plan:
        speed += move.direction * nominal(time - move.start, run.length, run.jerk)[0]
        since = load - move.start
        acceleration += move.direction * (nominal(since, run.length, run.jerk)[1] + excess(since, run))
    acceleration += run.bias + np.random.default_rng(run.seed).normal(0.0, run.noise, len(load))
    return {
        (axis, "motor_speed"): Trace(time, speed / TRANSMISSION),
        (axis, "acceleration"): Trace(load + run.late, acceleration),
    }
