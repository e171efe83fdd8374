"""A simulated axis on vcan0, as a process of its own: ``python -m tests.socketcan.simulated`` until it is ended.

The machine runs paced on its virtual bus; a bridge puts its frames on vcan0 at their time and brings the
master's back. Rates are low and the axis is rigid: a system call costs the guest 50 µs, and physics is tried
elsewhere.
"""

from __future__ import annotations

import socket
import struct
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass

import can
import numpy as np
from can.interfaces.virtual import VirtualBus

from drivers.sim.accelerometer_node import AccelerometerConfig
from drivers.sim.drive_config import DriveConfig
from drivers.sim.machine import SimulatedMachine
from drivers.sim.physics import FloatArray, Setpoint

CHANNEL = "vcan0"
NODE, DATA_ID, TIME_ID = 3, 0x303, 0x313
SAMPLE_RATE = 1000.0
PINION_DIAMETER, GEAR_RATIO = 0.06, 10.0

_FRAME = struct.Struct("=IB3x8s")


@dataclass(frozen=True)
class RigidBlock:
    """See ``PhysicsBlock``."""

    motor_position: FloatArray
    motor_speed: FloatArray
    motor_torque: FloatArray
    load_acceleration: FloatArray


class RigidAxis:
    """An axis without backlash, friction and elasticity: it is where its set-point is, or stands."""

    axes = ("Y",)
    dt = 0.001

    def __init__(self) -> None:
        self._position = 0.0

    def advance(self, duration: float, setpoints: Sequence[Setpoint]) -> list[RigidBlock]:
        """See ``Physics``."""
        (wanted,) = setpoints
        if not wanted.enabled:
            still = np.zeros(round(duration / self.dt))
            return [RigidBlock(still + self._position, still, still, still)]
        self._position = float(wanted.position[-1])
        load = wanted.acceleration * PINION_DIAMETER / (2 * GEAR_RATIO)
        return [RigidBlock(wanted.position, wanted.speed, 0.01 * wanted.acceleration, load)]


def main() -> None:
    """Switch the machine on and bridge for ever."""
    drive = DriveConfig("Y", NODE, "inside")
    sensor = AccelerometerConfig("Y", "inside", DATA_ID, TIME_ID, nominal_rate_hz=SAMPLE_RATE)
    outside = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
    outside.bind((CHANNEL,))
    inside = VirtualBus(channel="inside", preserve_timestamps=True)
    threading.Thread(target=_bring_in, args=(outside, inside), daemon=True).start()
    with SimulatedMachine(["inside"], [drive], [sensor], RigidAxis(), seed=1, paced=True):
        _bring_out(inside, outside)


def _bring_in(outside: socket.socket, inside: VirtualBus) -> None:
    while True:
        can_id, length, data = _FRAME.unpack(outside.recv(_FRAME.size))
        inside.send(can.Message(arbitration_id=can_id, is_extended_id=False, data=data[:length]))


def _bring_out(inside: VirtualBus, outside: socket.socket) -> None:
    """Send each frame at its machine time, some blocks later: the machine makes 5 ms of frames at once."""
    behind = None
    while True:
        message = inside.recv()
        assert message is not None
        if behind is None:
            behind = time.monotonic() - message.timestamp + 0.02
        wait = message.timestamp + behind - time.monotonic()
        if wait > 0.004:
            time.sleep(wait)
        outside.send(_FRAME.pack(message.arbitration_id, message.dlc, bytes(message.data)))


if __name__ == "__main__":
    main()
