"""Traces, and the recorder that the receive loop fills.

In the loop a frame is packed and appended, 21 bytes, nothing else. Decoding happens once, afterwards, with
numpy, and the moves' times decide what is cut out, never the moment at which somebody asked.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
ByteArray = NDArray[np.uint8]

Frame = tuple[float, int, bytes]
"""(bus time [s], CAN id with the kernel's flag bits, payload)."""

FRAME_DTYPE = np.dtype([("time", "<f8"), ("can_id", "<u4"), ("length", "u1"), ("data", "u1", (8,))])
_pack = struct.Struct("<dIB8s").pack


@dataclass(frozen=True)
class Trace:
    """Samples of one channel in order of time.

    Attributes
    ----------
    time : (n,) float64, strictly increasing [s], bus time
    value : (n,) float64, SI
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
class Frames:
    """Recorded frames in order of arrival, as one structured array of ``FRAME_DTYPE``, shape (n,)."""

    table: NDArray[np.void]

    def __len__(self) -> int:
        return len(self.table)

    @property
    def time(self) -> FloatArray:
        """Receive time of each frame [s], shape (n,)."""
        return np.ascontiguousarray(self.table["time"])

    @property
    def can_id(self) -> NDArray[np.uint32]:
        """CAN id with flag bits, shape (n,)."""
        return np.ascontiguousarray(self.table["can_id"])

    @property
    def payload(self) -> ByteArray:
        """Payload, padded with zeros, shape (n, 8)."""
        return np.ascontiguousarray(self.table["data"])

    def of(self, can_id: int, length: int = 0) -> Frames:
        """The frames of one id that carry at least `length` bytes."""
        chosen = (self.table["can_id"] == can_id) & (self.table["length"] >= length)
        return Frames(self.table[chosen])

    def between(self, start: float, end: float) -> Frames:
        """Frames received in start <= time < end [s]; receive times need not be in order."""
        time = self.table["time"]
        return Frames(self.table[(time >= start) & (time < end)])


class Recorder:
    """Collects every frame of a bus, and apart from them those we sent; read by anybody."""

    def __init__(self) -> None:
        self._records = bytearray()
        self._sent = bytearray()
        self._latest = -np.inf

    def append(self, batch: Sequence[Frame]) -> None:
        """Take a batch over; called by the receive loop only."""
        self._records += b"".join([_pack(time, can_id, len(data), data) for time, can_id, data in batch])
        self._latest = batch[-1][0]

    def append_sent(self, can_id: int, data: bytes) -> None:
        """Note a frame that we sent, at the time of the last one received; from any thread."""
        self._sent += _pack(self._latest, can_id, len(data), data)

    @property
    def latest(self) -> float:
        """Bus time of the last frame [s]; -inf before the first."""
        return float(self._latest)

    def __len__(self) -> int:
        return len(self._records) // FRAME_DTYPE.itemsize

    def frames(self) -> Frames:
        """Everything so far. A copy: the loop may go on appending."""
        return Frames(np.frombuffer(bytes(self._records), dtype=FRAME_DTYPE))

    def sent(self) -> Frames:
        """What we sent so far; -inf stands for the time of what was sent before anything was received."""
        return Frames(np.frombuffer(bytes(self._sent), dtype=FRAME_DTYPE))
