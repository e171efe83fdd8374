"""From a recording to the samples, noise and input of an output-error fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import PPoly

from service.backlash.contact_steps import REST_BEFORE
from service.backlash.model_fit_problem import Fit, Problem
from service.dynamics.driven_model import Model
from service.dynamics.driven_motion import (
    StepGrid,
    motor_balance,
    on_grid,
    plain_motion,
    reconstructed_motion,
    sample_period,
)
from service.recording import FloatArray, Move, Recording, Trace

START_FRACTION = 0.3
"""Part of the move left out at its start: later the axis may already be in the gap, earlier it still rings from
crossing the gap that it rested in; see estimator.md no. 2."""

SETTLING = 0.004
"""Time at the start of the simulated part that is not compared [s]: fast modes start in balance, not as they are."""

LOW_SPEED = 0.15
"""Share of the step's greatest speed below which samples are not compared: friction may turn there."""

END_FRACTION = 0.97


@dataclass(frozen=True)
class Measured:
    """What one fit needs of the recording: (X,) noise and (T,) grids, plain motor motion (X,)."""

    recording: Recording
    axes: tuple[str, ...]
    noise: FloatArray
    grids: tuple[StepGrid, ...]
    plain: tuple[PPoly, ...]


def rests(trace: Trace, moves: Sequence[Move]) -> list[FloatArray]:
    """The samples in the rest before each move."""
    parts = (trace.between(move.start - REST_BEFORE, move.start).value for move in moves)
    return [part for part in parts if len(part) > 10]


def noise_at_rest(trace: Trace, moves: Sequence[Move]) -> float:
    """Standard deviation of one sample [m/s²] at rest: the median over the rests, so that one disturbed rest (a
    gantry still moves in its first) does not count; from differences, so that slow motion does not."""
    spreads = [float(np.sqrt(0.5 * np.mean(np.diff(part) ** 2))) for part in rests(trace, moves)]
    return float(np.median(spreads))


def bias_at_rest(trace: Trace, moves: Sequence[Move]) -> float:
    """What the sensor says at rest [m/s²]: median over the rests of their means."""
    return float(np.median([np.mean(part) for part in rests(trace, moves)]))


def step_grid(
    recording: Recording, axes: Sequence[str], index: int, h: float, plain: Sequence[PPoly], bias: FloatArray
) -> StepGrid:
    """One step's samples on the grid, and which of them are compared."""
    move, traces = recording.moves[index], [acceleration_of(recording, axis) for axis in axes]
    zero = float(traces[0].time[0])
    first = round((move.start + START_FRACTION * move.duration - zero) / h)
    start, K = zero + (first - 0.5) * h, int((END_FRACTION - START_FRACTION) * move.duration / h)
    measured = np.stack([on_grid(trace, start, h, K) for trace in traces]) - bias[:, None]
    middle = start + h * (np.arange(K) + 0.5)
    speed = np.stack([move.direction * np.asarray(p(middle, 1)) for p in plain])
    early = middle < move.start + 0.5 * move.duration
    moving = (speed > LOW_SPEED * speed.max(axis=1, keepdims=True)) | early
    used = np.isfinite(measured) & np.logical_and.accumulate(moving, axis=1) & (middle > start + SETTLING)
    return StepGrid(index, move.direction, start, h, measured, used)


def acceleration_of(recording: Recording, axis: str) -> Trace:
    """The acceleration of an axis that is known to have one."""
    return recording.traces[axis, "acceleration"]


def measure(recording: Recording, axes: Sequence[str], steps: Sequence[int]) -> Measured:
    """Everything a fit needs of the given steps; grids are cut to the shortest."""
    traces = [acceleration_of(recording, axis) for axis in axes]
    h = sample_period(traces[0])
    bias = np.array([bias_at_rest(trace, recording.moves) for trace in traces])
    noise = np.array([noise_at_rest(trace, recording.moves) for trace in traces])
    plain = tuple(
        plain_motion(recording.traces[a, "motor_speed"], recording.axis(a).transmission) for a in axes
    )
    grids = [step_grid(recording, axes, i, h, plain, bias) for i in steps]
    K = min(g.measured.shape[1] for g in grids)
    cut = tuple(replace(g, measured=g.measured[:, :K], used=g.used[:, :K]) for g in grids)
    return Measured(recording, tuple(axes), noise, cut, plain)


def problem_of(measured: Measured, model: Model, local_spread: FloatArray) -> Problem:
    """The problem with the plain motor motion and everything free."""
    motion = tuple(measured.plain for _ in measured.grids)
    return Problem(
        model, measured.grids, motion, measured.noise, local_spread, (True,) * len(model.parameters)
    )


def with_reconstructed_motion(measured: Measured, problem: Problem, fit: Fit) -> Problem:
    """The problem with the motor's motion between its samples by the fit's force and the torque, eq. (1)."""
    columns = []
    for x, axis in enumerate(measured.axes):
        speed, torque = (measured.recording.trace(axis, c) for c in ("motor_speed", "motor_torque"))
        assert speed is not None
        transmission, skew = (
            measured.recording.axis(axis).transmission,
            fit.value(problem.model, f"{axis}.skew"),
        )
        loads = [(g.time + skew, fit.response.force[0, t, x]) for t, g in enumerate(problem.grids)]
        balance = motor_balance(speed, transmission, loads, torque)
        columns.append(
            [
                reconstructed_motion(speed, transmission, load, torque, balance, measured.plain[x])
                for load in loads
            ]
        )
    return replace(problem, motion=tuple(zip(*columns, strict=True)))
