"""The moves of recordings as a problem of output error over whole moves, from rest to rest.

The forward model (``service.dynamics.driven``) is driven by the measured motion of the motor; compared are all
samples of the accelerometer during the moves. Shared between all recordings are the model's parameters; found anew
in every move is where the pinion rests in its gap, and what an effect says has its zero found again.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PPoly

from service.backlash.alike_moves import averaged as averaged_over
from service.backlash.alike_moves import made_alike
from service.backlash.model_fit_data import acceleration_of, bias_at_rest
from service.backlash.motor_rows import MotorRows
from service.backlash.rest_noise import noise_at_rest, sample_noise
from service.backlash.set_points import motors_of
from service.dynamics.driven_motion import StepGrid, on_grid, sample_period
from service.dynamics.driven_reconstruction import Echo
from service.dynamics.effects.driven_bodies import WANDERING
from service.recording import FloatArray, Move, Recording, Trace

LEAD = 0.002
"""Time simulated before a move begins [s]: the axis is at rest there."""

TAIL = 0.03
"""How much after its end a move is fitted [s]. There the load stops, and how friction turns over tells its Coulomb part
from its viscous part, which slides at one speed while the gap is crossed. Chosen: the drive stops some ms late, and the
load swings out in a few periods of its contact."""
STILL = 1.5
"""Spread of the sensor's samples in a rest, over their noise, from which on something swings there."""


@dataclass(frozen=True)
class Swings:
    """What the moves leave to those after them, by the name of an effect's coordinate of a move: what swings, and how
    well it is known what is `heard`.

    Attributes
    ----------
    loads : (T, 2·X) coordinates of the loads' position and speed at the beginning of each move, from which the move's
        own count
    width : (T,) share of its prior's width that is left of a swing's coordinate: the first move's is not known
    released : (T,) each, what the move before let go at its end such that it becomes in a free swing what is found at
        the beginning of the move
    rest : (T,) time between the two [s]
    """

    loads: FloatArray
    width: FloatArray
    released: Mapping[str, FloatArray]
    rest: FloatArray

    def of(self, kept: slice) -> Swings:
        """Those of some moves."""
        released = {name: value[kept] for name, value in self.released.items()}
        return Swings(self.loads[kept], self.width[kept], released, self.rest[kept])


@dataclass(frozen=True)
class Wander:
    """How what is expected of a right model's residuals divides.

    Attributes
    ----------
    beside : (T, X, K) standard deviation over the noise beside the ways
    ways : (T, X, K, Q) orthogonal ways in which a move's residuals over `beside` wander together, each of such a length
        c that r − c·cᵀ·r is white; 0 where there is no sample
    """

    beside: FloatArray
    ways: FloatArray

    def whitened(self, difference: FloatArray, used: FloatArray) -> FloatArray:
        """Residuals (S, T, X, K) over the noise, whitened over the samples `used` (T, X, K)."""
        over = np.where(used, difference / self.beside, 0.0)
        along = np.einsum("stxk,txkq->stq", over, self.ways)
        return np.asarray(over - np.einsum("stq,txkq->stxk", along, self.ways))


@dataclass(frozen=True)
class Moves:
    """All moves of one recording.

    Attributes
    ----------
    noise : (X,) standard deviation of one accelerometer sample [m/s²]
    grids : one per move, all of K intervals
    plain : (X,) motor position at the output over the whole recording
    noise_left : (X,) share (n,) of the noise of each speed sample that is left by averaging alike moves
    motion : (T, X) motor position around each move
    echoes, reference : (T, X) how it follows a change of the force on the motor, and the force (T, X, K + 1) from
        which it was reconstructed; none where it does not follow
    bias : (T, X) what the sensor said at rest around each move [m/s²], taken off
    expected : (T, X, K) standard deviation over the noise that a right model's residual is expected to have
    judged : the same by which models are compared, where they are fitted by another; none where by this one
    swings : what still swings at the beginning of each move, if the move before left it; none: not known
    heard : the same as the sensor heard it in the rest before, where nothing else is known: (T,) each, by the name of
        an effect's coordinate of a move, in its unit; and where the move before left a pinion between two gaps
    wander, white : how what is expected divides, and whether residuals are whitened by it
    force_off : (S, T, X, K + 1) courses by which the force on the motors may be off with a right model, whose squares
        add up [m/s²]; none where that is not known
    lasting : how long residuals of acceleration are summed up to those of speed [s]; 0: they are compared themselves
    apart : how far a gantry's motors may be apart beyond their positions, over the prior's width
    alike : moves of the recording, by index, that the drives made alike
    motors : (T, X) what the motors' equations of motion say of the forces on them; none where they are not asked
    """

    recording: Recording
    axes: tuple[str, ...]
    noise: FloatArray
    grids: tuple[StepGrid, ...]
    plain: tuple[PPoly, ...]
    noise_left: tuple[FloatArray, ...]
    motion: tuple[tuple[PPoly, ...], ...]
    bias: FloatArray
    expected: FloatArray
    judged: FloatArray | None = None
    echoes: tuple[tuple[Echo, ...], ...] = ()
    reference: FloatArray | None = None
    swings: Swings | None = None
    heard: Mapping[str, FloatArray] = field(default_factory=dict)
    wander: Wander | None = None
    force_off: FloatArray | None = None
    white: bool = False
    lasting: float = 0.0
    apart: float = 1.0
    alike: tuple[tuple[int, ...], ...] = ()
    motors: tuple[tuple[MotorRows, ...], ...] = ()

    @property
    def h(self) -> float:
        return self.grids[0].h

    @property
    def samples(self) -> int:
        return int(self.grids[0].measured.shape[1])

    @cached_property
    def s(self) -> FloatArray:
        return np.array([float(grid.s) for grid in self.grids])

    @cached_property
    def start(self) -> FloatArray:
        return np.array([grid.start for grid in self.grids])

    @cached_property
    def made(self) -> list[Move]:
        """The moves (T,) as they were commanded."""
        return [self.recording.moves[grid.index] for grid in self.grids]

    @property
    def loads(self) -> FloatArray:
        """(T, 2·X) coordinates of the loads from which each move's own count; by default at the driving flank, at
        rest."""
        return np.zeros((len(self.grids), 2 * len(self.axes))) if self.swings is None else self.swings.loads

    @cached_property
    def used(self) -> FloatArray:
        """(T, X, K) bool: which samples are compared."""
        return np.stack([grid.used for grid in self.grids])

    @cached_property
    def measured(self) -> FloatArray:
        """(T, X, K), NaN where a sample was lost."""
        return np.stack([grid.measured for grid in self.grids])

    @cached_property
    def of_samples(self) -> NDArray[np.bool_]:
        """(N,) which residuals, move after move, are the accelerometer's samples; the others are the motors'."""
        return np.concatenate([kind for of_move in self._kinds for kind in of_move])

    @cached_property
    def ends(self) -> NDArray[np.int64]:
        """(T + 1,) where the residuals of the moves begin and end."""
        return np.cumsum([0, *(sum(len(kind) for kind in of_move) for of_move in self._kinds)])

    @property
    def _kinds(self) -> list[tuple[FloatArray, FloatArray]]:
        motors = self.motors or [()] * len(self.grids)
        return [
            (np.ones(int(np.sum(used)), dtype=bool), np.zeros(sum(len(m.weight) for m in own), dtype=bool))
            for used, own in zip(self.used, motors, strict=True)
        ]


