"""What a right model is expected to miss in the acceleration of a move, beyond the accelerometer's own noise, and in
the force on the motors.

The model is driven by the measured speed of the motor. Its noise, which the drive shows at rest, is integrated to a
position that wanders by some 0.1 µm within a move, and stiff flanks turn that into accelerations above the sensor's
noise. So residuals are compared with the variance I + G·Gᵀ, in which G is what one standard deviation of every speed
sample does to the prediction, how far the motion between the speed's samples is trusted, and how far the motors of a
gantry may have wandered apart. Where a load bounces off its flanks, all samples together do what none does alone: there
noises of all samples, drawn at random, say how much is expected, as they do of the force. While effects are searched
for, only its diagonal is used, as weights: whitening by the whole of it was found to take a structure that is slightly
off for a wander. The numbers of the structure that was chosen are fitted with the few ways beside it in which the
speed's noise lets a move wander.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from service.backlash.model_fit_input_noise import errors_of_samples
from service.backlash.moves import Moves, Wander
from service.backlash.moves_predicted import motor_coefficients, simulated
from service.backlash.rest_noise import sample_noise
from service.dynamics.driven_model import Model
from service.dynamics.effects.driven_bodies import WANDERING
from service.recording import FloatArray

UNTRUSTED = 0.25
"""Share of what reconstructing changes in the motor's motion between its samples that is doubted (chosen)."""
SEED, DRAWS, MANY = 1, 24, 4.0
"""Random noises of all samples, and how many times the sum of what the samples do must be exceeded by their mean square
(chosen): where a load bounces off a flank, which sooner or later does not happen, all samples together do what none
does alone."""
TOGETHER = 8
"""How many sets are simulated at a time: with more, a gantry takes more memory than its search does."""
WAYS = 6
"""In which a move wanders; chosen: the motor's place and speed when the gap opens and when it closes, and some more."""


class Expected(NamedTuple):
    """What a right model is expected to miss.

    Attributes
    ----------
    acceleration : (T, X, K) the standard deviation of the residuals over the sensor's noise
    wander : how that divides
    force : (S, T, X, K + 1) courses by which the force on the motors may be off, whose squares add up [m/s²]
    """

    acceleration: FloatArray
    wander: Wander
    force: FloatArray


def speed_errors(moves: Moves, x: int, skew: float) -> FloatArray:
    """Motion of motor x that one standard deviation of each speed sample adds: (samples, T, K, 5)."""
    axis, K = moves.axes[x], moves.samples
    trace = moves.recording.traces[axis, "motor_speed"]
    size = (
        sample_noise(trace, moves.recording) * moves.recording.axis(axis).transmission * moves.noise_left[x]
    )
    starts = [grid.start + skew for grid in moves.grids]
    return errors_of_samples(trace.time, size, starts, moves.h, K)


def expected_errors(
    moves: Moves,
    model: Model,
    shared: FloatArray,
    local: FloatArray,
    *,
    fitted: bool,
) -> Expected:
    """What a right model is expected to miss, at a point of it: shared (P,), local (T, L). Where the moves are `fitted`
    whole, so is how far a gantry's motors wandered apart."""
    values = model.complete(model.values(shared[None]))
    skews = [float(values[f"{a}.skew"][0]) for a in moves.axes]
    c = motor_coefficients(moves, np.array([skews]))
    plain = replace(moves, motion=tuple(moves.plain for _ in moves.grids), echoes=(), reference=None)
    doubted = UNTRUSTED * (motor_coefficients(plain, np.array([skews])) - c)
    doubted[..., 0] -= doubted[:, :, :1, :, 0]
    course = simulated(moves, model, shared[None], local[None], c)
    said, acts = course.acceleration(), course.force()

    def off(motion: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Of the acceleration (S, T, X, K), over the noise, and of the force (S, T, X, K + 1) [m/s²]."""
        S = len(motion)
        lanes = np.tile(shared, (S, 1)), np.tile(local, (S, 1, 1))
        changed = simulated(moves, model, *lanes, motion)
        missed = (changed.acceleration() - said) / moves.noise[:, None]
        return np.nan_to_num(missed), np.nan_to_num(changed.force() - acts)

    missed, pulls = off(c + doubted)
    beside, of_force = 1.0 + missed[0] ** 2, [pulls]
    if len(moves.axes) == 2 and model.bridge and not fitted:
        wander = np.zeros_like(c)
        wander[:, :, :, 1, 0] = moves.apart * WANDERING
        missed, pulls = off(c + wander)
        beside += missed[0] ** 2
        of_force.append(pulls)
    by_sample, rng = [], np.random.default_rng(SEED)
    drawn = np.tile(c, (DRAWS, 1, 1, 1, 1))
    for x, skew in enumerate(skews):
        every = speed_errors(moves, x, skew)
        drawn[:, :, :, x] += np.einsum(
            "snt,ntkc->stkc", rng.standard_normal((DRAWS, *every.shape[:2])), every, optimize=True
        )
        for errors in in_parts(every):
            motion = np.tile(c, (len(errors), 1, 1, 1, 1))
            motion[:, :, :, x] += errors
            by_sample.append(off(motion)[0])
    together = np.concatenate(by_sample)
    summed = np.sum(together**2, axis=0)
    of_all = [off(part) for part in in_parts(drawn)]
    beside += beyond(np.concatenate([missed for missed, _ in of_all]), summed)
    of_force += [pulls / np.sqrt(DRAWS) for _, pulls in of_all]
    wandering = wander_of(together, beside, moves.used)
    return Expected(np.sqrt(beside + summed), wandering, np.concatenate(of_force))


def beyond(drawn: FloatArray, summed: FloatArray) -> FloatArray:
    """The mean square of what whole noises do (S, …) beyond the sum of squares of what the samples do by themselves,
    where it is many times as much."""
    mean = np.mean(drawn**2, axis=0)
    return np.where(mean > MANY * summed, mean - summed, 0.0)


def wander_of(together: FloatArray, beside: FloatArray, used: FloatArray) -> Wander:
    """The few ways that hold most of what the speed's samples together (samples, T, X, K) do, the rest being white."""
    ways, rest = np.zeros((*used.shape, WAYS)), beside.copy()
    for t, of in enumerate(used):
        flat, kept = together[:, t].reshape(len(together), -1), of.ravel()
        u, size, _ = np.linalg.svd(flat[:, kept].T, full_matrices=False)
        large = (u * size)[:, :WAYS]
        rest[t][of] += np.sum(flat[:, kept] ** 2, axis=0) - np.sum(large**2, axis=1)
        scaled = large / np.sqrt(rest[t][of])[:, None]
        q, s, _ = np.linalg.svd(scaled, full_matrices=False)
        ways[t][of] = q * np.sqrt(1.0 - 1.0 / np.sqrt(1.0 + s**2))
    return Wander(np.sqrt(rest), ways)


def in_parts(sets: FloatArray) -> list[FloatArray]:
    """Cut into parts of so few sets that their courses need little memory."""
    return np.array_split(sets, -(-len(sets) // TOGETHER))
