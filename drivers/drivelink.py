"""What one drive keeps sending, and the two frames sent to it: the fast side of a drive, without SDO.

The handlers run in the receive loop: they store bytes and the moment, nothing is decoded there.
"""

from __future__ import annotations

from collections.abc import Callable

from drivers import cia402
from drivers.bus import Bus
from drivers.cia402 import ProcessData, State, Status
from drivers.commissioning import DriveConfig
from drivers.errors import NodeRestarted, NodeSilent

NMT_START, NMT_PRE_OPERATIONAL = 0x01, 0x80
BOOT_UP, OPERATIONAL, PRE_OPERATIONAL = 0, 5, 127


class DriveLink:
    """The last frames of one drive."""

    def __init__(self, bus: Bus, config: DriveConfig, on_fault: Callable[[], None]) -> None:
        """`on_fault` is called in the receive loop when the statusword tells a fault for the first time."""
        self.bus = bus
        self.config = config
        self.name = f"{config.name} (node {config.node_id})"
        self.target = 0
        self.nmt_state: int | None = None
        self.acknowledged: float | None = None
        self.emergencies: list[tuple[int, int]] = []
        self._on_fault = on_fault
        self._restarted = False
        self._tpdo: bytes | None = None
        self._tpdo_clock = self._heartbeat_clock = bus.clock()
        for can_id, handler in self._handlers():
            bus.subscribe(can_id, handler)

    def close(self) -> None:
        """Take no notice of the drive any more."""
        for can_id, handler in self._handlers():
            self.bus.unsubscribe(can_id, handler)

    def _handlers(self) -> list[tuple[int, Callable[[float, int, bytes], None]]]:
        node = self.config.node_id
        return [
            (0x180 + node, self._on_tpdo),
            (0x700 + node, self._on_heartbeat),
            (0x80 + node, self._on_emcy),
        ]

    # -- in the receive loop

    def _on_tpdo(self, at: float, _: int, data: bytes) -> None:
        if len(data) != 8:
            return
        if self._tpdo is not None and data[7] & 0x10 and not self._tpdo[7] & 0x10:
            self.acknowledged = at
        was_faulted, self._tpdo = self.faulted, data
        self._tpdo_clock = self.bus.moment(at)
        if self.faulted and not was_faulted:
            self._on_fault()

    def _on_heartbeat(self, at: float, _: int, data: bytes) -> None:
        self.nmt_state = data[0] & 0x7F
        self._restarted = self._restarted or self.nmt_state == BOOT_UP
        self._heartbeat_clock = self.bus.moment(at)

    def _on_emcy(self, _at: float, _: int, data: bytes) -> None:
        code, register = cia402.decode_emcy(data)
        if code >> 8:
            self.emergencies.append((code, register))

    # -- out

    def command_nmt(self, command: int) -> None:
        """Send an NMT command; `nmt_state` is unknown until the next heartbeat."""
        self.nmt_state = None
        self.bus.send(0, bytes((command, self.config.node_id)))

    def send(self, controlword: int) -> None:
        """Send RPDO1: the controlword, and the target as it stands."""
        self.bus.send(0x200 + self.config.node_id, cia402.encode_rpdo(controlword, self.target))

    # -- what it says

    def await_nmt(self, state: int) -> None:
        """Wait until the heartbeat tells this NMT state; NodeSilent when it does not."""
        if not self.bus.wait_until(lambda: self.nmt_state == state, 3 + 3 * self.config.heartbeat_period):
            raise NodeSilent(
                f"{self.name}: NMT state {state} was commanded, its heartbeat tells {self.nmt_state}"
            )
        if state == OPERATIONAL:
            self._restarted = False

    def await_process_data(self) -> None:
        """Wait for a first TPDO1; NodeSilent without one."""
        if not self.bus.wait_until(lambda: self._tpdo is not None, 2.0):
            raise NodeSilent(f"{self.name} sends no TPDO1 (SYNC 0x80 missing?)")

    def check(self) -> None:
        """Raise BusError, NodeRestarted or NodeSilent where that is so now."""
        self.bus.check()
        if self._restarted:
            raise NodeRestarted(f"{self.name} has booted again")
        age = self.bus.clock() - self._heartbeat_clock
        if age > self.config.heartbeat_patience:
            raise NodeSilent(f"{self.name}: no heartbeat for {age:.2f} s")

    @property
    def faulted(self) -> bool:
        """Whether the last statusword told a fault or the reaction to one: its bit 3, in no other state.

        An EMCY alone tells none: CiA 301 has it for any error, also one with which the drive goes on (a warning).
        """
        return self._tpdo is not None and bool(self._tpdo[6] & 0x08)

    @property
    def process_data(self) -> ProcessData:
        """The last TPDO1 in the drive's units; NodeSilent when none came lately."""
        age = self.bus.clock() - self._tpdo_clock
        if self._tpdo is None or age > self.config.heartbeat_patience:
            raise NodeSilent(f"{self.name} sends no TPDO1 (SYNC 0x80 missing?)")
        return cia402.decode_tpdo(self._tpdo)

    @property
    def state(self) -> State:
        """State by the last statusword."""
        return cia402.state_of(self.process_data.statusword)

    @property
    def statusword(self) -> str:
        """The last statusword for messages, also an old one."""
        return (
            f"statusword 0x{cia402.decode_tpdo(self._tpdo).statusword:04X}" if self._tpdo else "no statusword"
        )

    @property
    def speed(self) -> float:
        """Last speed [rad/s]."""
        return self.process_data.velocity * self.config.speed_lsb_rad_s * self.config.direction

    @property
    def at_rest(self) -> bool:
        """Whether the last speed is below the standstill speed."""
        return abs(self.speed) <= self.config.standstill_speed

    def has(self, bit: Status) -> bool:
        """Whether a bit of the last statusword is set."""
        return bool(self.process_data.statusword & bit)
