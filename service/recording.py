"""The recorded run in memory: what the drives and the sensors said, and which moves were commanded.

Plain data that every floor of the service may import; it imports nothing but numpy. On disk the same
thing is a capture (``service.captures``). Inside everything is SI and positive is positive travel.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

Motion = Literal["linear", "rotary"]

CHANNELS = (
    "motor_speed",
    "motor_position",
    "motor_torque",
    "acceleration",
    "load_position",
    "load_speed",
)
"""Channel names of the capture format, version 1."""


@dataclass(frozen=True)
class Trace:
    """Samples of one channel, in order of time.

    Attributes
    ----------
    time : (n,) float64, strictly increasing [s], on the recording's clock
    value : (n,) float64, in the channel's SI unit
    """

    time: FloatArray
    value: FloatArray

    def __len__(self) -> int:
        return len(self.time)

    def between(self, start: float, end: float) -> Trace:
        """Samples with start <= time < end [s]."""
        first, last = np.searchsorted(self.time, (start, end))
        return Trace(self.time[first:last], self.value[first:last])


@dataclass(frozen=True)
class AxisDescription:
    """How an axis is built, as far as reading its channels needs it.

    Attributes
    ----------
    transmission : output per radian of motor [m/rad] (linear) or [rad/rad] (rotary);
        D_p / (2 i) for a rack and pinion
    pinion_diameter : D_p [m], None where there is no pinion
    gear_ratio : i, None where unknown
    rates : nominal sampling rate of each channel [Hz]
    """

    name: str
    transmission: float
    motion: Motion = "linear"
    pinion_diameter: float | None = None
    gear_ratio: float | None = None
    rates: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Move:
    """One commanded diagnostic step: SL = length [m], j_lim = jerk [m/s³], times [s], direction ±1.

    ``position`` [m] is where the axis stood before it, along the rack; None where the recorder did not say.
    """

    start: float
    direction: int
    length: float
    jerk: float
    duration: float
    position: float | None = None

    @property
    def end(self) -> float:
        return self.start + self.duration


@dataclass(frozen=True)
class Recording:
    """Everything that was recorded in one run.

    Attributes
    ----------
    traces : by (axis name, channel name)
    gantry : pairs of axis names that move one bridge
    moves : every axis of the recording makes every move
    extra : metadata keys that this version does not know, kept as they were
    """

    machine: str
    axes: tuple[AxisDescription, ...]
    traces: Mapping[tuple[str, str], Trace]
    moves: tuple[Move, ...] = ()
    gantry: tuple[tuple[str, str], ...] = ()
    recorded_at: datetime | None = None
    note: str | None = None
    extra: Mapping[str, Any] = field(default_factory=dict)

    def axis(self, name: str) -> AxisDescription:
        """The description of one axis; KeyError when the recording has no such axis."""
        for axis in self.axes:
            if axis.name == name:
                return axis
        raise KeyError(name)

    def trace(self, axis: str, channel: str) -> Trace | None:
        """One channel of one axis, None where it was not recorded."""
        return self.traces.get((axis, channel))

    def moves_without(self, axis: str, channel: str) -> tuple[int, ...]:
        """Indices of the moves during which less than half of a channel's samples are there, by its usual distance."""
        trace = self.traces[axis, channel]
        if len(trace) < 2:
            return tuple(range(len(self.moves)))
        step = float(np.median(np.diff(trace.time)))
        return tuple(
            k
            for k, move in enumerate(self.moves)
            if len(trace.between(move.start, move.end)) < 0.5 * np.floor((move.end - move.start) / step)
        )

    def partner(self, axis: str) -> str | None:
        """The other axis of the gantry that this axis belongs to, None for a single axis."""
        for first, second in self.gantry:
            if axis == first:
                return second
            if axis == second:
                return first
        return None
