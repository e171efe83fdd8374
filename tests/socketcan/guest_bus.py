"""In the guest: the receive loop on vcan0 - what it reads, what it survives, what it counts."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace

import can
import pytest

from drivers.bus import Bus, BusConfig
from drivers.errors import BusLost, BusNotOpened
from drivers.readers import BATCH
from tests.socketcan.inside import eventually, set_link

CONFIG = BusConfig("socketcan", "vcan0", master_node_id=None, reopen_interval=0.05)


def frame(can_id: int, data: bytes = b"") -> can.Message:
    return can.Message(arbitration_id=can_id, data=data, is_extended_id=False)


@pytest.fixture
def other() -> Iterator[can.BusABC]:
    """The other end of the wire."""
    with can.Bus(interface="socketcan", channel="vcan0") as end:
        yield end


def test_frames_arrive_with_the_kernels_time(other: can.BusABC) -> None:
    seen: list[tuple[float, int, bytes]] = []
    with Bus(CONFIG) as bus, bus.recording() as recorder:
        bus.subscribe(0x185, lambda *frame: seen.append(frame))
        before = time.time()
        other.send(frame(0x185, b"\x01\x02\x03"))
        time.sleep(0.05)
        other.send(frame(0x080, b"\x07"))
        assert eventually(lambda: bus.health.received == 2)
        after = time.time()
        assert [(can_id, data) for _, can_id, data in seen] == [(0x185, b"\x01\x02\x03")]
        first, second = recorder.frames().time
        assert before <= first <= after
        assert 0.045 < second - first < 1.0
        assert bus.time == second


def test_what_the_master_sends_is_on_the_wire_and_does_not_come_back(other: can.BusABC) -> None:
    with Bus(CONFIG) as bus:
        bus.send(0x205, bytes(range(6)))
        message = other.recv(5.0)
        assert message is not None
        assert (message.arbitration_id, bytes(message.data)) == (0x205, bytes(range(6)))
        other.send(frame(0x1))
        assert eventually(lambda: bus.health.received > 0)
        assert bus.health.received == 1


def test_a_burst_larger_than_the_kernels_default_buffer_is_read_whole(other: can.BusABC) -> None:
    """The default holds 278 frames; the loop is held up while ten times as many come."""
    count = 10 * BATCH
    with Bus(CONFIG) as bus, bus.recording() as recorder:
        bus.subscribe(0x7F0, lambda *_: time.sleep(1.0))
        other.send(frame(0x7F0))
        for k in range(count):
            other.send(frame(0x100, k.to_bytes(2, "little")))
        assert eventually(lambda: bus.health.received == count + 1)
        assert bus.health.dropped == 0
        numbers = recorder.frames().of(0x100).payload[:, :2].copy().view("<u2")[:, 0]
        assert numbers.tolist() == list(range(count))


def test_frames_that_the_kernel_threw_away_are_counted_exactly(other: can.BusABC) -> None:
    count = 1000
    with Bus(replace(CONFIG, receive_buffer_bytes=4096)) as bus:
        bus.subscribe(0x7F0, lambda *_: time.sleep(0.5))
        other.send(frame(0x7F0))
        for _ in range(count):
            other.send(frame(0x100))
        time.sleep(1.0)
        other.send(frame(0x7FF))  # the count comes with the next frame that was received
        assert eventually(lambda: bus.health.dropped > 0)
        assert eventually(lambda: bus.health.received + bus.health.dropped == count + 2)


def test_an_interface_that_went_down_is_lost_until_it_is_up_again(other: can.BusABC) -> None:
    with Bus(CONFIG) as bus:
        other.send(frame(0x1))
        assert eventually(lambda: bus.health.received == 1)
        set_link("vcan0", "down")
        try:
            assert eventually(lambda: bus.health.receive_errors > 0)
            for _ in range(40):  # it stays lost, it does not flicker
                with pytest.raises(BusLost, match="What to do"):
                    bus.check()
                time.sleep(0.01)
            assert (bus.health.receive_errors, bus.health.reopened) == (1, 0)
        finally:
            set_link("vcan0", "up")
        assert eventually(lambda: bus.health.reopened == 1)
        bus.check()
        with can.Bus(interface="socketcan", channel="vcan0") as fresh:
            fresh.send(frame(0x2))
            assert eventually(lambda: bus.health.received == 2)
            bus.send(0x3, b"")
            assert fresh.recv(5.0) is not None


def test_an_interface_that_is_down_or_absent_is_not_opened() -> None:
    set_link("vcan0", "down")
    try:
        with pytest.raises(BusNotOpened, match=r"vcan0.*ip link"), Bus(CONFIG):
            pass
    finally:
        set_link("vcan0", "up")
    with pytest.raises(BusNotOpened, match="nosuch0"), Bus(BusConfig("socketcan", "nosuch0")):
        pass
