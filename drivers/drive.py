"""A CiA 402 servo drive on CANopen, in profile position mode with a jerk-limited profile.

    with Bus(config) as bus, Drive(bus, drive_config) as drive, bus.recording() as recorder:
        with drive.enabled():
            drive.start(move)
            drive.wait_standstill()
        record = drive.traces(recorder.frames())

Controlwords go by RPDO1, from any thread, and are sent always; the statusword in TPDO1 (at every SYNC) is the
proof. Software cannot stop an 86 ms move: the drive's own reactions protect, and they are read back first.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Sequence

from drivers import cia402, commissioning, drivelink
from drivers.bus import Bus
from drivers.cia402 import Command, ProcessData, State, Status
from drivers.commissioning import DriveConfig, DriveMove
from drivers.drivelink import DriveLink
from drivers.drivetraces import DriveRecord, decode
from drivers.errors import (
    DriveFault,
    DriverError,
    MoveNotFinished,
    MoveRefused,
    NodeSilent,
    StateTransitionTimeout,
    UnknownStatusword,
)
from drivers.objects import Objects
from drivers.trace import Frames

__all__ = ["Drive", "DriveConfig", "DriveMove", "DriveRecord", "start_together"]

_ATTEMPTS = 3
_ANSWER = 0.5
_BRAKING = 2.0
_STEPS_TO_ENABLE = 6


class Drive:
    """One drive. ``connect`` writes and verifies everything that protects; nothing moves before."""

    def __init__(
        self, bus: Bus, config: DriveConfig, on_fault: Callable[[Drive], None] | None = None
    ) -> None:
        """`on_fault` is called in the receive loop at a fault: to quick-stop a gantry's other drive, say."""
        self.bus = bus
        self.config = config
        self.rated_torque = 0.0
        self._on_fault = on_fault
        self._link: DriveLink | None = None
        self._objects: Objects | None = None
        self._move: DriveMove | None = None
        self._started_clock = 0.0

    # -- connection

    def connect(self) -> Drive:
        """Identify the drive, write and verify protections, SYNC, mapping and profile, set it operational."""
        self.disconnect()
        try:
            self._commission()
        except BaseException:
            self.disconnect()
            raise
        return self

    def _commission(self) -> None:
        link = self._link = DriveLink(self.bus, self.config, self._faulted)
        objects = self._objects = Objects(self.bus, self.config.node_id, self.config.name, self.config.eds)
        commissioning.identify(objects, self.config)
        link.command_nmt(drivelink.NMT_PRE_OPERATIONAL)
        commissioning.set_protections(objects, self.config)
        link.await_nmt(drivelink.PRE_OPERATIONAL)
        commissioning.set_sync(objects, self.config)
        commissioning.map_process_data(objects, self.config)
        commissioning.set_jerk_limited_position_mode(objects)
        self.rated_torque = commissioning.read_rated_torque(objects)
        link.command_nmt(drivelink.NMT_START)
        link.await_nmt(drivelink.OPERATIONAL)
        if cia402.state_of(objects.read(0x6041)) is State.FAULT:
            raise self._fault()

    def disconnect(self) -> None:
        """Leave the drive pre-operational, silent and as it was found; safe to call twice."""
        link, objects = self._link, self._objects
        self._link = self._objects = None
        if link is not None:
            link.close()
        if link is None or objects is None:
            return
        with contextlib.suppress(DriverError):
            link.command_nmt(drivelink.NMT_PRE_OPERATIONAL)
            commissioning.release(objects)
        objects.close()

    def __enter__(self) -> Drive:
        return self.connect()

    def __exit__(self, *_: object) -> None:
        self.disconnect()

    # -- what it says

    @property
    def name(self) -> str:
        """Name and node id, for messages."""
        return f"{self.config.name} (node {self.config.node_id})"

    @property
    def process_data(self) -> ProcessData:
        """The last TPDO1 in the drive's units; NodeSilent when none came lately."""
        return self._linked().process_data

    @property
    def state(self) -> State:
        """State by the last statusword received."""
        return self._linked().state

    @property
    def speed(self) -> float:
        """Last speed received [rad/s]."""
        return self._linked().speed

    def position(self) -> float:
        """Position of the motor [rad], 0x6064 over SDO; not from the receive loop."""
        return self._connected().read(0x6064) * self.config.position_lsb_rad

    def check(self) -> None:
        """Raise what is wrong with bus or drive now: BusError, NodeRestarted, DriveFault, NodeSilent."""
        link = self._linked()
        link.check()
        if link.faulted:
            raise self._fault()

    def check_moving(self) -> None:
        """Raise what keeps the drive from moving now: what ``check`` raises, DriveFault, MoveNotFinished."""
        self.check()
        state = self.state
        if state is not State.ENABLED:
            raise MoveNotFinished(f"{self.name} left operation enabled in mid-move, it is in state {state}")

    def remarks(self) -> tuple[str, ...]:
        """Sentences about the errors that the drive sent by EMCY and went on with: its warnings."""
        told = dict.fromkeys(self._linked().emergencies)
        return tuple(
            f"{self.name} warned of 0x{code:04X}, {cia402.error_text(code)} (error register 0x{register:02X}), and "
            "went on; look at its display, since the next time it may stop"
            for code, register in told
        )

    def traces(self, frames: Frames) -> DriveRecord:
        """Speed, torque and statusword out of recorded frames, placed by the SYNC counter."""
        return decode(frames, self.config, self.rated_torque)

    # -- power

    @contextlib.contextmanager
    def enabled(self) -> Iterator[Drive]:
        """Operation enabled while inside; disabled afterwards whatever happens."""
        try:
            self._enable()
            yield self
        except BaseException as error:
            try:
                self.disable()
            except DriverError as also:
                error.add_note(f"And the axis could not be verified disabled: {also}")
            raise
        self.disable()

    def disable(self) -> None:
        """Stop if moving, take the torque away and verify it.

        The drive is left the time to close its brake: transition 5 (disable operation) and the end of a quick stop
        keep the torque until it grips; transition 9 (disable voltage) would let an axis with weight on it sag.
        """
        with contextlib.suppress(NodeSilent, StateTransitionTimeout, UnknownStatusword):
            link = self._linked()
            if link.state is State.ENABLED and not link.at_rest:
                self.quick_stop()
            self.bus.wait_until(
                lambda: not cia402.powered(link.state) or (link.state is State.ENABLED and link.at_rest),
                _BRAKING,
            )
            if link.state is State.ENABLED:
                self._command(
                    Command.DISABLE_OPERATION, lambda: link.state is not State.ENABLED, "switched on"
                )
            self._command(Command.DISABLE_VOLTAGE, lambda: not self._ready(), "switch on disabled")
            return
        self._disable_by_sdo()

    def quick_stop(self) -> None:
        """Command a quick stop and verify that the drive took it; it stops by its own ramp (0x6085)."""
        self._command(Command.QUICK_STOP, lambda: self.state is not State.ENABLED, "quick stop")

    def command_quick_stop(self) -> None:
        """Send quick stop and return; for the receive loop, which must not wait."""
        self._linked().send(Command.QUICK_STOP)

    def reset_fault(self) -> None:
        """Acknowledge a fault at the drive, on a person's order only."""
        link = self._linked()
        link.send(Command.DISABLE_VOLTAGE)
        link.emergencies.clear()
        self._command(Command.FAULT_RESET, lambda: self.state is not State.FAULT, "switch on disabled")

    # -- moving

    def start(self, move: DriveMove) -> float:
        """Begin a move; bus time at which the drive acknowledged it [s]. MoveRefused where it may not."""
        return start_together([(self, move)])

    def prepare(self, move: DriveMove) -> None:
        """Write the profile and the target, all but the order to go."""
        self.check()
        link = self._linked()
        if link.state is not State.ENABLED:
            raise MoveRefused(f"{self.name} is in state {link.state}, not enabled")
        self._check_limits(move)
        commissioning.set_profile(self._connected(), self.config, move)
        link.target = round(move.target / self.config.position_lsb_rad)
        self._move = move
        self._set_point(move, new=False)
        if not self.bus.wait_until(lambda: not link.has(Status.SET_POINT_ACKNOWLEDGE), _ANSWER):
            raise MoveRefused(f"{self.name} still acknowledges an older set-point")

    def trigger(self) -> None:
        """Send the order to go. The target went out before: a drive may latch it at the edge of bit 4."""
        self._linked().acknowledged = None
        self._set_point(self._prepared(), new=True)

    def confirm_started(self) -> float:
        """Wait for the acknowledgement, complete the handshake; bus time of the acknowledgement [s]."""
        link, move = self._linked(), self._prepared()

        def acknowledged() -> bool:
            self.check_moving()
            return link.acknowledged is not None

        for _ in range(_ATTEMPTS):
            if self.bus.wait_until(acknowledged, _ANSWER):
                break
            self._set_point(move, new=True)
        if link.acknowledged is None:
            raise MoveRefused(f"{self.name} did not acknowledge the set-point ({link.statusword})")
        self._started_clock = self.bus.clock()
        self._set_point(move, new=False)
        return link.acknowledged

    def wait_standstill(self, guard: Callable[[], None] = lambda: None) -> float:
        """Wait for the end of the move: target reached and at rest; bus time of it [s].

        ``guard`` is called meanwhile and raises to give up waiting; the drive goes on until it is stopped.

        Raises MoveNotFinished, DriveFault, NodeSilent, BusError.
        """
        link, move = self._linked(), self._prepared()
        moving_at = self.bus.clock()

        def finished() -> bool:
            nonlocal moving_at
            guard()
            self.check_moving()
            now = self.bus.clock()
            over = now - self._started_clock >= move.duration
            if not (over and link.has(Status.TARGET_REACHED) and link.at_rest):
                moving_at = now
            return now - moving_at >= self.config.standstill_time

        limit = move.duration + move.timeout
        if not self.bus.wait_until(finished, limit):
            state = f"{link.statusword}, {link.speed:.2f} rad/s"
            raise MoveNotFinished(f"{self.name}: not at rest {limit:.1f} s after the start ({state})")
        return self.bus.time

    # -- inside

    def _connected(self) -> Objects:
        if self._objects is None:
            raise NodeSilent(f"{self.name} is not connected")
        return self._objects

    def _linked(self) -> DriveLink:
        if self._link is None:
            raise NodeSilent(f"{self.name} is not connected")
        return self._link

    def _prepared(self) -> DriveMove:
        if self._move is None:
            raise MoveRefused(f"{self.name}: no move was prepared")
        return self._move

    def _faulted(self) -> None:
        if self._on_fault is not None:
            self._on_fault(self)

    def _set_point(self, move: DriveMove, *, new: bool) -> None:
        self._linked().send(cia402.position_controlword(new_set_point=new, relative=move.relative))

    def _command(self, controlword: int, done: Callable[[], bool], goal: str) -> None:
        link = self._linked()
        for _ in range(_ATTEMPTS):
            link.send(controlword)
            if self.bus.wait_until(done, _ANSWER):
                return
        raise StateTransitionTimeout(
            f"{self.name}: controlword 0x{controlword:04X} did not lead to {goal} ({link.statusword})"
        )

    def _enable(self) -> None:
        self.check()
        link = self._linked()
        link.await_process_data()
        for _ in range(_STEPS_TO_ENABLE):
            state = link.state
            if state is State.ENABLED:
                return
            if state in (State.FAULT, State.FAULT_REACTION):
                raise self._fault()
            self._towards_enabled(state)
        raise StateTransitionTimeout(f"{self.name} does not stay enabled ({link.statusword})")

    def _towards_enabled(self, state: State) -> None:
        command = cia402.next_towards_enabled(state)
        if command is None:
            self.bus.wait_until(lambda: self.state is not state, _ANSWER)
        else:
            self._command(command, lambda: self.state is not state, f"leaving {state}")

    def _ready(self) -> bool:
        """Whether the drive has power or is a controlword or two away from it."""
        return self.state in (State.READY, State.SWITCHED_ON) or cia402.powered(self.state)

    def _disable_by_sdo(self) -> None:
        """Last resort where process data fail."""
        objects = self._connected()
        objects.write(0x6040, 0, int(Command.DISABLE_VOLTAGE))
        statusword = objects.read(0x6041)
        if cia402.powered(cia402.state_of(statusword)):
            raise StateTransitionTimeout(f"{self.name} stays powered (statusword 0x{statusword:04X})")

    def _check_limits(self, move: DriveMove) -> None:
        if self.config.software_limits is None:
            return
        goal = move.target + (self.position() if move.relative else 0.0)
        low, high = self.config.software_limits
        if not low <= goal <= high:
            raise MoveRefused(f"{self.name}: target {goal:.3f} rad outside {low:.3f} to {high:.3f} rad")

    def _fault(self) -> DriveFault:
        told = self._link.emergencies[-1:] if self._link is not None else []
        code, register = told[0] if told else (self._connected().read(0x603F), 0)
        return DriveFault(f"{self.name} reports 0x{code:04X}, {cia402.error_text(code)}", code, register)


def start_together(moves: Sequence[tuple[Drive, DriveMove]]) -> float:
    """Begin moves of several drives as nearly at once as the bus can: both sides of a gantry.

    Everything slow is done before; the orders follow one another on the wire within a fraction of a
    millisecond. Returns the bus time of the first acknowledgement [s]. When one drive refuses, all are
    quick-stopped.
    """
    for drive, move in moves:
        drive.prepare(move)
    try:
        for drive, _ in moves:
            drive.trigger()
        return min([drive.confirm_started() for drive, _ in moves])
    except DriverError:
        for drive, _ in moves:
            with contextlib.suppress(DriverError):
                drive.command_quick_stop()
        raise
