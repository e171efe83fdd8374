"""What the tests of the simulated machine share: trivial physics, a bench without threads, a master of raw frames.

Nothing here uses the real drivers: frames are literal bytes or packed by hand.
"""

from __future__ import annotations

import itertools
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace

import can
import numpy as np

from drivers.sim.accelerometer_node import AccelerometerConfig, AccelerometerNode
from drivers.sim.core import Line, MachineCore
from drivers.sim.drive_config import DriveConfig
from drivers.sim.drive_node import DriveNode
from drivers.sim.machine import EDS, SimulatedMachine
from drivers.sim.physics import FloatArray, Setpoint
from drivers.sim.wire import Frame, Wire

DT = 0.000125
LOAD_PER_MOTOR = 0.003  # m/rad
COASTING_DECAY = 5.0  # 1/s

DRIVE = DriveConfig("X1", 5, "", speed_noise_rad_s=0.0)
SENSOR = AccelerometerConfig("X1", "", 0x300, 0x310)

_numbers = itertools.count()


@dataclass
class Block:
    motor_position: FloatArray
    motor_speed: FloatArray
    motor_torque: FloatArray
    load_acceleration: FloatArray


class Rigid:
    """Motors that follow their set-points exactly; without torque they coast, their speed decaying."""

    dt = DT

    def __init__(self, axes: Sequence[str] = ("X1",)) -> None:
        self.axes = axes
        self.history: dict[str, list[Setpoint]] = {axis: [] for axis in axes}
        self._at = dict.fromkeys(axes, (0.0, 0.0))

    def advance(self, duration: float, setpoints: Sequence[Setpoint]) -> list[Block]:
        return [self._advance(axis, duration, s) for axis, s in zip(self.axes, setpoints, strict=True)]

    def _advance(self, axis: str, duration: float, setpoint: Setpoint) -> Block:
        n = round(duration / self.dt)
        assert len(setpoint.position) == n
        self.history[axis].append(setpoint)
        x, v, a = setpoint.position, setpoint.speed, setpoint.acceleration
        if not setpoint.enabled:
            x0, v0 = self._at[axis]
            v = v0 * np.exp(-COASTING_DECAY * self.dt * np.arange(1, n + 1))
            x, a = x0 + np.cumsum(v) * self.dt, -COASTING_DECAY * v
        self._at[axis] = (float(x[-1]), float(v[-1]))
        return Block(x, v, 0.001 * a, LOAD_PER_MOTOR * a)


class Scripted:
    """One axis whose signals are functions of time, whatever the drive wants."""

    dt = DT
    axes = ("X1",)

    def __init__(self, **signals: Callable[[FloatArray], FloatArray] | float) -> None:
        self._signals, self._n = signals, 0

    def advance(self, duration: float, setpoints: Sequence[Setpoint]) -> list[Block]:
        n = round(duration / self.dt)
        t = np.arange(self._n + 1, self._n + n + 1) * self.dt
        self._n += n
        names = ("motor_position", "motor_speed", "motor_torque", "load_acceleration")
        return [Block(*(self._signal(name, t) for name in names))]

    def _signal(self, name: str, t: FloatArray) -> FloatArray:
        signal = self._signals.get(name, 0.0)
        return signal(t) if callable(signal) else np.full(len(t), float(signal))


def channel() -> str:
    """A virtual channel that no other test uses."""
    return f"sim-test-{next(_numbers)}"


class Bench:
    """One bus of a machine without its thread: the test sends frames and lets time pass."""

    def __init__(
        self,
        physics: Rigid | Scripted | None = None,
        drives: Sequence[DriveConfig] = (DRIVE,),
        accelerometers: Sequence[AccelerometerConfig] = (),
        seed: int = 1,
    ) -> None:
        self.physics = physics or Rigid()
        name = channel()
        self.bus = can.Bus(interface="virtual", channel=name, preserve_timestamps=True)
        self.line = Line(
            Wire(name),
            [DriveNode(replace(d, bus=name), EDS, DT, seed) for d in drives],
            [AccelerometerNode(replace(a, bus=name), DT, seed) for a in accelerometers],
        )
        self.core = MachineCore([self.line], self.physics)

    @property
    def drive(self) -> DriveNode:
        return self.line.drives[0]

    def close(self) -> None:
        self.line.wire.close()
        self.bus.shutdown()

    def send(self, frame: str) -> None:
        """A frame as candump writes it, ``605#40001000``; it takes effect now."""
        self.bus.send(message(frame))
        while (command := self.core.receive(0.0)) is not None:
            self.core.apply(command)

    def step(self, ticks: int, block: int = 5) -> list[Frame]:
        """Let time pass; the frames seen meanwhile, and those not yet read before."""
        for begin in range(0, ticks, block):
            self.core.step(min(block, ticks - begin))
        return self.read()

    def read(self) -> list[Frame]:
        frames = []
        while (m := self.bus.recv(0.0)) is not None:
            frames.append((m.timestamp, m.arbitration_id, bytes(m.data)))
        return frames

    def ask(self, frame: str) -> str:
        """Send a request and return the one answer, payload only."""
        self.read()
        self.send(frame)
        (answer,) = self.read()
        return answer[2].hex()

    def write(self, index: int, sub: int, value: int, size: int) -> None:
        """SDO download that must be accepted."""
        assert self.ask(sdo_write(index, sub, value, size))[:2] == "60"

    def command(self, controlword: int, target: int = 0, node: int = 5) -> None:
        """RPDO1."""
        self.send(rpdo(controlword, target, node))

    def set_up(self) -> None:
        """SYNC at 1 kHz, a jerk-limited profile, operational."""
        for request in SET_UP:
            assert self.ask(sdo_write(*request))[:2] == "60", request
        self.send("000#0105")

    def enable(self) -> None:
        self.set_up()
        for controlword in (0x06, 0x07, 0x0F):
            self.command(controlword)
        self.step(20)