def sensor_zero(trace: Trace, recording: Recording, noise: float) -> float:
    """What the sensor says at rest [m/s²]. Where something swings in the rests, it is the mean of the whole recording:
    an axis that stands at its beginning and at its end has no mean acceleration."""
    parts = [trace.between(move.start - 0.15, move.start).value for move in recording.moves]
    spread = np.median([float(np.std(part)) for part in parts if len(part) > 10] or [0.0])
    if spread < STILL * noise:
        return bias_at_rest(trace, recording.moves)
    length = float(trace.time[-1] - trace.time[0])
    return float(np.trapezoid(trace.value, trace.time)) / length


def drives_of(recording: Recording, axes: Sequence[str]) -> dict[tuple[str, str], tuple[Trace, float]]:
    """Speeds and torques of the axes' drives, where recorded, each with the noise of a sample."""
    keys = [(a, c) for a in axes for c in ("motor_speed", "motor_torque") if (a, c) in recording.traces]
    return {key: (recording.traces[key], sample_noise(recording.traces[key], recording)) for key in keys}


def with_drives_averaged(
    recording: Recording, axes: Sequence[str]
) -> tuple[Recording, tuple[FloatArray, ...]]:
    """The recording with what the axes' drives do alike in several moves told from noise; and what is left of the noise
    of every axis' speed."""
    traces, left = dict(recording.traces), {}
    for key, (trace, noise) in drives_of(recording, axes).items():
        traces[key], left[key] = averaged_over(trace, recording.moves, noise, TAIL)
    return replace(recording, traces=traces), tuple(left[a, "motor_speed"] for a in axes)


def moves_of(
    recording: Recording, axes: Sequence[str], tail: float = 0.0, *, averaged: bool = False
) -> Moves:
    """The grids, the noise and the plain motor motion of all moves of a recording, each until `tail` [s] after its
    end; with `averaged` by what the drives do alike in several moves."""
    noise_left = tuple(np.ones(len(recording.traces[a, "motor_speed"])) for a in axes)
    alike = made_alike(recording.moves, list(drives_of(recording, axes).values()), tail)
    if averaged:
        recording, noise_left = with_drives_averaged(recording, axes)
    traces = [acceleration_of(recording, axis) for axis in axes]
    h = sample_period(traces[0])
    noise = np.array([noise_at_rest(trace, recording) for trace in traces])
    bias = np.array(
        [sensor_zero(trace, recording, float(sigma)) for trace, sigma in zip(traces, noise, strict=True)]
    )
    plain, off = motors_of(recording, axes)
    K = int(np.ceil((max(m.duration for m in recording.moves) + LEAD + tail) / h)) + 1
    zero = float(traces[0].time[0])
    grids = []
    for index, move in enumerate(recording.moves):
        start = zero + (np.floor((move.start - LEAD - zero) / h) - 0.5) * h
        measured = np.stack([on_grid(trace, start, h, K) for trace in traces]) - bias[:, None]
        during = [on_grid(trace.between(move.start, move.end + tail), start, h, K) for trace in traces]
        grids.append(StepGrid(index, move.direction, start, h, measured, np.isfinite(np.stack(during))))
    motion = tuple(plain for _ in grids)
    expected = np.ones((len(grids), len(axes), K))
    rest = np.tile(bias, (len(grids), 1))
    return Moves(
        recording,
        tuple(axes),
        noise,
        tuple(grids),
        plain,
        noise_left,
        motion,
        rest,
        expected,
        apart=min(1.0, float(np.linalg.norm(off)) / WANDERING),
        alike=alike,
    )
