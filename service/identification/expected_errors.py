"""What a right model is expected to miss in the acceleration of a move, beyond the accelerometer's own noise.

The model is driven by the measured speed of the motor. Its noise, which the drive shows at rest, is integrated to a
position that wanders by some 0.1 µm within a move, and stiff flanks turn that into accelerations above the sensor's
noise. So residuals are compared with the variance I + G·Gᵀ, in which G is what one standard deviation of every
speed sample does to the prediction, how far the motion between the speed's samples is trusted, and how far the motors
of a gantry may have wandered apart. Only its diagonal is used, as weights: whitening by the whole of it is sharper
where the structure is right, and was found to take a structure that is slightly off for a wander.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.interpolate import CubicSpline

from service.dynamics.driven_model import Model
from service.dynamics.effects.driven_bodies import WANDERING
from service.identification.moves import Moves, motor_coefficients, noise_at_rest, simulated
from service.recording import FloatArray, Trace

UNTRUSTED = 0.25
"""Share of what reconstructing changes in the motor's motion between its samples that is doubted (chosen)."""
TOGETHER = 24
SMALLEST_DIGIT = 0.29
"""Standard deviation of rounding, in digits: 1/√12."""


def speed_noise(trace: Trace, moves: Moves) -> float:
    """Standard deviation of one speed sample [rad/s]; at least that of its rounding."""
    steps = np.diff(np.unique(trace.value))
    digit = float(steps.min()) if len(steps) else 0.0
    return max(noise_at_rest(trace, moves.recording), SMALLEST_DIGIT * digit)


def speed_errors(moves: Moves, x: int, skew: float) -> FloatArray:
    """Motion of motor x that one standard deviation of each speed sample adds: (samples, T, K, 5)."""
    axis, T, K = moves.axes[x], len(moves.grids), moves.samples
    trace = moves.recording.traces[axis, "motor_speed"]
    size = speed_noise(trace, moves) * moves.recording.axis(axis).transmission
    parts = []
    for grid in moves.grids:
        first = grid.start + skew
        near = np.flatnonzero((trace.time > first) & (trace.time < first + K * moves.h))
        time = trace.time[max(0, near[0] - 4) : near[-1] + 5]
        parts.append((first, CubicSpline(time, size * np.eye(len(time))).antiderivative(), len(time)))
    out = np.zeros((max(count for _, _, count in parts), T, K, 5))
    for t, (first, error, count) in enumerate(parts):
        out[:count, t] = coefficients_of_many(error, first, moves.h, K)
    return out


def coefficients_of_many(position: CubicSpline, start: float, h: float, K: int) -> FloatArray:
    """As driven_motion.coefficients, of S motions at once: (S, K, 5); they begin at zero."""
    t = start + h * np.arange(K + 1)
    x, v, a = (np.asarray(position(t, nu)).T for nu in range(3))
    x = x - x[:, :1]
    mean, first, last = np.diff(v) / h, a[:, :-1], a[:, 1:]
    bend = (6.0 * mean - 4.0 * first - 2.0 * last) / h
    return np.stack((x[:, :-1], v[:, :-1], first, bend, 6.0 * (first + last - 2.0 * mean) / h**2), axis=-1)


def expected_errors(
    moves: Moves,
    model: Model,
    shared: FloatArray,
    local: FloatArray,
    *,
    fitted: bool,
) -> FloatArray:
    """Expected standard deviation of the residuals over the noise (T, X, K), at a point of the model: shared (P,),
    local (T, L). Where the moves are `fitted` whole, so is how far a gantry's motors wandered apart."""
    values = model.complete({p.name: p.value(shared[k : k + 1]) for k, p in enumerate(model.parameters)})
    skews = [float(values[f"{a}.skew"][0]) for a in moves.axes]
    c = motor_coefficients(moves, np.array([skews]))
    plain = replace(moves, motion=tuple(moves.plain for _ in moves.grids), echoes=(), reference=None)
    doubted = UNTRUSTED * (motor_coefficients(plain, np.array([skews])) - c)
    doubted[..., 0] -= doubted[:, :, :1, :, 0]
    said = simulated(moves, model, shared[None], local[None], c).acceleration()
    squares = np.zeros_like(said[0])

    def add(motion: FloatArray) -> None:
        S = len(motion)
        lanes = np.tile(shared, (S, 1)), np.tile(local, (S, 1, 1))
        off = simulated(moves, model, *lanes, motion).acceleration() - said
        squares[:] += np.sum(np.nan_to_num(off / moves.noise[:, None]) ** 2, axis=0)

    add(c + doubted)
    if len(moves.axes) == 2 and model.bridge and not fitted:
        wander = np.zeros_like(c)
        wander[:, :, :, 1, 0] = WANDERING
        add(c + wander)
    for x, skew in enumerate(skews):
        for errors in in_parts(speed_errors(moves, x, skew)):
            motion = np.tile(c, (len(errors), 1, 1, 1, 1))
            motion[:, :, :, x] += errors
            add(motion)
    return np.asarray(np.sqrt(1.0 + squares))


def in_parts(sets: FloatArray) -> list[FloatArray]:
    """Cut into parts of so few sets that their courses need little memory."""
    return np.array_split(sets, -(-len(sets) // TOGETHER))