SET_UP = [
    (0x1019, 0, 240, 1),
    (0x1006, 0, 1000, 4),
    (0x1005, 0, 0x40000080, 4),
    (0x1016, 1, 127 << 16 | 300, 4),
    (0x6007, 0, 3, 2),
    (0x6060, 0, 1, 1),
    (0x6086, 0, 2, 2),
    (0x60A4, 1, 66667, 4),
    (0x6081, 0, 10_000, 4),  # 52 rad/s
    (0x6083, 0, 20_000, 4),  # 2000 rad/s²
    (0x6084, 0, 20_000, 4),
    (0x6085, 0, 50_000, 4),  # 5000 rad/s²
]
STEP_COUNTS = 13_908  # 1.3333 rad, 4 mm at 3 mm/rad


def message(frame: str) -> can.Message:
    can_id, _, data = frame.partition("#")
    return can.Message(arbitration_id=int(can_id, 16), data=bytes.fromhex(data), is_extended_id=False)


def sdo_write(index: int, sub: int, value: int, size: int, node: int = 5) -> str:
    head = 0x23 | (4 - size) << 2
    data = value.to_bytes(size, "little", signed=value < 0).ljust(4, b"\0")
    return f"{0x600 + node:x}#{head:02x}{index.to_bytes(2, 'little').hex()}{sub:02x}{data.hex()}"


def rpdo(controlword: int, target: int, node: int = 5) -> str:
    data = controlword.to_bytes(2, "little") + target.to_bytes(4, "little", signed=True)
    return f"{0x200 + node:x}#{data.hex()}"


def statusword(frame: Frame) -> int:
    """Of a TPDO1 in its default mapping."""
    return int.from_bytes(frame[2][6:8], "little")


def speed(frame: Frame) -> int:
    return int.from_bytes(frame[2][0:4], "little", signed=True)


def of(frames: Sequence[Frame], can_id: int) -> list[Frame]:
    return [f for f in frames if f[1] == can_id]


class RawMaster:
    """A master of raw frames that beats by the wall clock from a thread, as a supervisor would."""

    def __init__(self, name: str, nodes: Sequence[int] = (5,)) -> None:
        self.bus = can.Bus(interface="virtual", channel=name, preserve_timestamps=True)
        self.nodes = nodes
        self.frames: list[Frame] = []
        self.beating = threading.Event()
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._beat)
        self._thread.start()

    def _beat(self) -> None:
        while not self._end.wait(0.1):
            if self.beating.is_set():
                self.bus.send(message("77f#05"))

    def close(self) -> None:
        self._end.set()
        self._thread.join()
        self.bus.shutdown()

    def send(self, frame: str) -> None:
        self.bus.send(message(frame))

    def wait(self, condition: Callable[[Frame], bool], timeout: float = 20.0) -> Frame:
        """The next frame that meets the condition; everything seen is kept."""
        deadline = time.monotonic() + timeout
        while time.monotonic() < deadline:
            m = self.bus.recv(0.5)
            if m is not None:
                frame = (m.timestamp, m.arbitration_id, bytes(m.data))
                self.frames.append(frame)
                if condition(frame):
                    return frame
        raise AssertionError("the frame waited for did not come")

    def listen(self, duration: float) -> None:
        """Read whatever comes for this long [s of wall time], and say nothing."""
        deadline = time.monotonic() + duration
        while (left := deadline - time.monotonic()) > 0:
            if (m := self.bus.recv(left)) is not None:
                self.frames.append((m.timestamp, m.arbitration_id, bytes(m.data)))

    def set_up(self) -> None:
        for node in self.nodes:
            for k, request in enumerate(SET_UP):
                if node != self.nodes[0] and k < 3:
                    continue  # one SYNC producer
                self.send(sdo_write(*request, node=node))
                answer = self.wait(lambda f, node=node: f[1] == 0x580 + node)
                assert answer[2][0] == 0x60
        self.send("000#0100")

    def enable(self) -> None:
        for node in self.nodes:
            for controlword, state in ((0x06, 0x21), (0x07, 0x23), (0x0F, 0x27)):
                self.send(rpdo(controlword, 0, node))
                self.wait_status(lambda s, state=state: s & 0x6F == state, node)

    def wait_status(self, condition: Callable[[int], bool], node: int = 5) -> Frame:
        return self.wait(lambda f: f[1] == 0x180 + node and condition(statusword(f)))

    def go(self, target: int) -> Frame:
        """Command a set-point to all nodes, complete the handshake, wait for the end; the last status frame."""
        for node in self.nodes:
            self.send(rpdo(0x1F, target, node))
        for node in self.nodes:
            self.wait_status(lambda s: bool(s & 0x1000), node)
        for node in self.nodes:
            self.send(rpdo(0x0F, target, node))
        ends = [self.wait_status(lambda s: s & 0x1400 == 0x0400, node) for node in self.nodes]
        return ends[-1]

    def rest(self, duration: float, since: float) -> None:
        """Let bus time pass."""
        self.wait(lambda f: f[0] > since + duration)


@contextmanager
def raw_master(machine: SimulatedMachine, name: str, nodes: Sequence[int] = (5,)) -> Iterator[RawMaster]:
    with machine:
        master = RawMaster(name, nodes)
        try:
            yield master
        finally:
            master.close()
