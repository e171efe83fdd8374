"""The only place that opens a bus, and the loop that keeps it alive.

python-can's Notifier ends for good at the first receive error. This loop does not: it closes the bus, opens
it again as soon as that works, and counts what happened. It also watches error frames (after bus-off,
sending still reports success), feeds recorders, canopen and other handlers, and sends the master's
heartbeat itself: a program that no longer reads its bus, or whose supervisor hangs, must fall silent, so
that the drives stop (0x6007). ``send_periodic`` would go on for ever in the kernel.

Time on the bus (`bus.time`) is the time stamp of the last frame: physics. Waiting uses the monotonic clock;
only where the time stamps are a simulated machine's time, which runs faster or slower than ours, they are
waited on.
"""

from __future__ import annotations

import contextlib
import logging
import os
import socket
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import can
import canopen
from can.interfaces.socketcan import SocketcanBus

from drivers.errorframes import ERROR_FLAG, BusState, describe, state_after
from drivers.errors import BusLost, BusNotOpened, BusOff, BusOverloaded, BusSilent
from drivers.readers import MessageReader, Reader, SocketReader
from drivers.trace import Frame, Recorder

log = logging.getLogger(__name__)

Handler = Callable[[float, int, bytes], None]
"""Called in the receive loop with (bus time [s], CAN id, payload); must not wait and must not use SDO."""

_ENOBUFS = 105
_POLL = 0.001
_IDLE = 0.02


@dataclass(frozen=True)
class BusConfig:
    """How to open a bus.

    Attributes
    ----------
    interface, channel : python-can's names ("socketcan", "can0"; "virtual", any name)
    bitrate : [bit/s]; SocketCAN has it from `ip link`, here it serves the bus load
    machine_time : on "virtual", keep the sender's time stamps (a simulated machine's time)
    receive_buffer_bytes : socket buffer; the kernel's default holds 278 frames, 35 ms
    master_node_id : node id of the heartbeat that the drives watch; None sends none
    heartbeat_period : of the master [s]
    supervisor_patience : the heartbeat stops when nobody called ``feed`` for so long [s]
    reopen_interval : between attempts to open a lost bus [s]
    """

    interface: str = "socketcan"
    channel: str = "can0"
    bitrate: int = 1_000_000
    machine_time: bool = False
    receive_buffer_bytes: int = 4 << 20
    master_node_id: int | None = 127
    heartbeat_period: float = 0.1
    supervisor_patience: float = 1.0
    reopen_interval: float = 0.5


@dataclass(frozen=True)
class BusHealth:
    """What the receive loop has counted since the bus was opened first."""

    received: int = 0
    dropped: int = 0
    error_frames: int = 0
    receive_errors: int = 0
    handler_errors: int = 0
    reopened: int = 0
    state: BusState = BusState.ACTIVE
    last_error: str = ""


def open_python_can(config: BusConfig) -> can.BusABC:
    """Open the interface with python-can; BusNotOpened says what to do when it cannot be."""
    options: dict[str, Any] = (
        {"preserve_timestamps": config.machine_time} if config.interface == "virtual" else {}
    )
    try:
        if config.interface == "socketcan":
            socket.if_nametoindex(config.channel)  # python-can would leave a socket open over a missing one
        opened = can.Bus(interface=config.interface, channel=config.channel, **options)
    except (can.CanError, OSError, ValueError) as error:
        raise BusNotOpened(f"{config.interface} {config.channel} could not be opened ({error})") from error
    if isinstance(opened, SocketcanBus):
        _require_up(opened, config)
    return opened


def _require_up(opened: SocketcanBus, config: BusConfig) -> None:
    """Refuse an interface that is down: the kernel binds a socket to it and leaves only an error behind."""
    pending = opened.socket.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR)
    if pending:
        opened.shutdown()
        raise BusNotOpened(f"{config.interface} {config.channel} is not usable ({os.strerror(pending)})")


def _state_at_opening(config: BusConfig) -> BusState:
    """OFF where the interface has no carrier: it went bus-off earlier, and no error frame says so again."""
    carrier = Path("/sys/class/net", config.channel, "carrier")
    lost = config.interface == "socketcan" and carrier.is_file() and carrier.read_text().strip() == "0"
    return BusState.OFF if lost else BusState.ACTIVE


class _Network(canopen.Network):
    """canopen on a bus that somebody else reads: frames come in by ``notify``, go out by ``Bus.send``."""

    def __init__(self, owner: Bus) -> None:
        super().__init__()
        self._owner = owner

    def send_message(self, can_id: int, data: bytes, remote: bool = False) -> None:
        self._owner.send(can_id, bytes(data), remote=remote)


