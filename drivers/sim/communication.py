"""What CiA 301 lets the simulated drive send by itself: SYNC, heartbeat, EMCY - and the master's heartbeat.

Times are counted in ticks of the machine (1 ms), so that a period is a whole number of them.
"""

from __future__ import annotations

from drivers.sim.dictionary import Dictionary
from drivers.sim.wire import Frame

TICK = 0.001
"""The machine's tick [s], the shortest SYNC period."""

_SYNC_PRODUCER = 1 << 30


class SyncProducer:
    """0x1005, 0x1006, 0x1019: the SYNC of this drive's own quartz, with its counter."""

    def __init__(self, dictionary: Dictionary) -> None:
        self._values = dictionary.values
        self._counter = 0

    def restart(self) -> None:
        """The next SYNC carries counter 1."""
        self._counter = 0

    def ticks(self, first: int, count: int) -> list[int]:
        """The ticks among first … first + count - 1 at which a SYNC is due."""
        period = self._values[0x1006, 0] // 1000
        if not self._values[0x1005, 0] & _SYNC_PRODUCER or period == 0:
            return []
        return [tick for tick in range(first, first + count) if tick % period == 0]

    def frame(self, tick: int) -> Frame:
        overflow = self._values[0x1019, 0]
        if overflow == 0:
            return tick * TICK, self._values[0x1005, 0] & 0x7FF, b""
        self._counter = self._counter % overflow + 1
        return tick * TICK, self._values[0x1005, 0] & 0x7FF, bytes([self._counter])


class HeartbeatProducer:
    """0x1017; one frame at the first tick of the period, which begins with the write."""

    def __init__(self, dictionary: Dictionary, node_id: int) -> None:
        self._values, self._node_id = dictionary.values, node_id
        self._next = 0

    def restart(self, tick: int) -> None:
        self._next = tick + self._values[0x1017, 0]

    def frames(self, first: int, count: int, state: int) -> list[Frame]:
        period, frames = self._values[0x1017, 0], []
        while period and self._next < first + count:
            frames.append((max(self._next, first) * TICK, 0x700 + self._node_id, bytes([state])))
            self._next = max(self._next, first) + period
        return frames


class MasterWatch:
    """0x1016: for how many ticks the master has been silent; None before its first heartbeat and once lost."""

    def __init__(self, dictionary: Dictionary) -> None:
        self._values = dictionary.values
        self.silence: int | None = None

    @property
    def limit(self) -> int:
        """The consumer heartbeat time [ticks]; 0 = no master is watched."""
        return self._values[0x1016, 1] & 0xFFFF

    def hears(self, can_id: int) -> bool:
        """Take note of a frame if it is the watched heartbeat, and say whether it is."""
        if can_id != 0x700 + (self._values[0x1016, 1] >> 16 & 0x7F) or self.limit == 0:
            return False
        self.silence = 0
        return True

    def pass_time(self, ticks: int) -> None:
        if self.limit == 0:
            self.silence = None  # CiA 301: the watch begins anew with the first heartbeat after 0x1016 is set
        elif self.silence is not None:
            self.silence += ticks

    def lost(self) -> bool:
        """True once when the silence has lasted too long; then nothing is watched until the next heartbeat."""
        if self.silence is None or not 0 < self.limit <= self.silence:
            return False
        self.silence = None
        return True


class ErrorLog:
    """EMCY, error register 0x1001 and history 0x1003."""

    def __init__(self, dictionary: Dictionary) -> None:
        self._values = dictionary.values

    def raise_error(self, code: int, register: int) -> bytes:
        """Enter an error; the EMCY's payload."""
        values = self._values
        values[0x1001, 0] |= register | 0x01
        values[0x603F, 0] = code
        for sub in (4, 3, 2):
            values[0x1003, sub] = values[0x1003, sub - 1]
        values[0x1003, 1], values[0x1003, 0] = code, min(4, values[0x1003, 0] + 1)
        return self._payload(code)

    def clear(self) -> bytes:
        """All errors are gone; the EMCY's payload says so with code 0."""
        self._values[0x1001, 0] = self._values[0x603F, 0] = 0
        return self._payload(0)

    def _payload(self, code: int) -> bytes:
        return code.to_bytes(2, "little") + bytes([self._values[0x1001, 0]]) + bytes(5)
