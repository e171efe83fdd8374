"""From a recording to the samples, noise and input of an output-error fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import PPoly

from service.backlash.contact_steps import REST_BEFORE
from service.backlash.equivalent_time import interleaved
from service.backlash.model_fit_problem import Fit, Problem
from service.backlash.set_points import motors_of
from service.dynamics.driven_model import LINKS, Model
from service.dynamics.driven_motion import StepGrid, on_grid, sample_period
from service.dynamics.driven_reconstruction import (
    Balance,
    Load,
    as_reported,
    echo,
    motor_balance,
    reconstructed_motion,
    torque_courses,
    window,
)
from service.recording import FloatArray, Move, Recording, Trace

START_FRACTION = 0.3
"""Part of the move left out at its start: later the axis may already be in the gap, earlier it still rings from
crossing the gap that it rested in; see estimator.md no. 2."""

SETTLING = 0.004
"""Time at the start of the simulated part that is not compared [s]: fast modes start in balance, not as they are."""

LOW_SPEED = 0.15
"""Share of the step's greatest speed below which samples are not compared: friction may turn there."""

END_FRACTION, LATEST = 0.97, 1.5
"""Part of the move that is simulated; where the motors lag behind the command, as long as they move, up to the second
at most. A soft loop brakes, and passes the gap, when the commanded step is over."""

FOLLOWED = 0.15
"""The load's frequency on the held motor over the speed's rate up to which a spline follows the motor. The motor rings
with it, faster by √(1 + M over its inertia), some 0.23 of the rate: there a cubic spline loses (0.3)⁴, 1 %, in which
a resonance answers with some 6 %; at 0.36, 180 Hz at 500 Hz, it loses 10 %."""


LOCAL_SPREAD = np.array([1e-5, 1e-2])
"""Prior of the load's position [m] and speed [m/s] at the start of the simulated part, against the flank: the
contact still swings from the first crossing of the gap."""

KEPT = 0.3
"""Share of the motion so far that a further reconstruction keeps. Force and motion answer each other, near the
resonance of the load on the held motor with opposite sign: all of it at once swings."""


@dataclass(frozen=True)
class Measured:
    """What one fit needs of the recording: (X,) noise, (T,) grids, and (T, X) the motors' motion to begin with;
    `closer` is the recording with what moves alike say of a single axis' drive between its samples; `off` by how much a
    motor may be off its position within a move [m]."""

    recording: Recording
    closer: Recording
    axes: tuple[str, ...]
    noise: FloatArray
    grids: tuple[StepGrid, ...]
    motion: tuple[tuple[PPoly, ...], ...]
    off: float

    @property
    def local_spread(self) -> FloatArray:
        """Prior of the nuisance coordinates of each step and axis (L,): the load's, and of a gantry its motor's."""
        return LOCAL_SPREAD if len(self.axes) == 1 else np.append(LOCAL_SPREAD, self.off)


def rests(trace: Trace, moves: Sequence[Move]) -> list[FloatArray]:
    """The samples in the rest before each move."""
    parts = (trace.between(move.start - REST_BEFORE, move.start).value for move in moves)
    return [part for part in parts if len(part) > 10]


def noise_at_rest(trace: Trace, moves: Sequence[Move]) -> float:
    """Standard deviation of one sample [m/s²] at rest: the median over the rests, so that one disturbed rest (a
    gantry still moves in its first) does not count; from differences, so that slow motion does not."""
    spreads = [float(np.sqrt(0.5 * np.mean(np.diff(part) ** 2))) for part in rests(trace, moves)]
    return float(np.median(spreads))


def digital_noise(trace: Trace, moves: Sequence[Move]) -> float:
    """Noise of one sample at rest, or that of its last digit where that is more."""
    levels = np.unique(trace.value)
    digit = float(np.min(np.diff(levels))) if len(levels) > 1 else 1.0
    return max(noise_at_rest(trace, moves), digit / float(np.sqrt(12.0)))


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
    end = ending(recording, index, plain)
    start, K = zero + (first - 0.5) * h, int((end - START_FRACTION) * move.duration / h)
    measured = np.stack([on_grid(trace, start, h, K) for trace in traces]) - bias[:, None]
    middle = start + h * (np.arange(K) + 0.5)
    speed = np.stack([move.direction * np.asarray(p(middle, 1)) for p in plain])
    early = middle < move.start + 0.5 * move.duration
    moving = (speed > LOW_SPEED * speed.max(axis=1, keepdims=True)) | early
    used = np.isfinite(measured) & np.logical_and.accumulate(moving, axis=1) & (middle > start + SETTLING)
    return StepGrid(index, move.direction, start, h, measured, used)


def ending(recording: Recording, index: int, plain: Sequence[PPoly]) -> float:
    """Share of the move at which the slowest of its motors hardly moves any more, END_FRACTION at least."""
    move, later = recording.moves[index], recording.moves[index + 1 :]
    room = min((later[0].start - move.start) / move.duration - 0.5 if later else LATEST, LATEST)
    share = np.arange(START_FRACTION, max(room, END_FRACTION), 0.01)
    speed = np.stack([move.direction * p(move.start + share * move.duration, 1) for p in plain])
    moving = (speed > LOW_SPEED * speed.max(axis=1, keepdims=True)) | (share < 0.5)
    lasting = np.logical_and.accumulate(moving, axis=1).any(axis=0)
    return max(END_FRACTION, float(share[lasting][-1]))


