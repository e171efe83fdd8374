"""A CiA 402 drive on top of durand, a CANopen slave that shares no code with our master or our simulated machine.

durand brings NMT, SDO server, PDO on SYNC, EMCY and the heartbeat producer; the state machine of the drive and a
crude motion (constant speed) are added here. What it does *not* do: watch the master's heartbeat, produce SYNC by
itself (a thread does), follow a jerk-limited profile.

It applies the objects of an RPDO one after the other, so a master that sends the new set-point and the edge of bit 4
in one frame for the first time would move it to the old target.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

import can
from durand import CANBusNetwork, DatatypeEnum, MinimalNode, Record, Variable
from durand.object_dictionary import Array
from durand.scheduler import AbstractScheduler, get_scheduler, set_scheduler

NODE = 5
RATED_TORQUE = 5000
SPEED_COUNTS = 1000
SYNC_PERIOD = 0.004

U8, U16, U32 = DatatypeEnum.UNSIGNED8, DatatypeEnum.UNSIGNED16, DatatypeEnum.UNSIGNED32
I8, I16, I32 = DatatypeEnum.INTEGER8, DatatypeEnum.INTEGER16, DatatypeEnum.INTEGER32

VARIABLES: dict[int, tuple[Any, str, int]] = {
    0x1006: (U32, "rw", 0),
    0x1019: (U8, "rw", 0),
    0x6007: (I16, "rw", 1),
    0x603F: (U16, "ro", 0),
    0x6040: (U16, "rw", 0),
    0x6041: (U16, "ro", 0x0250),
    0x605A: (I16, "rw", 2),
    0x6060: (I8, "rw", 0),
    0x6061: (I8, "ro", 0),
    0x6064: (I32, "ro", 0),
    0x606C: (I32, "ro", 0),
    0x6076: (U32, "ro", RATED_TORQUE),
    0x6077: (I16, "ro", 250),
    0x607A: (I32, "rw", 0),
    0x6081: (U32, "rw", 0),
    0x6083: (U32, "rw", 0),
    0x6084: (U32, "rw", 0),
    0x6085: (U32, "rw", 0),
    0x6086: (I16, "rw", 0),
    0x60A3: (U8, "rw", 1),
    0x6502: (U32, "ro", 1),
}

# Which controlword (masked) leads from which state to which, by the state's bits in the statusword.
DISABLED, READY, ON, ENABLED, QUICK_STOP, FAULT = 0x40, 0x21, 0x23, 0x27, 0x07, 0x08


class TimerScheduler(AbstractScheduler):  # type: ignore[misc]
    """durand's timers, each on a thread of its own: its own scheduler can miss its first entry."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._stopped = False

    def add(
        self, delay: float, callback: Callable[..., None], args: tuple[Any, ...] = (), kwargs: Any = None
    ) -> Any:
        timer = threading.Timer(delay, self._call, (callback, args, kwargs or {}))
        timer.daemon = True
        timer.start()
        return timer

    def _call(self, callback: Callable[..., None], args: tuple[Any, ...], kwargs: dict[str, Any]) -> None:
        timer = threading.current_thread()
        assert isinstance(timer, threading.Timer)
        with self._lock:
            if not (self._stopped or timer.finished.is_set()):  # cancelled while it waited for the lock
                callback(*args, **kwargs)

    def cancel(self, entry: threading.Timer) -> None:
        entry.cancel()

    def stop(self) -> None:
        """From here on no timer calls back."""
        with self._lock:
            self._stopped = True

    @property
    def lock(self) -> threading.Lock:
        return self._lock


