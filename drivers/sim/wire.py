"""The machine's plug on one virtual bus: frames with machine time stamps, as a wire of that bit rate brings them.

Time stamps are those a receiver would take: the end of the frame, frames one after the other, in the order
in which they became ready. Priorities and the load of the master's own few frames are left out.
"""

from __future__ import annotations

import queue
from collections.abc import Iterable
from operator import itemgetter

from can import Message
from can.interfaces.virtual import VirtualBus

Frame = tuple[float, int, bytes]
"""Machine time at which it is ready to be sent [s], CAN identifier, payload."""

DEAF = 65536
"""Frames beyond which a receiver's queue takes no more; chosen: about 20 s of a single axis, 15 MB."""


class Wire:
    """Sends blocks of frames, receives frames one by one, and sees how far its listeners are behind."""

    def __init__(self, channel: str, bitrate: int = 1_000_000) -> None:
        self._bus = VirtualBus(channel=channel, preserve_timestamps=True)
        self._channel = channel
        self._bit = 1.0 / bitrate
        self._pending: list[Frame] = []
        self._free_at = 0.0
        self.frames_sent = self.frames_lost = 0

    def close(self) -> None:
        self._bus.shutdown()

    def receive(self, timeout: float = 0.0) -> tuple[int, bytes] | None:
        """Identifier and payload of the next data frame from others; None if none came within ``timeout`` [s]."""
        message = self._bus.recv(timeout)
        if message is None or message.is_error_frame or message.is_remote_frame:
            return None
        return message.arbitration_id, bytes(message.data)

    @property
    def _listeners(self) -> list[queue.Queue[Message]]:
        return [q for q in list(self._bus.channel) if q is not self._bus.queue]

    @property
    def heard(self) -> bool:
        """Whether anybody else is on the bus."""
        return len(self._bus.channel) > 1

    @property
    def backlog(self) -> int:
        """Frames that the slowest listener has not yet taken."""
        return max((q.qsize() for q in self._listeners), default=0)

    def send_now(self, frames: Iterable[Frame]) -> None:
        """Send answers that take no time on the machine's clock."""
        self._deliver([(max(time, self._free_at), can_id, data) for time, can_id, data in frames])

    def queue(self, frames: Iterable[Frame]) -> None:
        """Take frames that become ready at their time."""
        self._pending.extend(frames)

    def flush(self, until: float) -> None:
        """Send what became ready before ``until`` [s], the rest later."""
        self._pending.sort(key=itemgetter(0))
        split = next((k for k, frame in enumerate(self._pending) if frame[0] >= until), len(self._pending))
        due, self._pending = self._pending[:split], self._pending[split:]
        self._deliver([self._transmitted(frame) for frame in due])

    def _transmitted(self, frame: Frame) -> Frame:
        ready, can_id, data = frame
        self._free_at = max(ready, self._free_at) + _bits(len(data)) * self._bit
        return self._free_at, can_id, data

    def _deliver(self, frames: list[Frame]) -> None:
        """Put a block into every listener's queue under one lock and with one wake-up.

        ``VirtualBus.send`` deep-copies each frame and wakes the reader for it, which costs ten times as much.
        """
        self.frames_sent += len(frames)
        for listener in self._listeners:
            room = max(0, DEAF - listener.qsize())
            self.frames_lost += max(0, len(frames) - room)
            messages = [self._message(frame) for frame in frames[:room]]
            with listener.mutex:
                listener.queue.extend(messages)
                listener.unfinished_tasks += len(messages)
                listener.not_empty.notify()

    def _message(self, frame: Frame) -> Message:
        time, can_id, data = frame
        return Message(time, can_id, is_extended_id=False, channel=self._channel, data=data)


def _bits(length: int) -> float:
    """Bits of a data frame with 11-bit identifier on the wire: half of the worst-case stuffing, interframe space."""
    return 47 + 8 * length + (33 + 8 * length) / 8
