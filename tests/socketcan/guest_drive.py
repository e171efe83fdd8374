"""In the guest: the drive's master against durand, a CANopen slave that shares no code with it, over vcan0."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import ExitStack
from math import pi

import can
import pytest

from drivers import errors
from drivers.bus import Bus, BusConfig
from drivers.cia402 import State
from drivers.drive import Drive, DriveConfig, DriveMove
from tests.drivers.durand_drive import NODE, SPEED_COUNTS, SYNC_PERIOD, DurandDrive, durand_drive

BUS = BusConfig("socketcan", "vcan0")
CONFIG = DriveConfig(
    "X1",
    NODE,
    counts_per_rev=1000,
    speed_lsb_rad_s=0.01,
    sync_producer=False,
    sync_period=SYNC_PERIOD,
    heartbeat_period=0.05,
    heartbeat_patience=2.0,
    quick_stop_deceleration=500.0,
    software_limits=(-1000.0, 1000.0),
)
MOVE = DriveMove(target=2 * pi * 20, speed=30.0, acceleration=100.0, jerk=5000.0, duration=0.05, timeout=20.0)
FAR = DriveMove(target=2 * pi * 150, speed=30.0, acceleration=100.0, jerk=5000.0, duration=0.05, timeout=20.0)

Machine = tuple[Drive, DurandDrive, Bus]


@pytest.fixture
def machine() -> Iterator[Machine]:
    """A connected drive, its other end, and the bus between."""
    with ExitStack() as stack:
        peer = stack.enter_context(durand_drive("vcan0", interface="socketcan"))
        bus = stack.enter_context(Bus(BUS))
        yield stack.enter_context(Drive(bus, CONFIG)), peer, bus


def test_a_move_from_enable_to_disable(machine: Machine) -> None:
    drive, peer, bus = machine
    with bus.recording() as recorder:
        with drive.enabled():
            started = drive.start(MOVE)
            ended = drive.wait_standstill()
        assert (peer.position, peer.powered) == (20_000, False)
        assert drive.position() == pytest.approx(2 * pi * 20)
        frames = recorder.frames()
    assert bus.health.dropped == bus.health.handler_errors == 0
    assert started < ended <= bus.time
    # Not by drive.traces: durand's SYNC comes from a thread of Python's, which no counter makes even.
    speeds = frames.of(0x180 + NODE).payload[:, :4].copy().view("<i4")[:, 0]
    assert speeds[speeds != 0].tolist() == [SPEED_COUNTS] * (20_000 // SPEED_COUNTS)


def test_quick_stop_in_mid_move(machine: Machine) -> None:
    drive, peer, _ = machine
    with drive.enabled():
        drive.start(FAR)
        drive.quick_stop()
        assert drive.state is not State.ENABLED
    assert 0 < peer.position < 150_000
    assert not peer.powered


def test_an_emergency_ends_the_wait_by_its_code(machine: Machine) -> None:
    drive, peer, _ = machine
    with pytest.raises(errors.DriveFault, match="0x2310"), drive.enabled():
        drive.start(FAR)
        peer.emergency(0x2310)
        drive.wait_standstill()
    assert not peer.powered


def test_the_masters_heartbeat_ends_with_its_supervisor() -> None:
    """Nothing in the kernel goes on sending it."""
    with can.Bus(interface="socketcan", channel="vcan0") as other, Bus(BUS) as bus:

        def beats_in(duration: float) -> int:
            end, count = time.monotonic() + duration, 0
            while time.monotonic() < end:
                bus.feed() if fed else None
                message = other.recv(0.02)
                count += message is not None and message.arbitration_id == 0x77F
            return count

        fed = True
        assert beats_in(1.05) in range(8, 13)
        fed = False
        beats_in(1.2)  # the supervisor's patience is 1 s
        assert beats_in(0.5) == 0
