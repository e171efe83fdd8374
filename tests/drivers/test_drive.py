"""The drive's master against a slave that shares no code with it (durand), on real time, without tight limits."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from math import pi
from typing import Any

import can
import numpy as np
import pytest

from drivers import errors
from drivers.bus import Bus, BusConfig, open_python_can
from drivers.cia402 import State
from drivers.drive import Drive, DriveConfig, DriveMove, start_together
from tests.drivers.durand_drive import NODE, SPEED_COUNTS, SYNC_PERIOD, DurandDrive, durand_drive

CHANNEL = "test_drive"
BUS = BusConfig("virtual", CHANNEL)
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


def eventually(condition: Callable[[], bool], patience: float = 10.0) -> bool:
    """Wait for a condition on real time."""
    end = time.monotonic() + patience
    while not (found := condition()) and time.monotonic() < end:
        time.sleep(0.002)
    return found


@contextmanager
def machine(config: DriveConfig = CONFIG, **options: Any) -> Iterator[tuple[Drive, DurandDrive, Bus]]:
    """A connected drive, its other end, and the bus between."""
    with ExitStack() as stack:
        peer = stack.enter_context(durand_drive(CHANNEL, **options))
        bus = stack.enter_context(Bus(BUS))
        yield stack.enter_context(Drive(bus, config)), peer, bus


def test_connecting_writes_protections_and_mapping() -> None:
    with machine() as (drive, peer, _):
        od = peer.od
        assert od.read(0x1016, 1) == 0x007F_012C  # node 127, 300 ms
        assert od.read(0x1017, 0) == 50
        assert od.read(0x6007, 0) == 3
        assert od.read(0x605A, 0) == 2
        assert od.read(0x6085, 0) == 5000
        assert (od.read(0x607D, 1), od.read(0x607D, 2)) == (-159155, 159155)
        assert [od.read(0x1A00, k) for k in range(4)] == [3, 0x606C_0020, 0x6077_0010, 0x6041_0010]
        assert [od.read(0x1600, k) for k in range(3)] == [2, 0x6040_0010, 0x607A_0020]
        assert (od.read(0x1800, 2), od.read(0x1400, 2)) == (1, 255)
        assert (od.read(0x6060, 0), od.read(0x6086, 0)) == (1, 2)
        assert od.read(0x1019, 0) == 240
        assert drive.rated_torque == 5.0
        drive.check()
        assert eventually(lambda: drive._linked()._tpdo is not None)
        assert drive.state is State.SWITCH_ON_DISABLED


def test_disconnected_the_drive_is_silent_and_says_so() -> None:
    with machine() as (drive, peer, bus):
        drive.disconnect()
        drive.disconnect()
        assert eventually(lambda: peer.node.nmt.state == 127)
        with pytest.raises(errors.NodeSilent, match="not connected"):
            drive.check()
        assert not bus.network.nodes


def test_the_drive_is_left_as_it_was_found() -> None:
    with machine() as (drive, peer, _):
        with drive.enabled():
            drive.start(MOVE)
            drive.wait_standstill()
        drive.disconnect()
        od = peer.od
        assert [od.read(i, 0) for i in (0x6007, 0x605A, 0x6060, 0x6081, 0x6083, 0x6085, 0x6086)] == [
            1,
            2,
            0,
            0,
            0,
            0,
            0,
        ]
        assert (od.read(0x60A4, 1), od.read(0x607D, 2)) == (0, 0)
        assert (od.read(0x1016, 1), od.read(0x1005, 0)) == (0, 0x80)


def test_a_move_from_enable_to_disable() -> None:
    with machine() as (drive, peer, bus), bus.recording() as recorder:
        with drive.enabled():
            assert drive.state is State.ENABLED
            started = drive.start(MOVE)
            ended = drive.wait_standstill()
        assert not peer.powered
        assert peer.position == 20_000
        assert drive.position() == pytest.approx(2 * pi * 20)
        assert started < ended <= bus.time
        assert (peer.od.read(0x60A4, 1), peer.od.read(0x6081, 0)) == (5000, 3000)
        assert (peer.od.read(0x6083, 0), peer.od.read(0x6084, 0)) == (1000, 1000)
    assert peer.controlwords[:3] == [0x06, 0x07, 0x0F]
    assert 0x5F in peer.controlwords
    # Disable operation first, which leaves the drive the time to close its brake; then the voltage.
    assert peer.controlwords[-2:] == [0x07, 0x00]
    record = drive.traces(recorder.frames())
    moving = record.speed.value > 0
    assert record.speed.value[moving] == pytest.approx(np.full(20, SPEED_COUNTS * 0.01))
    assert record.torque.value == pytest.approx(np.full(len(record.torque), 0.25 * 5.0))
    assert np.all(np.diff(record.speed.time) > 0)


def test_positive_travel_with_an_inverted_drive() -> None:
    with machine(replace(CONFIG, direction=-1)) as (drive, peer, _), drive.enabled():
        drive.start(MOVE)
        drive.wait_standstill()
        assert peer.position == -20_000
        assert drive.position() == pytest.approx(2 * pi * 20)


def test_absolute_and_consecutive_moves() -> None:
    with machine() as (drive, peer, _), drive.enabled():
        for goal in (10.0, -5.0, 0.0):
            drive.start(replace(MOVE, target=2 * pi * goal, relative=False))
            drive.wait_standstill()
            assert peer.position == 1000 * goal


def test_the_axis_is_disabled_whatever_happens_inside() -> None:
    with machine() as (drive, peer, _):
        with pytest.raises(KeyError), drive.enabled():
            drive.start(MOVE)
            raise KeyError("in mid-move")
        assert not peer.powered
        assert 0x02 in peer.controlwords


def test_quick_stop_in_mid_move() -> None:
    with machine() as (drive, peer, _), drive.enabled():
        drive.start(replace(MOVE, target=2 * pi * 150, relative=False))
        drive.quick_stop()
        assert not peer.powered
        assert abs(peer.position) < 150_000
        with pytest.raises(errors.MoveNotFinished, match="switch on disabled"):
            drive.wait_standstill()


def test_emergency_in_mid_move_raises_code_and_text() -> None:
    told: list[str] = []
    with ExitStack() as stack:
        peer = stack.enter_context(durand_drive(CHANNEL))
        bus = stack.enter_context(Bus(BUS))
        drive = stack.enter_context(Drive(bus, CONFIG, on_fault=lambda d: told.append(d.name)))
        with (
            pytest.raises(
                errors.DriveFault, match=r"X1 \(node 5\) reports 0x8611, following error"
            ) as caught,
            drive.enabled(),
        ):
            drive.start(replace(MOVE, target=2 * pi * 150, relative=False))
            peer.emergency(0x8611)
            drive.wait_standstill()
        assert (caught.value.code, caught.value.register) == (0x8611, 0x21)
        assert told == ["X1 (node 5)"]
        with pytest.raises(errors.DriveFault), drive.enabled():
            pass
        drive.reset_fault()
        with drive.enabled():
            assert peer.powered


def test_an_emergency_of_a_drive_that_goes_on_is_a_remark_and_stops_nothing() -> None:
    told: list[str] = []
    with ExitStack() as stack:
        peer = stack.enter_context(durand_drive(CHANNEL))
        bus = stack.enter_context(Bus(BUS))
        drive = stack.enter_context(Drive(bus, CONFIG, on_fault=lambda d: told.append(d.name)))
        assert drive.remarks() == ()
        with drive.enabled():
            drive.start(MOVE)
            peer.warn(0x4310)
            drive.wait_standstill()
        assert peer.position == 20_000
        assert told == []
        (remark,) = drive.remarks()
        assert "0x4310, drive too hot (error register 0x09), and went on" in remark


def test_a_fault_whose_emergency_was_lost_is_read_from_the_drive() -> None:
    with machine() as (drive, peer, _):
        peer.node.emcy.enable = False
        with pytest.raises(errors.DriveFault, match="0x7305") as caught, drive.enabled():
            peer.emergency(0x7305)
            drive.start(MOVE)
            drive.wait_standstill()
        assert caught.value.code == 0x7305


def test_a_drive_that_booted_again_must_be_connected_again() -> None:
    with machine() as (drive, peer, _):
        peer.reboot()
        with pytest.raises(errors.NodeRestarted, match="booted again"):
            eventually(lambda: drive.check() is not None)
        with pytest.raises(errors.NodeRestarted), drive.enabled():
            pass
        drive.connect()
        with drive.enabled():
            pass


@pytest.mark.parametrize("index", [0x6086, 0x60A4])
@pytest.mark.parametrize("how", ["refuse", "forget"])
def test_a_drive_without_a_jerk_limited_profile_is_refused(index: int, how: str) -> None:
    match = f"0x{index:04X}.*some drives have no jerk-limited"
    with durand_drive(CHANNEL, **{how: {index}}) as peer, Bus(BUS) as bus:
        with pytest.raises(errors.JerkProfileRefused, match=match), Drive(bus, CONFIG):
            pass
        assert not peer.controlwords


@pytest.mark.parametrize("index", [0x1016, 0x6007, 0x605A, 0x6085])
@pytest.mark.parametrize("how", ["refuse", "forget"])
def test_protections_that_do_not_read_back_are_refused(index: int, how: str) -> None:
    with pytest.raises(errors.ProtectionNotConfirmed, match=f"0x{index:04X}"), machine(**{how: {index}}):
        pass


def test_a_mapping_that_does_not_read_back_is_refused() -> None:
    with pytest.raises(errors.MappingRefused, match="0x1A00"), machine(forget={0x1A00}):
        pass


def test_nobody_at_this_node_id() -> None:
    with durand_drive(CHANNEL), Bus(BUS) as bus:
        with (
            pytest.raises(errors.NodeSilent, match=r"X1 \(node 9\).*24 V"),
            Drive(bus, replace(CONFIG, node_id=9)),
        ):
            pass
        assert not bus.network.nodes


def test_another_device_at_this_node_id() -> None:
    wrong_vendor = replace(CONFIG, vendor_id=42)
    with durand_drive(CHANNEL) as peer, Bus(BUS) as bus:
        with pytest.raises(errors.WrongDevice, match="vendor 0x00000000, configured 0x0000002A"):
            Drive(bus, wrong_vendor).connect()
        peer.od.write(0x1000, 0, 0x0003_0191)
        with pytest.raises(errors.WrongDevice, match="no CiA 402 drive"):
            Drive(bus, CONFIG).connect()


def test_a_target_beyond_the_software_limits_is_refused() -> None:
    with machine() as (drive, peer, _), drive.enabled():
        with pytest.raises(errors.MoveRefused, match="outside -1000"):
            drive.start(replace(MOVE, target=1001.0))
        assert peer.position == 0


def test_a_set_point_that_is_not_acknowledged_is_refused_and_stopped() -> None:
    with machine() as (drive, peer, _), drive.enabled():
        peer.ignore_set_points = True
        with pytest.raises(errors.MoveRefused, match="did not acknowledge"):
            drive.start(MOVE)
        assert eventually(lambda: not peer.powered)


def test_a_disabled_axis_does_not_move() -> None:
    with machine() as (drive, peer, _):
        assert eventually(lambda: drive._linked()._tpdo is not None)
        with pytest.raises(errors.MoveRefused, match="switch on disabled, not enabled"):
            drive.start(MOVE)
        assert peer.position == 0


def test_a_blocked_axis_does_not_finish() -> None:
    with machine() as (drive, peer, _), drive.enabled():
        peer.sticks = True
        drive.start(replace(MOVE, timeout=0.3))
        with pytest.raises(errors.MoveNotFinished, match=r"not at rest 0\.[34]\d* s after the start"):
            drive.wait_standstill()


def test_a_drive_whose_sync_ends_is_disabled_by_sdo() -> None:
    with machine(replace(CONFIG, heartbeat_patience=0.5)) as (drive, peer, _):
        with pytest.raises(errors.NodeSilent, match="no TPDO1"), drive.enabled():
            drive.start(replace(MOVE, target=2 * pi * 150, relative=False))
            peer.mute = True
            drive.wait_standstill()
        assert not peer.powered


def test_a_drive_whose_heartbeat_ends_is_silent() -> None:
    with machine(replace(CONFIG, heartbeat_patience=0.3)) as (drive, peer, _):
        peer.end_heartbeat()
        peer.sticks = True  # else a slow machine sees the move end first
        with pytest.raises(errors.NodeSilent, match="no heartbeat for"), drive.enabled():
            drive.start(replace(MOVE, target=2 * pi * 150, relative=False))
            drive.wait_standstill()
        assert not peer.powered


def test_a_bus_lost_in_mid_move_is_named_and_the_axis_not_called_disabled() -> None:
    class Adapter:
        """Opens the bus once, and never again after it was pulled out."""

        def __init__(self) -> None:
            self.pulled = False

        def __call__(self, config: BusConfig) -> can.BusABC:
            if self.pulled:
                raise errors.BusNotOpened("no adapter")
            bus = open_python_can(config)
            recv = bus.recv

            def read(timeout: float | None = None) -> can.Message | None:
                if self.pulled:
                    raise can.CanOperationError("Network is down", 100)
                return recv(timeout)

            bus.recv = read  # type: ignore[method-assign]
            return bus

    adapter = Adapter()
    with durand_drive(CHANNEL), Bus(BUS, adapter) as bus, Drive(bus, CONFIG) as drive:
        with pytest.raises(errors.BusLost, match=r"Network is down|no adapter") as caught, drive.enabled():
            drive.start(replace(MOVE, target=2 * pi * 150, relative=False))
            adapter.pulled = True
            drive.wait_standstill()
        assert "could not be verified disabled" in caught.value.__notes__[0]


def test_start_together_stops_all_when_one_refuses() -> None:
    with machine() as (drive, peer, bus), drive.enabled():
        absent = Drive(bus, replace(CONFIG, name="X2", node_id=9))
        with pytest.raises(errors.NodeSilent, match="X2"):
            start_together([(drive, MOVE), (absent, MOVE)])
        assert peer.position == 0


def test_every_order_is_sent_although_somebody_else_uses_the_same_identifier() -> None:
    # canopen's own CiA 402 class falls silent after an echo of its RPDO.
    with (
        machine() as (drive, peer, _),
        can.Bus(interface="virtual", channel=CHANNEL) as stranger,
        drive.enabled(),
    ):
        echo = can.Message(
            arbitration_id=0x200 + NODE, data=bytes.fromhex("0F0000000000"), is_extended_id=False
        )
        stranger.send(echo)
        before = len(peer.controlwords)
        for _ in range(5):
            drive.command_quick_stop()
        assert eventually(lambda: peer.controlwords[before:].count(0x02) == 5)
