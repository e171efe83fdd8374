"""A recording with diagnostic moves made ready for the fit: windows, motor motion, compared samples, noise."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from service.identification.axis_simulation import MotorMotion
from service.recording import FloatArray, Move, Recording, Trace

BEFORE = 0.003
"""How long before a move its window starts [s]: the motor may creep ahead of the command."""
AFTER = 0.012
"""How long after a move its window ends [s]: time for the last flank change and for a late sensor."""
GRID = 1.26e-4
"""Largest step of the simulation [s]."""


@dataclass(frozen=True)
class Samples:
    """The compared samples of one axis: time [s], value [m/s²], window number and half-move number, (n,) each."""

    time: FloatArray
    value: FloatArray
    window: NDArray[np.int64]
    block: NDArray[np.int64]


@dataclass(frozen=True)
class AxisProblem:
    """One recording of one axis, or of the two of a gantry.

    Attributes
    ----------
    samples : per axis
    noise : (A,) standard deviation of the sensor's noise [m/s²], measured at standstill
    ring : strongest frequency in the rests between the moves [Hz]: a body that swings on shows there
    period : the accelerometer's sample period [s]
    """

    axes: tuple[str, ...]
    moves: tuple[Move, ...]
    motion: MotorMotion
    samples: tuple[Samples, ...]
    noise: FloatArray
    ring: float
    period: float

    def target(self) -> FloatArray:
        """All compared values over their noise, one axis after the other (m,)."""
        return np.concatenate([s.value / n for s, n in zip(self.samples, self.noise, strict=True)])

    def windows(self) -> NDArray[np.int64]:
        """Number of the move of each entry of ``target``."""
        return np.concatenate([s.window for s in self.samples])

    def blocks(self) -> NDArray[np.int64]:
        """Half-move number of each entry of ``target``."""
        return np.concatenate([s.block for s in self.samples])


def axis_problem(recording: Recording, axes: Sequence[str], moves: int | None = None) -> AxisProblem:
    """The first ``moves`` moves (all by default) of the given axes, ready for the fit."""
    chosen = recording.moves[:moves]
    first = recording.traces[axes[0], "acceleration"]
    period = float(np.median(np.diff(first.time)))
    return AxisProblem(
        axes=tuple(axes),
        moves=chosen,
        motion=_motion(recording, axes, chosen, period),
        samples=tuple(_samples(recording.traces[a, "acceleration"], chosen) for a in axes),
        noise=np.array([sensor_noise(recording, a) for a in axes]),
        ring=rest_frequency(recording, axes[0]),
        period=period,
    )


def one_axis(problem: AxisProblem, axis: int) -> AxisProblem:
    """One side of a gantry's problem by itself."""
    m, only = problem.motion, slice(axis, axis + 1)
    motion = replace(
        m,
        position=m.position[:, :, only],
        speed=m.speed[:, :, only],
        travel=m.travel[:, only],
        came_from=m.came_from[:, only],
    )
    return replace(
        problem,
        axes=problem.axes[only],
        motion=motion,
        samples=problem.samples[only],
        noise=problem.noise[only],
    )


def _motion(recording: Recording, axes: Sequence[str], moves: Sequence[Move], period: float) -> MotorMotion:
    """Motor motion on the grid: a cubic spline through the measured speed and its integral."""
    h = period / int(np.ceil(period / GRID))
    K = round((max(m.duration for m in moves) + BEFORE + AFTER) / h)
    start = np.array([m.start - BEFORE for m in moves])
    time = start + h * np.arange(K)[:, None]
    position, speed = np.empty((K, len(moves), len(axes))), np.empty((K, len(moves), len(axes)))
    for column, axis in enumerate(axes):
        trace = recording.traces[axis, "motor_speed"]
        course = CubicSpline(trace.time, trace.value * recording.axis(axis).transmission)
        at = np.clip(time, trace.time[0], trace.time[-1])
        position[:, :, column] = course.antiderivative()(at)
        speed[:, :, column] = course(np.maximum(at - 0.5 * h, trace.time[0]))
    travel = position[0].copy()
    came_from = np.array([0.0, *(float(m.direction) for m in moves[:-1])])
    return MotorMotion(
        start, position - travel, speed, travel, np.repeat(came_from[:, None], len(axes), axis=1), h
    )


