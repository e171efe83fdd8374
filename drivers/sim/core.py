"""The machine without a clock of its own: nodes, wires and physics, moved on tick by tick by whoever paces it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from drivers.sim.accelerometer_node import AccelerometerNode
from drivers.sim.communication import TICK
from drivers.sim.drive_node import DriveNode
from drivers.sim.physics import Physics, PhysicsBlock, Setpoint
from drivers.sim.power_states import State
from drivers.sim.wire import Frame, Wire

_POLL = 0.001
"""How long one bus is listened to while another may speak [s of wall time]."""


@dataclass
class Line:
    """One bus and what is plugged into it."""

    wire: Wire
    drives: list[DriveNode] = field(default_factory=list)
    accelerometers: list[AccelerometerNode] = field(default_factory=list)

    def emit(
        self, setpoints: Mapping[str, Setpoint], blocks: Mapping[str, PhysicsBlock], first: int, count: int
    ) -> None:
        """Let the nodes send what they have to say about the ticks first … first + count - 1."""
        until = (first + count - 1) * TICK
        beats = {d.config.node_id: d.sync_ticks(first, count) for d in self.drives}
        syncs = sorted({tick for ticks in beats.values() for tick in ticks})
        frames: list[Frame] = [d.sync.frame(t) for d in self.drives for t in beats[d.config.node_id]]
        for drive in self.drives:
            axis = drive.config.axis
            frames += drive.observe(setpoints[axis], blocks[axis], first, syncs)
        for sensor in self.accelerometers:
            frames += sensor.observe(blocks[sensor.config.axis].load_acceleration, until)
        self.wire.queue(frames)
        self.wire.flush(until)


@dataclass(frozen=True)
class Command:
    """A frame from the master, and the bus it came on; heartbeats are not commands."""

    line: Line
    can_id: int
    data: bytes


class MachineCore:
    """Nodes and physics under one machine time, which stands still except in ``step``."""

    def __init__(self, lines: Sequence[Line], physics: Physics) -> None:
        self.tick = 0
        self._lines = lines
        self._physics = physics
        self._per_tick = round(TICK / physics.dt)
        if self._per_tick < 1 or abs(self._per_tick * physics.dt - TICK) > 1e-9:
            raise ValueError(
                f"the physics' step {physics.dt} s is no whole part of the machine's tick {TICK} s"
            )
        self.drives = [drive for line in lines for drive in line.drives]

    @property
    def time(self) -> float:
        return self.tick * TICK

    # -- what comes in

    def receive(self, timeout: float) -> Command | None:
        """The next command of any bus, waiting for about ``timeout`` [s]; heartbeats are heard in passing."""
        talkative = max(1, sum(bool(line.drives) for line in self._lines))
        rounds = 1 if talkative == 1 else max(1, round(timeout / talkative / _POLL))
        for _ in range(rounds):
            for line in self._lines:
                wait = timeout / rounds / talkative if line.drives else 0.0
                if (command := _next_command(line, wait)) is not None:
                    return command
        return None

    def apply(self, command: Command) -> None:
        """Let a command take effect at the present machine time."""
        for drive in command.line.drives:
            command.line.wire.send_now(drive.receive(command.can_id, command.data))

    def is_urgent(self, command: Command) -> bool:
        """Whether it may not wait until the axes stand: it stops one of them, or only reads."""
        return any(drive.is_urgent(command.can_id, command.data) for drive in command.line.drives)

    # -- what the pacing must know

    @property
    def situation(self) -> tuple[tuple[object, ...], ...]:
        """Changes when a command did something that the frames will show."""
        return tuple(drive.situation for drive in self.drives)

    @property
    def moves(self) -> int:
        """Set-points begun so far by all drives."""
        return sum(drive.positioning.moves for drive in self.drives)

    @property
    def powered(self) -> int:
        return sum(drive.state is State.OPERATION_ENABLED for drive in self.drives)

    @property
    def moving(self) -> bool:
        return any(drive.positioning.moving for drive in self.drives)

    @property
    def driven(self) -> bool:
        """Whether an axis moves by its drive's set-points, which come to an end."""
        return any(drive.positioning.driven for drive in self.drives)

    @property
    def closing_brake(self) -> bool:
        """Whether a drive keeps its torque until its brake grips."""
        return any(drive.brake.closing for drive in self.drives)

    @property
    def waiting_to_join(self) -> bool:
        """Whether an enabled drive stands while another moves."""
        ready = [d.positioning.moving for d in self.drives if d.state is State.OPERATION_ENABLED]
        return any(ready) and not all(ready)

    @property
    def acknowledging(self) -> bool:
        """Whether a set-point was acknowledged and the master has not yet taken bit 4 back."""
        return any(drive.positioning.acknowledged for drive in self.drives)

    @property
    def listened_to(self) -> bool:
        return any(line.wire.heard for line in self._lines)

    @property
    def backlog(self) -> int:
        return max(line.wire.backlog for line in self._lines)

    def patience_of_drives(self) -> int | None:
        """Ticks until the first drive declares the master lost; None while none is watching it."""
        left = (watch.limit - watch.silence for d in self.drives if (watch := d.master).silence is not None)
        return min((ticks for ticks in left), default=None)

    # -- time

    def step(self, count: int) -> None:
        """Let ``count`` ticks pass."""
        n = count * self._per_tick
        plans = {drive.config.axis: drive.plan(n) for drive in self.drives}
        setpoints = {axis: plans.get(axis) or _unpowered(n) for axis in self._physics.axes}
        moved = self._physics.advance(count * TICK, list(setpoints.values()))
        blocks = dict(zip(self._physics.axes, moved, strict=True))
        for drive in self.drives:
            drive.master.pass_time(count)
        first, self.tick = self.tick + 1, self.tick + count
        for line in self._lines:
            line.emit(setpoints, blocks, first, count)


def _next_command(line: Line, timeout: float) -> Command | None:
    while (frame := line.wire.receive(timeout)) is not None:
        can_id, data = frame
        if not 0x700 < can_id < 0x780:
            return Command(line, can_id, data)
        for drive in line.drives:
            drive.hears_master(can_id)
    return None


def _unpowered(n: int) -> Setpoint:
    nothing = np.zeros(n)
    return Setpoint(False, nothing, nothing, nothing)
