"""In the guest: error states and unplugging, on a real can0 whose adapter is this test (slcan on a pty).

The kernel's slcan turns what the adapter reports - ``s``, the state, both error counters - into the same error
frames as any controller's driver does.
"""

from __future__ import annotations

import fcntl
import os
import pty
import struct
import termios
import threading
import tty
from collections.abc import Iterator
from contextlib import contextmanager, suppress

import pytest

from drivers.bus import Bus, BusConfig
from drivers.errorframes import BusState
from drivers.errors import BusLost, BusOff
from tests.socketcan.inside import eventually, set_link

N_SLCAN = 17
CHANNEL = "can0"
CONFIG = BusConfig("socketcan", CHANNEL, master_node_id=None, reopen_interval=0.05)

PASSIVE, ACTIVE, WARNING, OFF = b"sp128005\r", b"sa000000\r", b"sw096000\r", b"sb000256\r"


class Adapter:
    """A serial CAN adapter: says what it is told to say, remembers what it heard."""

    def __init__(self) -> None:
        self._master, self._line = pty.openpty()
        tty.setraw(self._line)
        self.heard = b""
        self._thread = threading.Thread(target=self._listen, name="adapter")
        self._thread.start()
        fcntl.ioctl(self._line, termios.TIOCSETD, struct.pack("i", N_SLCAN))
        set_link(CHANNEL, "up")

    def say(self, words: bytes) -> None:
        os.write(self._master, words)

    def unplug(self) -> None:
        if self._line >= 0:
            os.close(self._line)
            self._line = -1
            self._thread.join()
            os.close(self._master)

    def _listen(self) -> None:
        with suppress(OSError):  # the line was closed
            while chunk := os.read(self._master, 256):
                self.heard += chunk


@contextmanager
def plugged_in() -> Iterator[Adapter]:
    adapter = Adapter()
    try:
        yield adapter
    finally:
        adapter.unplug()


@pytest.fixture
def adapter() -> Iterator[Adapter]:
    with plugged_in() as found:
        yield found


def test_frames_go_both_ways(adapter: Adapter) -> None:
    with Bus(CONFIG) as bus, bus.recording() as recorder:
        adapter.say(b"t1853010203\r")
        assert eventually(lambda: bus.health.received == 1)
        assert recorder.frames().payload[0, :3].tolist() == [1, 2, 3]
        bus.send(0x205, b"\xab\xcd")
        assert eventually(lambda: adapter.heard == b"t2052ABCD\r")


def test_error_counters_lead_through_warning_to_passive_and_back(adapter: Adapter) -> None:
    with Bus(CONFIG) as bus:
        for words, state in (
            (WARNING, BusState.WARNING),
            (PASSIVE, BusState.PASSIVE),
            (ACTIVE, BusState.ACTIVE),
        ):
            adapter.say(words)
            assert eventually(lambda state=state: bus.health.state is state), bus.health
            bus.check()
        assert bus.health.error_frames >= 3


def test_bus_off_is_raised_although_the_socket_would_still_send(adapter: Adapter) -> None:
    with Bus(CONFIG) as bus:
        adapter.say(OFF)
        assert eventually(lambda: bus.health.state is BusState.OFF), bus.health
        for failing in (bus.check, lambda: bus.send(0x1, b""), lambda: bus.wait_until(lambda: False, 5.0)):
            with pytest.raises(BusOff, match="What to do"):
                failing()


def test_bus_off_is_over_once_the_interface_went_down_and_up(adapter: Adapter) -> None:
    with Bus(CONFIG) as bus:
        adapter.say(OFF)
        assert eventually(lambda: bus.health.state is BusState.OFF)
        set_link(CHANNEL, "down")
        assert eventually(lambda: bus.health.receive_errors == 1)
        set_link(CHANNEL, "up")
        assert eventually(lambda: bus.health.reopened == 1)
        bus.check()
        assert bus.health.state is BusState.ACTIVE
        adapter.say(b"t1800\r")
        assert eventually(lambda: bus.health.received >= 2)
        bus.send(0x1, b"")
        assert eventually(lambda: adapter.heard.endswith(b"t0010\r"))


def test_a_bus_that_was_off_before_it_was_opened_is_off(adapter: Adapter) -> None:
    """No error frame tells it: the controller fell silent at noon, the run begins at night."""
    with Bus(CONFIG) as bus:
        adapter.say(OFF)
        assert eventually(lambda: bus.health.state is BusState.OFF)
    with Bus(CONFIG) as bus, pytest.raises(BusOff, match="What to do"):
        bus.check()


def test_an_adapter_pulled_out_and_plugged_in_again(adapter: Adapter) -> None:
    with Bus(CONFIG) as bus:
        adapter.say(b"t1800\r")
        assert eventually(lambda: bus.health.received == 1)
        adapter.unplug()
        assert eventually(lambda: bus.health.receive_errors == 1)
        with pytest.raises(BusLost, match="What to do"):
            bus.check()
        with plugged_in() as again:
            assert eventually(lambda: bus.health.reopened == 1)
            again.say(b"t1810\r")
            assert eventually(lambda: bus.health.received == 2)
