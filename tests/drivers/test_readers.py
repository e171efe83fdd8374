"""The SocketCAN reader on a UDP socket, which knows the same time stamps and the same count of drops."""

from __future__ import annotations

import socket
import struct
import time
from collections.abc import Iterator

import can
import pytest

from drivers.errorframes import ERROR_FLAG, EXTENDED_FLAG, REMOTE_FLAG
from drivers.readers import BATCH, MessageReader, SocketReader

FRAME = struct.Struct("=IB3x8s")


@pytest.fixture
def wire() -> Iterator[tuple[socket.socket, socket.socket]]:
    """Sender and receiver."""
    receiver = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    receiver.bind(("127.0.0.1", 0))
    sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sender.connect(receiver.getsockname())
    yield sender, receiver
    sender.close()
    receiver.close()


def test_kernel_frames_by_their_bytes(wire: tuple[socket.socket, socket.socket]) -> None:
    sender, receiver = wire
    reader = SocketReader(receiver, 1 << 20)
    before = time.time()  # the kernel stamps frames with the wall clock
    sender.send(bytes.fromhex("85010000 08 000000 0102030405060708"))
    sender.send(FRAME.pack(0x80, 1, b"\x07"))
    sender.send(FRAME.pack(0x40 | ERROR_FLAG, 8, b""))
    frames = reader.read(1.0)
    while len(frames) < 3:
        frames += reader.read(1.0)
    assert [(can_id, data) for _, can_id, data in frames] == [
        (0x185, bytes(range(1, 9))),
        (0x80, b"\x07"),
        (0x40 | ERROR_FLAG, bytes(8)),
    ]
    assert all(before - 1 <= at <= before + 60 for at, _, _ in frames)


def test_nothing_there_is_an_empty_batch(wire: tuple[socket.socket, socket.socket]) -> None:
    assert SocketReader(wire[1], 1 << 20).read(0.0) == []


def test_a_batch_has_an_end_and_nothing_is_lost_over_it(wire: tuple[socket.socket, socket.socket]) -> None:
    sender, receiver = wire
    reader = SocketReader(receiver, 8 << 20)
    for k in range(BATCH + 20):
        sender.send(FRAME.pack(k, 0, b""))
    frames = reader.read(1.0)
    assert len(frames) <= BATCH
    while len(frames) < BATCH + 20:
        frames += reader.read(1.0)
    assert [can_id for _, can_id, _ in frames] == list(range(BATCH + 20))


def test_what_the_kernel_had_no_room_for_is_counted(wire: tuple[socket.socket, socket.socket]) -> None:
    sender, receiver = wire
    reader = SocketReader(receiver, 4096)
    for k in range(500):
        sender.send(FRAME.pack(k, 0, b""))
    got = len(reader.read(1.0))
    sender.send(FRAME.pack(0x7FF, 0, b""))
    while (batch := reader.read(0.2)) and batch[-1][1] != 0x7FF:
        got += len(batch)
    assert reader.dropped > 0
    assert got + reader.dropped >= 500


def test_a_closed_socket_is_an_error(wire: tuple[socket.socket, socket.socket]) -> None:
    reader = SocketReader(wire[1], 4096)
    wire[1].close()
    with pytest.raises((OSError, ValueError)):
        reader.read(0.0)


def test_messages_carry_the_kernels_flags() -> None:
    with (
        can.Bus(interface="virtual", channel="readers", preserve_timestamps=True) as sender,
        can.Bus(interface="virtual", channel="readers") as receiver,
    ):
        sender.send(can.Message(arbitration_id=0x80, data=b"\x01", is_extended_id=False, timestamp=2.5))
        sender.send(can.Message(arbitration_id=0x18FF, is_extended_id=True))
        sender.send(can.Message(arbitration_id=0x705, is_extended_id=False, is_remote_frame=True))
        sender.send(
            can.Message(arbitration_id=0x40, is_extended_id=False, is_error_frame=True, data=bytes(8))
        )
        frames = MessageReader(receiver).read(1.0)
    assert frames[0] == (2.5, 0x80, b"\x01")
    assert [f[1] for f in frames[1:]] == [0x18FF | EXTENDED_FLAG, 0x705 | REMOTE_FLAG, 0x40 | ERROR_FLAG]