def _samples(trace: Trace, moves: Sequence[Move]) -> Samples:
    time, value, window, block = [], [], [], []
    for number, move in enumerate(moves):
        part = trace.between(move.start, move.end)
        time.append(part.time)
        value.append(part.value)
        window.append(np.full(len(part), number))
        block.append(2 * number + (part.time > move.start + 0.5 * move.duration))
    return Samples(
        np.concatenate(time),
        np.concatenate(value),
        np.concatenate(window),
        np.concatenate(block).astype(np.int64),
    )


def sensor_noise(recording: Recording, axis: str) -> float:
    """Noise of the accelerometer [m/s²] before the first move, from differences: a slow swing does not count."""
    trace = recording.traces[axis, "acceleration"]
    end = recording.moves[0].start - BEFORE
    rest = trace.between(trace.time[0], end).value
    if len(rest) < 50:
        rest = np.concatenate([trace.between(m.start - 0.1, m.start - BEFORE).value for m in recording.moves])
    steps = np.diff(rest, n=2)
    return float(1.4826 * np.median(np.abs(steps - np.median(steps))) / np.sqrt(6.0))


def rest_frequency(recording: Recording, axis: str) -> float:
    """Frequency [Hz] of the strongest line between 3 and 200 Hz in the rests after the moves."""
    trace, moves = recording.traces[axis, "acceleration"], recording.moves
    period = float(np.median(np.diff(trace.time)))
    frequencies = np.fft.rfftfreq(1 << 16, period)
    power = np.zeros(len(frequencies))
    for move, after in itertools.pairwise(moves):
        rest = trace.between(move.end + 2.0 * AFTER, after.start - BEFORE).value
        if len(rest) >= 64:
            power += np.abs(np.fft.rfft((rest - rest.mean()) * np.hanning(len(rest)), 1 << 16)) ** 2
    inside = (frequencies > 3.0) & (frequencies < 200.0)
    return float(frequencies[inside][np.argmax(power[inside])])


def read_sensor(problem: AxisProblem, speed: FloatArray, P: Mapping[str, FloatArray]) -> FloatArray:
    """What the accelerometers read (m, L) over their noise, from the carriages' speed (K, L, W, A).

    A sample is the mean over its interval; simulated speeds stand half a step before their index.
    Latency, gain and bias are the sensor's own effects.
    """
    return np.concatenate(
        [_read_axis(problem, speed[..., a], P, a) / problem.noise[a] for a in range(len(problem.axes))]
    )


def _read_axis(problem: AxisProblem, speed: FloatArray, P: Mapping[str, FloatArray], axis: int) -> FloatArray:
    samples, motion = problem.samples[axis], problem.motion
    late = P["latency"][:, 0, axis] if "latency" in P else np.zeros(1)
    since = (samples.time - motion.start[samples.window])[:, None] - late
    window, lane = samples.window[:, None], np.arange(speed.shape[1])

    def at(shift: float) -> FloatArray:
        place = np.clip((since + shift) / motion.h + 0.5, 0.0, len(speed) - 1.0 - 1e-6)
        index = place.astype(np.int64)
        share = place - index
        return np.asarray(speed[index, lane, window] * (1.0 - share) + speed[index + 1, lane, window] * share)

    reading = (at(0.5 * problem.period) - at(-0.5 * problem.period)) / problem.period
    if "gain_error" in P:
        reading = reading * (1.0 + P["gain_error"][:, 0, axis])
    if "bias" in P:
        reading = reading + P["bias"][:, 0, axis]
    return np.asarray(reading)
