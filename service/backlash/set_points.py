"""Where motors stand between the moves: at their set-points, while the integral of a noisy speed wanders off.

The two motors of a gantry strain its bridge by their distance, of which the integrated speeds tell a few tenths of a
micrometre less with every move. A drive whose position loop has an integral, or a motor that rubs little, comes back to
its set-point instead; whether it does, the travels themselves tell: then they differ from the commanded ones by no more
than the noise of the speed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import PPoly

from service.backlash.rest_noise import sample_noise
from service.dynamics.driven_motion import plain_motion, sample_period
from service.dynamics.effects.driven_bodies import WANDERING
from service.recording import FloatArray, Move, Recording

STANDS = 0.03
"""Time before a move in which the motor stands [s] (chosen: a fraction of any rest, and a swing's mean)."""
RETURNS = 2.0
"""Travels' deviations over what the noise of the speed makes of them up to which a drive comes back to its set-points
(chosen: where they are the noise, ten of them are hardly at 1.5; what friction holds off is at many times that)."""
FEWEST = 4
"""Moves from which deviations are told."""


@dataclass(frozen=True)
class Stood:
    """A motor's position [m], as far as it is known where it stands between moves, and by how much it may be off within
    a move [m]."""

    position: PPoly
    off: float


def motors_of(recording: Recording, axes: Sequence[str]) -> tuple[tuple[PPoly, ...], FloatArray]:
    """The motors' positions at the output over the whole recording [m], those of a gantry at their set-points between
    the moves if they return there; and by how much each may be off within a move (X,) [m]."""
    motors = []
    for axis in axes:
        speed, ratio = recording.traces[axis, "motor_speed"], recording.axis(axis).transmission
        plain = plain_motion(speed, ratio)
        noise = sample_noise(speed, recording) * ratio * float(np.sqrt(sample_period(speed)))
        alone = len(axes) == 1
        motors.append(Stood(plain, WANDERING) if alone else stood(plain, recording.moves, noise))
    return tuple(motor.position for motor in motors), np.array([motor.off for motor in motors])


def stood(position: PPoly, moves: Sequence[Move], noise: float) -> Stood:
    """The integrated speed with the motor at its set-points where moves begin, if it returns to them.

    Parameters
    ----------
    position : integral of the speed at the output [m]
    noise : how far that wanders in a second [m], by the noise of the speed
    """
    at = np.array([*(move.start for move in moves), position.x[-1]])
    rests = at - np.array([position.x[0], *(move.end for move in moves)])
    if len(moves) < FEWEST or rests.min() < 2.0 * STANDS:
        return Stood(position, WANDERING)
    places = np.array([float(position.integrate(t - STANDS, t)) / STANDS for t in at])
    travels, wanted = np.diff(places), np.array([move.direction * move.length for move in moves])
    scale = float(wanted @ travels) / float(wanted @ wanted)
    errors = scale * wanted - travels
    if np.sqrt(np.mean(errors**2 / np.diff(at))) > RETURNS * noise:
        return Stood(position, WANDERING)
    moving = float(np.max([move.duration for move in moves]))
    return Stood(_shifted(position, at, np.cumsum(errors)), min(WANDERING, noise * float(np.sqrt(moving))))


def _shifted(position: PPoly, at: FloatArray, by: FloatArray) -> PPoly:
    """The position moved by 0 until the first of the times `at` (n + 1,), and from there in straight lines to `by` (n,)
    when the motor stands before each of the next."""
    times = np.concatenate((at[:1], *((t - STANDS, t) for t in at[1:])))
    shift = np.concatenate(([0.0], np.repeat(by, 2)))
    x, c = position.x, position.c.copy()
    moved = np.interp(x, times, shift)
    c[-1] += moved[:-1]
    c[-2] += np.diff(moved) / np.diff(x)
    return PPoly(c, x)
