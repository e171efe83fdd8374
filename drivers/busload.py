"""How full a bus will be, before anything is opened.

A classical frame with an 11-bit id has 44 bits beside its data and 3 bits of space behind; after five equal
bits the controller stuffs one, at worst one in four of the 34 + 8 n - 1 bits that are subject to it (R. I.
Davis et al., Controller Area Network (CAN) schedulability analysis, Real-Time Systems 35, 2007, eq. (1)). 8
bytes: 135 bits.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from drivers.errors import BusOverloaded

LIMIT = 0.70
"""Above it, frames of low priority wait too long and there is no room for SDO and retries."""


@dataclass(frozen=True)
class CyclicFrame:
    """A frame that comes regularly: `rate` [1/s], `length` of its payload [bytes]."""

    name: str
    rate: float
    length: int


def frame_bits(length: int) -> int:
    """Bits on the wire of a frame with `length` data bytes and an 11-bit id, worst-case stuffing."""
    subject = 34 + 8 * length
    return subject + 10 + (subject - 1) // 4 + 3


def bus_load(frames: Iterable[CyclicFrame], bitrate: int) -> float:
    """Share of the wire's time that the frames take at worst; above 1 it is impossible."""
    return sum(frame.rate * frame_bits(frame.length) for frame in frames) / bitrate


def require_bus_load(frames: Iterable[CyclicFrame], bitrate: int, limit: float = LIMIT) -> float:
    """The load; BusOverloaded with the largest contributors when it exceeds `limit`."""
    frames = sorted(frames, key=lambda f: -f.rate * frame_bits(f.length))
    load = bus_load(frames, bitrate)
    if load > limit:
        largest = ", ".join(f"{f.name} {f.rate * frame_bits(f.length) / bitrate:.0%}" for f in frames[:4])
        raise BusOverloaded(
            f"the configured frames take {load:.0%} of {bitrate / 1000:.0f} kbit/s, "
            f"at most {limit:.0%} is allowed ({largest})"
        )
    return load


def drive_frames(
    name: str, *, sync_period: float, sync_producer: bool, heartbeat_period: float
) -> tuple[CyclicFrame, ...]:
    """What one drive puts on the bus: TPDO1, heartbeat, and SYNC where it produces it."""
    own = (
        CyclicFrame(f"{name} TPDO1", 1 / sync_period, 8),
        CyclicFrame(f"{name} heartbeat", 1 / heartbeat_period, 1),
    )
    return (*own, CyclicFrame("SYNC", 1 / sync_period, 1)) if sync_producer else own


def accelerometer_frames(
    name: str, *, sample_rate: float, samples_per_frame: int = 3
) -> tuple[CyclicFrame, ...]:
    """What one accelerometer puts on the bus: data frames, and ten time frames a second."""
    data = CyclicFrame(f"{name} data", sample_rate / samples_per_frame, 8)
    return data, CyclicFrame(f"{name} time", 10.0, 8)
