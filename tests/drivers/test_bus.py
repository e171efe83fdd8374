"""The receive loop: what it survives, what it counts, and when it falls silent."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

import can
import canopen
import pytest

from drivers.bus import Bus, BusConfig, open_python_can
from drivers.errorframes import BusState, describe, state_after
from drivers.errors import BusLost, BusNotOpened, BusOff, BusOverloaded, BusSilent

CHANNEL = "test_bus"
CONFIG = BusConfig("virtual", CHANNEL, machine_time=True, master_node_id=None, reopen_interval=0.01)


def eventually(condition: Callable[[], bool], patience: float = 10.0) -> bool:
    """Wait for a condition on real time."""
    end = time.monotonic() + patience
    while not (found := condition()) and time.monotonic() < end:
        time.sleep(0.002)
    return found


def frame(can_id: int, data: bytes = b"", at: float = 0.0, *, error: bool = False) -> can.Message:
    return can.Message(
        arbitration_id=can_id, data=data, timestamp=at, is_extended_id=False, is_error_frame=error
    )


@pytest.fixture
def other() -> Iterator[can.BusABC]:
    """The other end of the wire."""
    with can.Bus(interface="virtual", channel=CHANNEL, preserve_timestamps=True) as end:
        yield end


class Fragile:
    """Opens virtual buses that can be broken: `broken` = receiving fails once, `absent` = so does opening."""

    def __init__(self) -> None:
        self.broken = self.absent = self.full = False
        self.error: Exception = can.CanOperationError("Failed to receive: Network is down", 100)
        self.opened: list[can.BusABC] = []

    def __call__(self, config: BusConfig) -> can.BusABC:
        if self.absent:
            raise BusNotOpened("there is no such interface")
        bus = open_python_can(config)
        recv, send = bus.recv, bus.send

        def fragile_recv(timeout: float | None = None) -> can.Message | None:
            if self.broken:
                self.broken = False
                raise self.error
            return recv(timeout)

        def fragile_send(message: can.Message, timeout: float | None = None) -> None:
            if self.full:
                raise can.CanOperationError("Failed to transmit: No buffer space available", 105)
            send(message, timeout)

        bus.recv, bus.send = fragile_recv, fragile_send  # type: ignore[method-assign]
        self.opened.append(bus)
        return bus


def test_frames_reach_handlers_recorders_and_canopen(other: can.BusABC) -> None:
    seen: list[tuple[float, int, bytes]] = []
    with Bus(CONFIG) as bus, bus.recording() as recorder:
        bus.subscribe(0x185, lambda *frame: seen.append(frame))
        node = canopen.RemoteNode(5, canopen.ObjectDictionary())
        bus.network.add_node(node)
        other.send(frame(0x705, b"\x05", 1.0))
        other.send(frame(0x185, b"abc", 1.5))
        assert eventually(lambda: bus.health.received == 2)
        assert seen == [(1.5, 0x185, b"abc")]
        assert node.nmt.state == "OPERATIONAL"
        assert recorder.frames().can_id.tolist() == [0x705, 0x185]
        assert bus.time == 1.5


def test_nothing_is_recorded_outside_and_nobody_called_after_unsubscribing(other: can.BusABC) -> None:
    seen: list[int] = []

    def handler(_: float, can_id: int, __: bytes) -> None:
        seen.append(can_id)

    with Bus(CONFIG) as bus:
        bus.subscribe(1, handler)
        bus.unsubscribe(1, handler)
        with bus.recording() as recorder:
            pass
        other.send(frame(1))
        assert eventually(lambda: bus.health.received == 1)
        assert (seen, len(recorder)) == ([], 0)


def test_a_receive_error_is_survived_and_the_bus_opened_again(other: can.BusABC) -> None:
    fragile = Fragile()
    seen: list[bytes] = []
    with Bus(CONFIG, fragile) as bus:
        bus.subscribe(0x10, lambda _, __, data: seen.append(data))
        other.send(frame(0x10, b"1"))
        assert eventually(lambda: seen == [b"1"])
        fragile.absent = fragile.broken = True
        assert eventually(lambda: bus.health.receive_errors == 1)
        with pytest.raises(BusLost, match=r"lost.*What to do"):
            bus.check()
        with pytest.raises(BusLost):
            bus.send(0x20, b"")
        with pytest.raises(BusLost):
            bus.wait_until(lambda: False, 5.0)
        fragile.absent = fragile.broken = False
        assert eventually(lambda: bus.health.reopened == 1)
        other.send(frame(0x10, b"2"))
        assert eventually(lambda: seen == [b"1", b"2"])
        bus.check()
    assert len(fragile.opened) == 2


def test_errors_that_are_no_can_errors_are_survived_as_well(other: can.BusABC) -> None:
    fragile = Fragile()
    with Bus(CONFIG, fragile) as bus:
        fragile.error, fragile.broken = ZeroDivisionError("division by zero"), True
        assert eventually(lambda: bus.health.reopened == 1)
        assert "division" in bus.health.last_error


def test_a_handler_that_fails_stops_neither_the_loop_nor_its_neighbours(
    other: can.BusABC, caplog: pytest.LogCaptureFixture
) -> None:
    seen: list[int] = []
    with Bus(CONFIG) as bus:
        bus.subscribe(0x10, lambda *_: seen.append(1 // 0))
        bus.subscribe(0x11, lambda *_: seen.append(11))
        other.send(frame(0x10))
        other.send(frame(0x11))
        assert eventually(lambda: seen == [11])
        assert bus.health.handler_errors == 1
    assert "handler of frame 0x10" in caplog.text


def test_bus_off_is_seen_although_sending_would_still_succeed(other: can.BusABC) -> None:
    with Bus(CONFIG) as bus:
        other.send(frame(0x04, bytes([0, 0x08, 0, 0, 0, 0, 96, 0]), error=True))
        assert eventually(lambda: bus.health.state is BusState.WARNING)
        bus.send(0x20, b"")
        other.send(frame(0x40, bytes(8), error=True))
        assert eventually(lambda: bus.health.state is BusState.OFF)
        with pytest.raises(BusOff, match="60 ohm"):
            bus.send(0x20, b"")
        other.send(frame(0x100, bytes(8), error=True))
        assert eventually(lambda: bus.health.state is BusState.ACTIVE)
        bus.send(0x20, b"")
        assert bus.health.error_frames == 3


@pytest.mark.parametrize(
    ("can_id", "data", "state"),
    [
        (0x04, "00 10 00 00 00 00 00 00", BusState.PASSIVE),
        (0x04, "00 20 00 00 00 00 00 00", BusState.PASSIVE),
        (0x04, "00 04 00 00 00 00 00 00", BusState.WARNING),
        (
            0x04,
            "00 01 00 00 00 00 00 00",
            BusState.PASSIVE,
        ),  # an overflow tells nothing about the state before it
        (0x04, "00 40 00 00 00 00 00 00", BusState.ACTIVE),
        (0x88, "00 00 04 19 00 00 00 00", BusState.PASSIVE),
        (0x40, "00 00 00 00 00 00 00 00", BusState.OFF),
    ],
)
def test_error_frames_by_their_bytes(can_id: int, data: str, state: BusState) -> None:
    assert state_after(BusState.PASSIVE, can_id, bytes.fromhex(data)) is state


def test_error_frames_in_words() -> None:
    assert describe(0x20, bytes(8)) == "no acknowledge: no other node listens"
    assert describe(0x04, bytes([0, 1])) == "controller, buffer overflow"
    assert "0x00000400" in describe(0x400, b"")


def test_a_full_transmit_queue_is_no_lost_bus(other: can.BusABC) -> None:
    fragile = Fragile()
    with Bus(CONFIG, fragile) as bus:
        fragile.full = True
        with pytest.raises(BusOverloaded, match="could not be sent"):
            bus.send(0x20, b"")


def test_an_interface_that_is_not_there_says_what_to_do() -> None:
    with pytest.raises(BusNotOpened, match=r"socketcan can99 .*ip link set can0 up type can bitrate"):
        Bus(BusConfig("socketcan", "can99")).open()


def test_closing_twice_and_using_a_closed_bus() -> None:
    bus = Bus(CONFIG).open()
    bus.close()
    bus.close()
    with pytest.raises(BusLost, match=r"never opened|lost"):
        bus.send(0x20, b"")


def test_waiting_ends_by_machine_time_not_by_the_wall(other: can.BusABC) -> None:
    with Bus(CONFIG) as bus:
        other.send(frame(0x80, at=100.0))
        assert eventually(lambda: bus.time == 100.0)
        bus.subscribe(0x20, lambda *_: other.send(frame(0x80, at=bus.time + 50.0)))
        began = time.monotonic()
        asked = iter(range(1000))

        def never() -> bool:
            other.send(frame(0x80, at=100.0 + 10.0 * next(asked)))
            return False

        assert not bus.wait_until(never, 60.0)
        assert time.monotonic() - began < 30.0


def test_waiting_on_a_silent_bus_says_so(other: can.BusABC) -> None:
    with Bus(CONFIG) as bus, pytest.raises(BusSilent, match="no frame for"):
        bus.wait_until(lambda: False, 1e9, silence=0.05)


class Heartbeats:
    """Counts what the other end hears of the master."""

    def __init__(self, end: can.BusABC) -> None:
        self.end, self.count, self.data = end, 0, set[bytes]()

    def more(self) -> bool:
        before = self.count
        while (message := self.end.recv(0)) is not None:
            if message.arbitration_id == 0x77F:
                self.count += 1
                self.data.add(bytes(message.data))
        return self.count > before


def test_the_heartbeat_ceases_when_the_supervisor_does(other: can.BusABC) -> None:
    config = BusConfig("virtual", CHANNEL, heartbeat_period=0.01, supervisor_patience=0.1)
    heard = Heartbeats(other)
    with Bus(config) as bus:
        for _ in range(3):
            bus.feed()
            assert eventually(heard.more)
        assert heard.data == {b"\x05"}
        time.sleep(0.5)
        heard.more()
        time.sleep(0.1)
        assert not heard.more()
        bus.feed()
        assert eventually(heard.more)


def test_the_heartbeat_keeps_up_with_a_machine_faster_than_the_wall(other: can.BusABC) -> None:
    config = BusConfig(
        "virtual", CHANNEL, machine_time=True, heartbeat_period=1000.0, supervisor_patience=1e9
    )
    heard = Heartbeats(other)
    with Bus(config):
        assert eventually(heard.more)
        for k in range(1, 4):
            other.send(frame(0x80, at=1000.0 * k))
            assert eventually(heard.more)
        other.send(frame(0x80, at=3001.0))
        time.sleep(0.1)
        assert not heard.more()


def test_the_heartbeat_goes_on_after_a_lost_bus(other: can.BusABC) -> None:
    fragile = Fragile()
    config = BusConfig(
        "virtual", CHANNEL, heartbeat_period=0.01, supervisor_patience=1e9, reopen_interval=0.01
    )
    heard = Heartbeats(other)
    with Bus(config, fragile) as bus:
        assert eventually(heard.more)
        fragile.broken = fragile.absent = True
        assert eventually(lambda: bus.health.receive_errors >= 1)
        heard.more()
        time.sleep(0.05)
        assert not heard.more()
        fragile.broken = fragile.absent = False
        assert eventually(heard.more)
