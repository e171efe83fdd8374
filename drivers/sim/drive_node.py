"""A CiA 402 drive from the device's side of the wire: NMT, SDO, PDO on SYNC, heartbeats, EMCY, profile position.

Packed by hand from the standard, sharing nothing with the real driver but the EDS, so that their errors
cannot cancel. The machine calls, block after block: ``receive`` for each frame that takes effect now,
``plan`` for the set-points, then ``observe`` with what the physics made of them.

Not done: block SDO transfer, RPDOs that wait for a SYNC, modes other than profile position, homing (the
position of power-up is zero), a SYNC from the master, and a quartz error between this drive and the PC.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from drivers.sim.brake import HELD_FOR, HoldingBrake
from drivers.sim.communication import TICK, ErrorLog, HeartbeatProducer, MasterWatch, SyncProducer
from drivers.sim.dictionary import NO_OBJECT, NOT_IN_THIS_STATE, OUT_OF_RANGE, Dictionary, Key, SdoAbort
from drivers.sim.drive_config import DriveConfig
from drivers.sim.pdo import Pdo
from drivers.sim.physics import PhysicsBlock, Setpoint
from drivers.sim.positioning import HALT, ParameterMissing, Positioning
from drivers.sim.power_states import State, after_controlword
from drivers.sim.sdo_server import SdoServer, is_upload
from drivers.sim.tpdo_sender import TpdoSender
from drivers.sim.wire import Frame

PRE_OPERATIONAL, OPERATIONAL, STOPPED = 0x7F, 0x05, 0x04

FOLLOWING_ERROR = 0x8611
MASTER_LOST = 0x8130
PARAMETER_ERROR = 0x6320

_ALLOWED = {
    0x1003: range(1),
    0x1006: range(0, 1_000_000, 1000),
    0x1019: (0, *range(2, 241)),
    0x6007: range(4),
    0x605A: (0, 1, 2, 5, 6),
    0x6060: (0, 1),
    0x6086: (0, 2),
    0x60A3: (1,),
}
"""Values that this drive can take, by index; any other is refused as out of range."""

_SLOW_RAMP = (1, 5)
"""Quick-stop options (0x605A) that brake with 0x6084 instead of 0x6085."""


class DriveNode:
    """One drive. ``silence`` of the master is kept in ``master``, the motion in ``positioning``."""

    def __init__(self, config: DriveConfig, eds: Path, dt: float, seed: int) -> None:
        self.config = config
        self._dictionary = Dictionary(eds, config.node_id)
        self.values = self._dictionary.values
        self.positioning = Positioning(config, self._dictionary, dt)
        self.brake = HoldingBrake(None if config.brake_s is None else round(config.brake_s / TICK))
        self.master = MasterWatch(self._dictionary)
        self.sync = SyncProducer(self._dictionary)
        self._heartbeat = HeartbeatProducer(self._dictionary, config.node_id)
        self._errors = ErrorLog(self._dictionary)
        self._sdo = SdoServer(self._dictionary.read, self._write)
        self._rpdos = [Pdo(self._dictionary, 0x1400), Pdo(self._dictionary, 0x1401)]
        self._noise = np.random.default_rng([seed, config.node_id, 0])
        self._sender = TpdoSender(config, self._dictionary, seed)
        self._per_tick = round(TICK / dt)
        self._tick = 0
        self._outbox: list[Frame] = []
        self._last_sent = 0.0
        self._settled = self._astray = 0
        self._warning = False
        self._reset(communication_only=False)

    # -- what comes in ---------------------------------------------------------------------------------

    @property
    def situation(self) -> tuple[object, ...]:
        """What a command can change that others can see; compare before and after."""
        return self.nmt, self.state, self.brake.closing, self.positioning.acknowledged, self.positioning.moves

    def receive(self, can_id: int, data: bytes) -> list[Frame]:
        """Let a frame take effect; the answer, if the protocol has one, leaves at once."""
        if can_id == 0x000 and len(data) == 2 and data[1] in (0, self.config.node_id):
            self._nmt_command(data[0])
        elif can_id == 0x600 + self.config.node_id and self.nmt != STOPPED:
            response = self._sdo.respond(data)
            return [] if response is None else [(self._tick * TICK, 0x580 + self.config.node_id, response)]
        elif self.nmt == OPERATIONAL:
            for pdo in self._rpdos:
                if pdo.valid and pdo.cob_id == can_id:
                    self._take(pdo.unpack(data))
        return []

    def is_urgent(self, can_id: int, data: bytes) -> bool:
        """Whether a frame must not wait until the axis stands: it stops the motion, or only reads."""
        if can_id == 0x000:
            return len(data) == 2 and data[0] != 0x01 and data[1] in (0, self.config.node_id)
        if can_id == 0x600 + self.config.node_id:
            writes_controlword = data[1:4] == b"\x40\x60\x00" and len(data) == 8
            return is_upload(data) or (writes_controlword and _stops(int.from_bytes(data[4:6], "little")))
        commands = (p.unpack(data).get((0x6040, 0)) for p in self._rpdos if p.valid and p.cob_id == can_id)
        return any(word is not None and _stops(word) for word in commands)

    def hears_master(self, can_id: int) -> bool:
        """Take note of the master's heartbeat, and withdraw the error of having lost it."""
        heard = self.master.hears(can_id)
        if heard and self.values[0x603F, 0] == MASTER_LOST and not self._faulted:
            self._send_emergency(self._errors.clear())
        return heard

    @property
    def _faulted(self) -> bool:
        return self.state in (State.FAULT, State.FAULT_REACTION_ACTIVE)

    def _take(self, values: dict[Key, int]) -> None:
        previous = self.values[0x6040, 0]
        self.values.update(values)  # all of them first: the controlword may start a move to the new target
        if (0x6040, 0) in values:
            self._controlword(previous, values[0x6040, 0])

    def _nmt_command(self, command: int) -> None:
        if command == 0x01:
            self.nmt = OPERATIONAL
        elif command == 0x80:
            self.nmt = PRE_OPERATIONAL
        elif command == 0x02:
            self.nmt = STOPPED
            self.sync.restart()
            self._connection_aborted()
        elif command in (0x81, 0x82):
            self._reset(communication_only=command == 0x82)

    def _reset(self, communication_only: bool) -> None:
        """Restart: power off, the EDS' defaults, boot-up message, Pre-operational."""
        self._dictionary.restore(communication_only)
        self.positioning.power_off()
        self.state = State.SWITCH_ON_DISABLED
        self.nmt = PRE_OPERATIONAL
        self.master.silence = None
        self.sync.restart()
        self._heartbeat.restart(self._tick)
        self._send(0x700 + self.config.node_id, b"\x00")
        self._publish_state()

    # -- SDO writes ------------------------------------------------------------------------------------

    def _write(self, key: Key, data: bytes) -> None:
        value = self._dictionary.decode(key, data)
        self._check(key, value)
        if key[0] in self.config.faults.ignored_writes:
            return
        previous, self.values[key] = self.values[key], value
        self._written(key, previous, value)

    def _check(self, key: Key, value: int) -> None:
        """Refuse what this drive cannot take, or not now. Raises SdoAbort."""
        index = key[0]
        if self.config.faults.refuses_jerk_limit and index in (0x60A3, 0x60A4):
            raise SdoAbort(NO_OBJECT)
        unfit = self.config.faults.refuses_jerk_limit and index == 0x6086 and value == 2
        if unfit or value not in _ALLOWED.get(index, (value,)):
            raise SdoAbort(OUT_OF_RANGE)
        if index == 0x1019 and self.values[0x1006, 0]:
            raise SdoAbort(NOT_IN_THIS_STATE)
        if index in (0x1800, 0x1801) and key[1] == 2 and value not in range(1, 241):
            raise SdoAbort(OUT_OF_RANGE)
        for pdo in (*self._rpdos, *self._sender.pdos):
            pdo.check(key, value)

    def _written(self, key: Key, previous: int, value: int) -> None:
        if key == (0x6040, 0):
            self._controlword(previous, value)
        elif key == (0x6060, 0):
            self.values[0x6061, 0] = value
        elif key == (0x1017, 0):
            self._heartbeat.restart(self._tick)
        elif key in ((0x1005, 0), (0x1006, 0)):
            self.sync.restart()

    # -- the power state machine -----------------------------------------------------------------------

    def _controlword(self, previous: int, value: int) -> None:
        before = self.state
        target = after_controlword(before, value, previous, self.values[0x605A, 0])
        if before is State.FAULT and target is not before:
            self._send_emergency(self._errors.clear())
        self._go_to(target)
        if self.state is State.OPERATION_ENABLED and self.values[0x6061, 0] == 1:
            try:
                self.positioning.controlword(previous, value)
            except ParameterMissing:
                self._trip(PARAMETER_ERROR, register=0x20)
        self._publish_state()

    def _go_to(self, target: State) -> None:
        """Follow a controlword; the torque stays until the brake grips where the standard leaves the drive time."""
        enabled = self.state is State.OPERATION_ENABLED
        if enabled and target in HELD_FOR and self.brake.close(target):
            return
        if enabled and target is State.OPERATION_ENABLED and self.brake.closing:
            self.brake.open()
        self._enter(target)

    def _enter(self, state: State) -> None:
        if state is self.state:
            return
        before, self.state = self.state, state
        if state.powered:
            self.brake.open()
        else:
            self.brake.let_fall()
        if state is State.QUICK_STOP_ACTIVE:
            self._brake_for_quick_stop()
        elif state is State.OPERATION_ENABLED and not before.powered:
            self.positioning.power_on()
        elif not state.powered:
            self.positioning.power_off()
        self._publish_state()

    def _brake_for_quick_stop(self) -> None:
        option = self.values[0x605A, 0]
        if option == 0:
            self._enter(State.SWITCH_ON_DISABLED)
        else:
            self.positioning.brake(self.values[0x6084 if option in _SLOW_RAMP else 0x6085, 0])

    def _after_braking(self) -> None:
        """What follows when a quick stop or a fault reaction has come to rest."""
        if self.positioning.moving or self.brake.closing:
            return
        if self.state is State.FAULT_REACTION_ACTIVE:
            self._leave(State.FAULT)
        elif self.state is State.QUICK_STOP_ACTIVE and self.values[0x605A, 0] < 5:
            self._leave(State.SWITCH_ON_DISABLED)

    def _leave(self, state: State) -> None:
        """Enter a state without torque, once the brake grips."""
        if not self.brake.close(state):
            self._enter(state)

    def _trip(self, code: int, register: int) -> None:
        """Signal an error, brake by 0x6085 where there is power, and end in Fault."""
        self._send_emergency(self._errors.raise_error(code, register))
        braking = self.state.powered
        self._enter(State.FAULT_REACTION_ACTIVE if braking else State.FAULT)
        if braking:
            self.positioning.brake(self.values[0x6085, 0])

    def _connection_aborted(self) -> None:
        """0x6007: what the drive does of itself when the master is lost or has stopped the node."""
        option = self.values[0x6007, 0]
        if option == 1:
            self._trip(MASTER_LOST, register=0x10)
        elif self._faulted:
            return
        elif option == 2 or (option == 3 and not self.state.powered):
            self._enter(State.SWITCH_ON_DISABLED)
        elif option == 3 and self.state is State.OPERATION_ENABLED:
            self._enter(State.QUICK_STOP_ACTIVE)

    # -- one block -------------------------------------------------------------------------------------

    def plan(self, n: int) -> Setpoint:
        """The set-points of the next block of ``n`` sub-steps, after the drive's own reactions."""
        if self.master.lost():
            if self.values[0x6007, 0] != 1:
                self._send_emergency(self._errors.raise_error(MASTER_LOST, register=0x10))
            self._connection_aborted()
        faults, motion = self.config.faults, self.positioning
        in_that_move = faults.trip_in_move == motion.moves - 1 and self.state is State.OPERATION_ENABLED
        if in_that_move and motion.moving and motion.elapsed >= faults.trip_after_s:
            self._trip(faults.trip_code, register=0x02)
        if faults.warns_in_move == motion.moves - 1 and motion.moving and not self._warning:
            self._warning = True
            self._send_emergency(self._errors.raise_error(faults.warning_code, register=0x08))
        try:
            wanted = motion.setpoint(n)
        except ParameterMissing:
            self._trip(PARAMETER_ERROR, register=0x20)
            wanted = motion.setpoint(n)
        return replace(wanted, braked=self.brake.grips)

    def observe(
        self, setpoint: Setpoint, block: PhysicsBlock, first_tick: int, syncs: list[int]
    ) -> list[Frame]:
        """Everything that the drive sends in a block whose ticks begin with ``first_tick``, in its order."""
        count = len(block.motor_position) // self._per_tick
        samples = slice(self._per_tick - 1, None, self._per_tick)
        self.positioning.observe(block)
        self._watch_following_error(setpoint, block, samples)
        signals = self._signals(setpoint, block, samples)
        frames = []
        if self.nmt == OPERATIONAL:
            frames = self._sender.frames(signals, first_tick, syncs, self.positioning.moves)
        if not self._heart_stopped(first_tick):
            frames += self._heartbeat.frames(first_tick, count, self.nmt)
        self._tick = first_tick + count - 1
        for index, values in signals.items():
            self.values[index, 0] = int(values[-1])
        if (state := self.brake.pass_time(count, self.state.powered)) is not None:
            self._enter(state)
        self._after_braking()
        outbox, self._outbox = self._outbox, []
        return outbox + frames

    def sync_ticks(self, first: int, count: int) -> list[int]:
        return [] if self.nmt == STOPPED else self.sync.ticks(first, count)

    def _signals(
        self, setpoint: Setpoint, block: PhysicsBlock, samples: slice
    ) -> dict[int, NDArray[np.int64]]:
        """The objects that change within a block, at each of its ticks, in the drive's own units."""
        config = self.config
        speed = block.motor_speed[samples]
        speed = speed + config.speed_noise_rad_s * self._noise.standard_normal(len(speed))
        per_mille = block.motor_torque[samples] * 1e6 / self.values[0x6076, 0]
        return {
            0x6064: _whole(block.motor_position[samples] / config.count_rad, 31),
            0x606C: _whole(speed / config.speed_lsb_rad_s, 31),
            0x6077: _whole(per_mille, 15),
            0x6041: self._statuswords(setpoint, block, samples),
        }

    def _statuswords(self, setpoint: Setpoint, block: PhysicsBlock, samples: slice) -> NDArray[np.int64]:
        enough = round(self.config.position_window_s / TICK)
        words = []
        for inside in self.positioning.at_target(setpoint, block, samples):
            self._settled = self._settled + 1 if inside else 0
            words.append(self._status_base() | (self._settled >= enough) << 10)
        return np.array(words)

    def _status_base(self) -> int:
        """The statusword without bit 10: state, voltage (4), warning (7), remote (9), limit (11), 12, 13."""
        motion = self.positioning
        following_error = self.values[0x603F, 0] == FOLLOWING_ERROR
        bits = self._warning << 7 | motion.limited << 11 | motion.acknowledged << 12 | following_error << 13
        return self.state.value | 0x0210 | bits

    def _publish_state(self) -> None:
        """Between blocks the statusword keeps its bit 10 and follows the state at once."""
        self.values[0x6041, 0] = self._status_base() | self.values[0x6041, 0] & 1 << 10

    def _watch_following_error(self, setpoint: Setpoint, block: PhysicsBlock, samples: slice) -> None:
        if self.state is not State.OPERATION_ENABLED:
            self._astray = 0
            return
        error = np.abs(setpoint.position[samples] - block.motor_position[samples])
        outside = int(np.count_nonzero(error > self.config.following_error_rad))
        self._astray = self._astray + outside if outside else 0
        if self._astray * TICK > self.config.following_error_s:
            self._trip(FOLLOWING_ERROR, register=0x20)

    # -- what goes out ---------------------------------------------------------------------------------

    def _heart_stopped(self, first_tick: int) -> bool:
        stops_at = self.config.faults.heartbeat_stops_at_s
        return stops_at is not None and first_tick * TICK >= stops_at

    def _send(self, can_id: int, data: bytes) -> None:
        self._outbox.append((self._tick * TICK, can_id, data))

    def _send_emergency(self, payload: bytes) -> None:
        self._send(0x80 + self.config.node_id, payload)


def _stops(controlword: int) -> bool:
    """Whether a controlword takes the axis out of motion: anything but Enable operation, or halt."""
    return controlword & 0x8F != 0x0F or bool(controlword & HALT)


def _whole(values: NDArray[np.float64], bits: int) -> NDArray[np.int64]:
    """Rounded and limited to a signed integer of ``bits`` + 1 bits."""
    limit = 2.0**bits
    return np.clip(np.rint(values), -limit, limit - 1).astype(np.int64)
