"""How frames come out of an opened bus, in batches: one reader for SocketCAN, one for everything else.

The SocketCAN reader takes the socket itself: python-can's ``recv`` costs twice as much per frame, and it
asserts that one control message comes along, which SO_RXQ_OVFL (how many frames the kernel threw away)
breaks.
"""

from __future__ import annotations

import contextlib
import select
import socket
import struct
from typing import Protocol

import can

from drivers.errorframes import ERROR_FLAG, EXTENDED_FLAG, REMOTE_FLAG
from drivers.trace import Frame

BATCH = 256
"""Frames per batch at most. Chosen: 35 ms at 7,400 frames/s; no batch makes the heartbeat late."""

_SO_RCVBUFFORCE = 33
_SO_RXQ_OVFL = 40
_SO_TIMESTAMPNS = 35
_FRAME = struct.Struct("=IB3x8s")
_TIMESPEC = struct.Struct("@qq")
_DROPPED = struct.Struct("=I")
_ANCILLARY = socket.CMSG_SPACE(_TIMESPEC.size) + socket.CMSG_SPACE(_DROPPED.size)


class Reader(Protocol):
    """Takes frames off a bus; `dropped` counts what the kernel had no room for."""

    dropped: int

    def read(self, timeout: float) -> list[Frame]:
        """Wait up to `timeout` [s] for a frame, then take what is there; raises OSError or can.CanError."""


class MessageReader:
    """Reads any python-can bus by its public ``recv``."""

    def __init__(self, bus: can.BusABC) -> None:
        self._recv = bus.recv
        self.dropped = 0

    def read(self, timeout: float) -> list[Frame]:
        """See ``Reader``."""
        batch: list[Frame] = []
        message = self._recv(timeout)
        while message is not None:
            batch.append((message.timestamp, _flagged_id(message), bytes(message.data)))
            message = self._recv(0) if len(batch) < BATCH else None
        return batch


def _flagged_id(message: can.Message) -> int:
    """CAN id with the flag bits of the kernel's frame format."""
    can_id: int = message.arbitration_id
    if message.is_error_frame:
        can_id |= ERROR_FLAG
    if message.is_remote_frame:
        can_id |= REMOTE_FLAG
    if message.is_extended_id:
        can_id |= EXTENDED_FLAG
    return can_id


class SocketReader:
    """Reads the kernel's 16-byte frames, their time stamps and its count of dropped ones."""

    def __init__(self, sock: socket.socket, buffer_bytes: int) -> None:
        self._socket = sock
        self.dropped = 0
        try:
            sock.setsockopt(socket.SOL_SOCKET, _SO_RCVBUFFORCE, buffer_bytes)
        except OSError:
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, buffer_bytes)
        sock.setsockopt(socket.SOL_SOCKET, _SO_RXQ_OVFL, 1)
        sock.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPNS, 1)

    def read(self, timeout: float) -> list[Frame]:
        """See ``Reader``."""
        batch: list[Frame] = []
        if not select.select([self._socket], [], [], timeout)[0]:
            return batch
        with contextlib.suppress(BlockingIOError):
            while len(batch) < BATCH:
                batch.append(self._take())
        return batch

    def _take(self) -> Frame:
        data, ancillary, _, _ = self._socket.recvmsg(_FRAME.size, _ANCILLARY, socket.MSG_DONTWAIT)
        time = 0.0
        for _, kind, value in ancillary:
            if kind == _SO_TIMESTAMPNS:
                seconds, nanoseconds = _TIMESPEC.unpack_from(value)
                time = seconds + nanoseconds * 1e-9
            elif kind == _SO_RXQ_OVFL:
                self.dropped = _DROPPED.unpack_from(value)[0]
        can_id, length, payload = _FRAME.unpack(data)
        return time, can_id, payload[:length]