def acceleration_of(recording: Recording, axis: str) -> Trace:
    """The acceleration of an axis that is known to have one."""
    return recording.traces[axis, "acceleration"]


def measure(recording: Recording, axes: Sequence[str], steps: Sequence[int]) -> Measured:
    """Everything a fit needs of the given steps; grids are cut to the shortest."""
    traces = [acceleration_of(recording, axis) for axis in axes]
    h = sample_period(traces[0])
    bias = np.array([bias_at_rest(trace, recording.moves) for trace in traces])
    noise = np.array([noise_at_rest(trace, recording.moves) for trace in traces])
    closer = with_interleaved_drive(recording, axes[0]) if len(axes) == 1 else recording
    plain, off = motors_of(closer, axes)
    grids = [step_grid(recording, axes, i, h, plain, bias) for i in steps]
    K = min(g.measured.shape[1] for g in grids)
    cut = tuple(replace(g, measured=g.measured[:, :K], used=g.used[:, :K]) for g in grids)
    # A gantry's motors also feel the bridge, which no sensor shows.
    motion = [(m,) for m in begun(closer, axes[0], cut, plain[0])] if len(axes) == 1 else [plain] * len(cut)
    return Measured(recording, closer, tuple(axes), noise, cut, tuple(motion), float(off.max()))


def with_interleaved_drive(recording: Recording, axis: str) -> Recording:
    """The recording with what moves alike say of a single axis' drive between its samples. Not of a gantry: before
    every move its partner rests elsewhere, and pulls differently."""
    keys = [(axis, c) for c in ("motor_speed", "motor_torque") if (axis, c) in recording.traces]
    closer = {
        key: interleaved(trace, recording.moves, digital_noise(trace, recording.moves))
        for key, trace in ((key, recording.traces[key]) for key in keys)
    }
    return replace(recording, traces={**recording.traces, **closer})


def begun(recording: Recording, axis: str, grids: Sequence[StepGrid], plain: PPoly) -> list[PPoly]:
    """A single axis' motor around every step as far as its motion is known before any fit: the force on it is about
    what accelerates the load, as measured."""
    loads = []
    for grid in grids:
        middle = grid.start + grid.h * (np.arange(grid.measured.shape[1]) + 0.5)
        there = np.isfinite(grid.measured[0])
        loads.append((grid.time, np.interp(grid.time, middle[there], grid.measured[0, there])))
    return reconstructed(recording, axis, loads, [plain] * len(loads), 0.0)[0]


def problem_of(measured: Measured, model: Model) -> Problem:
    """The problem with everything free and the motors' motion as before any fit."""
    free = (True,) * len(model.parameters)
    return Problem(model, measured.grids, measured.motion, measured.noise, measured.local_spread, free)


def with_reconstructed_motion(
    measured: Measured, problem: Problem, fit: Fit, echoed: bool = False
) -> Problem:
    """The problem with the motor's motion between its samples by the fit's force and the torque, eq. (1).

    With `echoed` that motion is let follow the force while the machine is fitted, where that matters.
    """
    echoed = echoed and swings_fast(measured, problem, fit)
    kept = 0.0 if problem.force is None else KEPT
    motions, echoes = [], []
    for x, axis in enumerate(measured.axes):
        skew = fit.value(problem.model, f"{axis}.skew")
        loads = [(g.time + skew, fit.response.force[0, t, x]) for t, g in enumerate(problem.grids)]
        before = [motion[x] for motion in problem.motion]
        motion, balance = reconstructed(measured.closer, axis, loads, before, kept)
        motions.append(motion)
        if echoed:
            speed = measured.closer.traces[axis, "motor_speed"]
            so_far = [own[x] for own in problem.echoes] if problem.echoes else [None for _ in loads]
            echoes.append(
                [echo(speed, load, balance, 1.0 - KEPT, one) for load, one in zip(loads, so_far, strict=True)]
            )
    return replace(
        problem,
        motion=tuple(zip(*motions, strict=True)),
        echoes=tuple(zip(*echoes, strict=True)),
        force=fit.response.force[0],
    )


def swings_fast(measured: Measured, problem: Problem, fit: Fit) -> bool:
    """Whether any load on its drive swings so fast that a spline of the speed samples does not follow."""
    links, swings = (*LINKS[problem.model.lumps], "contact"), []
    for axis in measured.axes:
        period = float(np.median(np.diff(measured.recording.traces[axis, "motor_speed"].time)))
        soft = sum(1.0 / fit.value(problem.model, f"{axis}.{link}_stiffness") for link in links)
        swings.append(period / float(2.0 * np.pi * np.sqrt(soft)))
    return max(swings) > FOLLOWED


def reconstructed(
    recording: Recording,
    axis: str,
    loads: Sequence[Load],
    before: Sequence[PPoly],
    kept: float,
    lag: float = 0.0,
) -> tuple[list[PPoly], Balance]:
    """One motor's motion around every step, from its samples, the forces on it and its motion so far; as the drive
    reports it behind a first-order `lag` [s]."""
    loads = [as_reported(load, lag) for load in loads]
    speed, torque = recording.traces[axis, "motor_speed"], recording.trace(axis, "motor_torque")
    transmission = recording.axis(axis).transmission
    torques = (
        None if torque is None else torque_courses([window(torque, load) for load in loads], before, lag)
    )
    balance = motor_balance(speed, transmission, loads, torques)
    return [
        reconstructed_motion(
            speed, transmission, load, torques[t] if torques else None, balance, before[t], kept
        )
        for t, load in enumerate(loads)
    ], balance