class Bus:
    """A bus that is being read.

    Use it as a context manager, or ``open`` and ``close``. `network` is a canopen network for SDO; it has no
    Notifier and must not be connected or disconnected.
    """

    def __init__(
        self, config: BusConfig, opener: Callable[[BusConfig], can.BusABC] = open_python_can
    ) -> None:
        self.config = config
        self.network = _Network(self)
        self._opener = opener
        self._can: can.BusABC | None = None
        self._reader: Reader | None = None
        self._handlers: dict[int, tuple[Handler, ...]] = {}
        self._recorders: tuple[Recorder, ...] = ()
        self._send_lock = threading.Lock()
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None
        self._counts: dict[str, int] = dict.fromkeys(
            ("received", "dropped", "error_frames", "receive_errors", "handler_errors", "reopened"), 0
        )
        self._dropped_before = 0
        self._state = BusState.ACTIVE
        self._last_error = ""
        self._time = 0.0
        self._last_arrival = self._last_feed = time.monotonic()
        self._beat_wall = self._beat_bus = -float("inf")

    # -- life

    def open(self) -> Bus:
        """Open the bus and start reading it; BusNotOpened when that fails now."""
        self._attach()
        self._last_arrival = self._last_feed = time.monotonic()
        self._stop.clear()
        self._thread = threading.Thread(target=self._run, name=f"bus {self.config.channel}")
        self._thread.start()
        return self

    def close(self) -> None:
        """Stop reading and close; safe to call twice."""
        self._stop.set()
        if self._thread is not None:
            self._thread.join()
            self._thread = None
        self._detach()

    def __enter__(self) -> Bus:
        return self.open()

    def __exit__(self, *_: object) -> None:
        self.close()

    # -- what it says

    @property
    def time(self) -> float:
        """Time stamp of the last frame received [s], the machine's clock where it is simulated."""
        return self._time

    def clock(self) -> float:
        """What time limits are measured on [s]: monotonic, or the machine's time where it is simulated."""
        return self._time if self.config.machine_time else time.monotonic()

    def moment(self, time_stamp: float) -> float:
        """What ``clock`` says at the arrival of a frame, for handlers in the receive loop [s]."""
        return time_stamp if self.config.machine_time else time.monotonic()

    @property
    def silence(self) -> float:
        """Time since the last frame arrived [s], monotonic."""
        return time.monotonic() - self._last_arrival

    @property
    def health(self) -> BusHealth:
        """Counts so far and the controller's state."""
        return BusHealth(**self._counts, state=self._state, last_error=self._last_error)

    def check(self) -> None:
        """Raise BusOff or BusLost when the bus is not usable now."""
        if self._state is BusState.OFF:
            raise BusOff(f"{self.config.channel} is bus-off ({self._last_error})")
        if self._can is None:
            raise BusLost(f"{self.config.channel} is lost ({self._last_error or 'it was never opened'})")

    # -- in and out

    def send(self, can_id: int, data: bytes, *, remote: bool = False) -> None:
        """Send one frame; from any thread."""
        self.check()
        message = can.Message(
            arbitration_id=can_id,
            data=data,
            is_extended_id=can_id > 0x7FF,
            is_remote_frame=remote,
            timestamp=self._time,
        )
        try:
            with self._send_lock:
                if self._can is None:
                    raise BusLost(f"{self.config.channel} is lost ({self._last_error})")
                self._can.send(message)
        except (can.CanError, OSError) as error:
            raise self._send_failure(error) from error
        for recorder in self._recorders:
            recorder.append_sent(can_id, data)

    def _send_failure(self, error: Exception) -> BusLost | BusOverloaded:
        full = getattr(error, "error_code", None) == _ENOBUFS or "buffer full" in str(error)
        kind = BusOverloaded if full else BusLost
        return kind(f"{self.config.channel}: a frame could not be sent ({error})")

    def subscribe(self, can_id: int, handler: Handler) -> None:
        """Have `handler` called in the receive loop for each frame of this id."""
        self._handlers[can_id] = (*self._handlers.get(can_id, ()), handler)

    def unsubscribe(self, can_id: int, handler: Handler) -> None:
        """Undo ``subscribe``."""
        self._handlers[can_id] = tuple(h for h in self._handlers.get(can_id, ()) if h != handler)

    @contextlib.contextmanager
    def recording(self) -> Iterator[Recorder]:
        """Record every frame while inside, those we send apart from those received."""
        recorder = Recorder()
        self._recorders = (*self._recorders, recorder)
        try:
            yield recorder
        finally:
            self._recorders = tuple(r for r in self._recorders if r is not recorder)

    def feed(self) -> None:
        """Tell that the supervisor lives; without it the master's heartbeat ceases."""
        self._last_feed = time.monotonic()

    def wait_until(self, condition: Callable[[], bool], timeout: float, silence: float = 3.0) -> bool:
        """Poll `condition` for at most `timeout` [s] of ``clock``; False when it ran out.

        Raises BusLost or BusOff when the bus fails, BusSilent when nothing arrives for `silence` [s] of
        real time.
        """
        start, entered = self.clock(), time.monotonic()
        while not condition():
            self.check()
            self.feed()
            if self.clock() - start > timeout:
                return condition()
            if min(self.silence, time.monotonic() - entered) > silence:
                raise BusSilent(f"{self.config.channel}: no frame for {silence:.1f} s")
            time.sleep(_POLL)
        return True

    # -- the loop

    def _attach(self) -> None:
        opened = self._opener(self.config)
        self._reader = (
            SocketReader(opened.socket, self.config.receive_buffer_bytes)
            if isinstance(opened, SocketcanBus)
            else MessageReader(opened)
        )
        self._state = _state_at_opening(self.config)
        if self._state is BusState.OFF:
            self._last_error = "it was off already when it was opened"
        self._can = opened

    def _detach(self) -> None:
        with self._send_lock:
            closing, self._can, self._reader = self._can, None, None
        if closing is not None:
            with contextlib.suppress(can.CanError, OSError):
                closing.shutdown()

    def _run(self) -> None:
        while not self._stop.is_set():
            if self._reader is None:
                self._reopen()
                continue
            self._beat()
            try:
                batch = self._reader.read(_IDLE)
            except Exception as error:
                self._lose(error)
                continue
            if batch:
                self._take(batch)

    def _lose(self, error: Exception) -> None:
        self._last_error = str(error)
        log.error(
            "%s: receiving failed (%s); closing the bus and opening it again", self.config.channel, error
        )
        self._dropped_before = self._counts["dropped"]
        self._detach()
        self._counts["receive_errors"] += 1

    def _reopen(self) -> None:
        try:
            self._attach()
        except Exception as error:
            self._last_error = str(error)
            self._stop.wait(self.config.reopen_interval)
            return
        self._counts["reopened"] += 1
        log.warning("%s: open again", self.config.channel)

    def _take(self, batch: Sequence[Frame]) -> None:
        for recorder in self._recorders:
            recorder.append(batch)
        handlers, network = self._handlers, self.network
        for at, can_id, data in batch:
            if can_id in handlers or can_id in network.subscribers or can_id & ERROR_FLAG:
                self._dispatch(at, can_id, data)
        self._time = batch[-1][0]
        self._last_arrival = time.monotonic()
        self._counts["received"] += len(batch)
        if self._reader is not None:
            self._counts["dropped"] = self._dropped_before + self._reader.dropped

    def _dispatch(self, at: float, can_id: int, data: bytes) -> None:
        if can_id & ERROR_FLAG:
            self._error_frame(can_id, data)
            return
        try:
            for handler in self._handlers.get(can_id, ()):
                handler(at, can_id, data)
            if can_id in self.network.subscribers:
                self.network.notify(can_id, bytearray(data), at)
        except Exception:
            self._counts["handler_errors"] += 1
            log.exception("%s: a handler of frame 0x%X failed", self.config.channel, can_id)

    def _error_frame(self, can_id: int, data: bytes) -> None:
        self._counts["error_frames"] += 1
        self._last_error = describe(can_id, data)
        state = state_after(self._state, can_id, data)
        if state is not self._state:
            log.warning("%s: %s (%s)", self.config.channel, state.value, self._last_error)
        self._state = state

    def _beat(self) -> None:
        """Send the master's heartbeat when it is due on either clock and the supervisor lives."""
        if self.config.master_node_id is None:
            return
        now, period = time.monotonic(), self.config.heartbeat_period
        if now - self._beat_wall < period and abs(self._time - self._beat_bus) < period:
            return
        if now - self._last_feed > self.config.supervisor_patience:
            return
        self._beat_wall, self._beat_bus = now, self._time
        with contextlib.suppress(BusLost, BusOff, BusOverloaded):
            self.send(0x700 + self.config.master_node_id, b"\x05")
