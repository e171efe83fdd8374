"""The motion of the motors in the moves, reconstructed from a model's force, and what the motors say of that force."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.interpolate import PPoly

from service.backlash.alike_moves import on_one_course
from service.backlash.model_fit_data import KEPT, reconstructed
from service.backlash.motor_rows import motor_rows
from service.backlash.moves import Moves
from service.backlash.rest_noise import sample_noise
from service.dynamics.driven_model import Model
from service.dynamics.driven_reconstruction import Balance, Echo, Load, echo, window
from service.recording import FloatArray, Trace


def with_reconstructed_motion(
    moves: Moves, model: Model, shared: FloatArray, force: FloatArray, follow: bool = True
) -> Moves:
    """The moves with the motor's motion between its samples by the model's force and the torque, eq. (1).

    With `follow` that motion goes on following the force. Moves that were made alike have one motion.
    """
    values, lags = model.complete(model.values(shared[None])), model.lags(model.numbers(shared))
    kept = 0.0 if moves.reference is None else KEPT
    motions, echoes = [], []
    for x, axis in enumerate(moves.axes):
        skew = float(values[f"{axis}.skew"][0])
        loads = [(grid.time + skew, force[t, x]) for t, grid in enumerate(moves.grids)]
        before = [motion[x] for motion in moves.motion]
        motion, balance = reconstructed(moves.recording, axis, loads, before, kept, lags[x])
        motions.append(alike_on_one_course(moves, motion))
        speed = moves.recording.traces[axis, "motor_speed"]
        echoes.append(echoes_of(speed, loads, balance, 1.0 - kept, lags[x]) if follow else [])
    return replace(
        moves,
        motion=tuple(zip(*motions, strict=True)),
        echoes=tuple(zip(*echoes, strict=True)),
        reference=force if follow else None,
    )


def alike_on_one_course(moves: Moves, motions: Sequence[PPoly]) -> list[PPoly]:
    """The motions of one motor (T,), those of moves that were made alike on their mean course."""
    out, of_index = list(motions), {grid.index: t for t, grid in enumerate(moves.grids)}
    for group in moves.alike:
        here = [of_index[index] for index in group if index in of_index]
        if len(here) > 1:
            starts = [moves.made[t].start for t in here]
            for t, motion in zip(here, on_one_course([motions[t] for t in here], starts), strict=True):
                out[t] = motion
    return out


def with_motors_asked(moves: Moves, model: Model, shared: FloatArray, force: FloatArray) -> Moves:
    """The moves with the equations of motion of their motors as further residuals, over the noise with the force
    (T, X, K + 1) of a fit; where no torque was recorded, or hardly a speed, as they are."""
    recording, motors = moves.recording, []
    lags = model.lags(model.numbers(shared))
    values = model.complete(model.values(shared[None]))
    for x, axis in enumerate(moves.axes):
        torque = recording.trace(axis, "motor_torque")
        if torque is None:
            return moves
        skew = float(values[f"{axis}.skew"][0])
        loads = [(grid.time + skew, force[t, x]) for t, grid in enumerate(moves.grids)]
        motions = [motion[x] for motion in moves.motion]
        speed, ratio = recording.traces[axis, "motor_speed"], recording.axis(axis).transmission
        noise = sample_noise(speed, recording), sample_noise(torque, recording)
        off = np.zeros((1, *force.shape)) if moves.force_off is None else moves.force_off
        unsure = list(np.moveaxis(off[:, :, x], 0, 1))
        rows = motor_rows(speed, torque, moves.noise_left[x], ratio, loads, motions, noise, unsure, lags[x])
        if not rows:
            return moves
        motors.append(rows)
    return replace(moves, motors=tuple(zip(*motors, strict=True)))


def echoes_of(speed: Trace, loads: Sequence[Load], balance: Balance, share: float, lag: float) -> list[Echo]:
    """The echo of every move; moves whose samples lie alike on the grid share one."""
    known: dict[tuple[int, int], Echo] = {}
    out = []
    for load in loads:
        part = window(speed, load)
        where = (round((float(part.time[0]) - float(load[0][0])) * 1e7), len(part))
        if where not in known:
            known[where] = echo(speed, load, balance, share, lag=lag)
        out.append(known[where])
    return out