class DurandDrive:
    """The drive. `refuse` names objects whose writes are aborted, `forget` objects that keep their old value."""

    def __init__(
        self,
        channel: str,
        refuse: Collection[int] = (),
        forget: Collection[int] = (),
        interface: str = "virtual",
    ) -> None:
        self._open = partial(can.Bus, interface=interface, channel=channel)
        self._bus = self._open()
        self._network = CANBusNetwork(self._bus)
        self.node = MinimalNode(self._network, NODE)
        self.od = self.node.object_dictionary
        self.controlwords: list[int] = []
        self.mute = False
        self.ignore_set_points = False
        self.sticks = False
        self._goal = 0
        self._state = DISABLED
        self._bits = 0x0210
        self._build(refuse, forget)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._sync, name="durand drive")
        self._thread.start()

    def end_heartbeat(self) -> None:
        """No heartbeat from here on; under the lock, lest a timer that runs just now starts the next one."""
        with get_scheduler().lock:
            self.od.write(0x1017, 0, 0)

    def close(self) -> None:
        self._stop.set()
        self._thread.join()
        with self._open() as waker:
            wake = can.Message(arbitration_id=0x80, is_extended_id=False)
            # durand's Notifier looks for its end once a second, or at a frame.
            timer = threading.Timer(0.02, waker.send, [wake])
            timer.start()
            self._network.stop()
            timer.join()
        self._bus.shutdown()

    def _build(self, refuse: Collection[int], forget: Collection[int]) -> None:
        for index, (datatype, access, value) in VARIABLES.items():
            self.od[index] = Variable(datatype, access, value)
        self.od[0x1016] = Array(Variable(U32, "rw"), 1)
        for index, datatype, count in ((0x607D, I32, 2), (0x60A4, U32, 1)):
            record = Record()
            for sub in range(1, count + 1):
                record[sub] = Variable(datatype, "rw", 0)
            self.od[index] = record
        self.od.write(0x1000, 0, 0x0002_0192)
        for index in refuse:
            for sub in (0, 1, 2):
                self.od.validate_callbacks[index, sub].add(self._abort)
        for index in forget:
            for sub in (0, 1, 2):
                self.od.set_read_callback(index, sub, lambda: 0)
        self.od.download_callbacks[0x6040, 0].add(self._on_controlword)
        self.node.sync.callbacks.add(self._advance)

    @staticmethod
    def _abort(_: int) -> None:
        raise ValueError("this drive does not want it")

    def _sync(self) -> None:
        counter = 0
        while not self._stop.wait(SYNC_PERIOD):
            if self.mute:
                continue
            counter = counter % 240 + 1
            # Our own frames do not come back to us: tell the node first, then the wire.
            self._bus.send(can.Message(arbitration_id=0x80, data=[counter], is_extended_id=False))
            self.node.sync.callbacks.call()

    # -- the drive

    def emergency(self, code: int) -> None:
        """A fault: EMCY, power off."""
        self.od.write(0x603F, 0, code)
        self._enter(FAULT)
        self.node.emcy.set(code, 0x21)

    def warn(self, code: int) -> None:
        """An EMCY for an error with which the drive goes on; statusword bit 7 tells it, too."""
        self._bits |= 0x80
        self._enter(self._state)
        self.node.emcy.set(code, 0x09)

    def reboot(self) -> None:
        self.node.nmt.reset()

    @property
    def powered(self) -> bool:
        return self._state in (ENABLED, QUICK_STOP)

    @property
    def position(self) -> int:
        return int(self.od.read(0x6064, 0))

    def _on_controlword(self, word: int) -> None:
        self.controlwords.append(word)
        state = self._state
        if state == FAULT:
            if word & 0x80:
                self._enter(DISABLED)
        elif not word & 0x02:
            self._enter(DISABLED)
        elif not word & 0x04:
            self._enter(QUICK_STOP if state in (ENABLED, QUICK_STOP) else DISABLED)
        elif word & 0x0F == 0x06:
            self._enter(READY)
        elif word & 0x0F == 0x07 and state in (READY, ENABLED):
            self._enter(ON)
        elif word & 0x0F == 0x0F and state == ON:
            self._enter(ENABLED)
        elif word & 0x0F == 0x0F and state == ENABLED:
            self._set_point(word)

    def _set_point(self, word: int) -> None:
        acknowledged = self._bits & 0x1000
        if word & 0x10 and not acknowledged and not self.ignore_set_points:
            target = int(self.od.read(0x607A, 0))
            self._goal = self.position + target if word & 0x40 else target
            self._bits = (self._bits | 0x1000) & ~0x0400
        elif not word & 0x10:
            self._bits &= ~0x1000
        self._enter(ENABLED)

    def _enter(self, state: int) -> None:
        self._state = state
        self.od.write(0x6041, 0, self._bits | state)

    def _advance(self) -> None:
        """One SYNC period of constant speed; quick stop halts at once and is left for *switch on disabled*."""
        if self._state == QUICK_STOP:
            self._enter(DISABLED)
        left = self._goal - self.position if self._state == ENABLED and not self.sticks else 0
        step = max(-SPEED_COUNTS, min(SPEED_COUNTS, left))
        self.od.write(0x6064, 0, self.position + step)
        self.od.write(0x606C, 0, step)
        if self._state == ENABLED and not left and not self.sticks:
            self._bits |= 0x0400
            self._enter(ENABLED)


@contextmanager
def durand_drive(channel: str, **options: Any) -> Iterator[DurandDrive]:
    """A drive on the channel; durand's scheduler is restored afterwards."""
    before = get_scheduler()
    scheduler = TimerScheduler()
    set_scheduler(scheduler)
    drive = DurandDrive(channel, **options)
    try:
        yield drive
    finally:
        scheduler.stop()
        drive.close()
        set_scheduler(before)
