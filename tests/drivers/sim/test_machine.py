"""The whole simulated machine over the virtual bus, with a master of raw frames that shares no code with ours."""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from dataclasses import replace

import can
import numpy as np
import pytest

from drivers.sim.accelerometer_node import AccelerometerFaults
from drivers.sim.communication import TICK
from drivers.sim.drive_config import DriveConfig
from drivers.sim.machine import SimulatedMachine
from drivers.sim.pacing import BLOCK, Timing
from drivers.sim.physics import Setpoint
from drivers.sim.wire import Frame
from tests.drivers.sim.rig import (
    DRIVE,
    SENSOR,
    STEP_COUNTS,
    Block,
    RawMaster,
    Rigid,
    channel,
    message,
    of,
    raw_master,
    rpdo,
    sdo_write,
    speed,
    statusword,
)


def machine(name: str, seed: int = 1, paced: bool = False, physics: Rigid | None = None) -> SimulatedMachine:
    sensor = replace(SENSOR, bus=name, faults=AccelerometerFaults(loss=0.01))
    return SimulatedMachine(
        [name], [replace(DRIVE, bus=name)], [sensor], physics or Rigid(), seed=seed, paced=paced
    )


def steps(master: RawMaster, count: int, stall: float = 0.0) -> None:
    """Commissioning, then steps to and fro with a rest before each, as a diagnostic run makes them."""
    master.set_up()
    master.enable()
    since = master.frames[-1][0]
    for k in range(count):
        master.rest(0.35, since)
        master.listen(stall)
        since = master.go(STEP_COUNTS if k % 2 == 0 else 0)[0]
    master.rest(0.35, since)


def run_of_steps(seed: int, dawdle: float = 0.0, count: int = 3, stall: float = 0.0) -> list[Frame]:
    name = channel()
    with raw_master(machine(name, seed), name) as master:
        master.beating.set()
        time.sleep(dawdle)
        steps(master, count, stall)
        end = master.frames[-1][0]
    return [f for f in master.frames if f[0] <= end - 0.01]


def test_two_runs_are_byte_identical():
    """All frames with their time stamps, from the first boot-up on; a machine left waiting changes nothing."""
    first, second = run_of_steps(seed=7), run_of_steps(seed=7, dawdle=0.3)
    n = min(len(first), len(second))
    assert first[0][1:] == (0x705, b"\0") and n > 5000
    assert first[:n] == second[:n]


def test_they_stay_identical_when_the_pc_is_busy():
    first = run_of_steps(seed=7)
    end = threading.Event()

    def hog() -> None:
        while not end.is_set():
            sum(range(1000))

    thread = threading.Thread(target=hog)
    thread.start()
    try:
        second = run_of_steps(seed=7)
    finally:
        end.set()
        thread.join()
    n = min(len(first), len(second))
    assert first[:n] == second[:n]


def test_a_master_that_stalls_between_its_steps_changes_nothing():
    """Three periods by which a container's processor time is rationed, before each set-point."""
    first, second = run_of_steps(seed=7), run_of_steps(seed=7, stall=0.3)
    n = min(len(first), len(second))
    assert n > 5000
    assert first[:n] == second[:n]


def test_a_drive_that_closes_its_brake_answers_without_being_waited_for():
    """The torque stays until the brake grips; the halt that follows the command is not the end of it."""
    name = channel()
    timing = Timing(patience_s=60.0, patience_enabled_s=60.0)
    drives = [replace(DRIVE, bus=name, brake_s=0.2)]
    with raw_master(SimulatedMachine([name], drives, [], Rigid(), seed=1, timing=timing), name) as master:
        master.set_up()
        master.enable()
        asked = master.frames[-1][0]
        master.send(rpdo(0x07, 0))
        closed = master.wait_status(lambda s: s & 0x6F == 0x23)[0]
    assert closed - asked >= 0.2


def test_another_seed_gives_other_noise():
    first, second = run_of_steps(seed=7, count=1), run_of_steps(seed=8, count=1)
    assert [f[2] for f in of(first, 0x300)[:100]] != [f[2] for f in of(second, 0x300)[:100]]


def test_frames_come_in_the_order_of_their_time():
    frames = run_of_steps(seed=1, count=1)
    stamps = [f[0] for f in frames]
    assert stamps == sorted(stamps)
    assert {f[1] for f in frames} == {0x080, 0x185, 0x585, 0x705, 0x300, 0x310}


def test_haste_does_not_lose_a_master_that_beats_by_the_wall_clock():
    """Beats every 100 ms of wall time, lost after 300 ms of machine time, a move of 1.2 s of machine time."""
    name = channel()
    with raw_master(machine(name), name) as master:
        master.beating.set()
        master.set_up()
        master.send(sdo_write(0x6081, 0, 1000, 4))
        time.sleep(0.25)
        master.enable()
        master.go(65536)
    assert of(master.frames, 0x085) == []


def test_a_silent_master_is_lost_in_mid_move():
    """It stops after 300 ms of machine time, whatever the speed of the simulation."""
    name = channel()
    with raw_master(machine(name), name) as master:
        master.set_up()
        master.send(sdo_write(0x6081, 0, 1000, 4))
        master.enable()
        master.send(rpdo(0x1F, 65536))
        begun = master.wait_status(lambda s: bool(s & 0x1000))
        master.send("77f#05")
        emcy = master.wait(lambda f: f[1] == 0x085)
        stopped = master.wait_status(lambda s: s & 0x4F == 0x40)
    assert emcy[2].hex() == "3081110000000000"
    assert emcy[0] - begun[0] == pytest.approx(0.3, abs=0.012)
    assert stopped[0] - emcy[0] < 0.02, "5.2 rad/s at 5000 rad/s² take a millisecond"


@pytest.mark.parametrize(("controlword", "state"), [(0x0B, 0x07), (0x00, 0x40)])
def test_a_stop_reaches_the_axis_in_mid_move(controlword, state):
    """The set-point's second frame is still kept for the halt; the stop overtakes it and it must not revive."""
    name = channel()
    with raw_master(machine(name), name) as master:
        master.set_up()
        master.send(sdo_write(0x6081, 0, 1000, 4))
        master.enable()
        master.send(rpdo(0x1F, 65536))
        begun = master.wait(lambda f: f[1] == 0x185 and speed(f) > 900)
        master.send(rpdo(0x0F, 65536))
        master.send(rpdo(controlword, 65536))
        seen = master.wait_status(lambda s: s & 0x6F != 0x27)
        master.rest(0.5, seen[0])
        end = of(master.frames, 0x185)[-1]
    assert statusword(seen) & 0x6F == state
    assert seen[0] - begun[0] < 0.2, "within the flow-control window of a few tens of milliseconds"
    assert statusword(end) & 0x4F == 0x40


def test_sides_of_a_gantry_start_in_the_same_block():
    name = channel()
    drives = [replace(DRIVE, bus=name), DriveConfig("X2", 6, name)]
    physics = Rigid(("X1", "X2"))
    gantry = SimulatedMachine([name], drives, [], physics, seed=1)
    with raw_master(gantry, name, nodes=(5, 6)) as master:
        master.set_up()
        master.enable()
        for target in (STEP_COUNTS, 0):
            master.go(target)
    first, second = (np.concatenate([s.position for s in physics.history[a]]) for a in ("X1", "X2"))
    assert np.max(first) == pytest.approx(4 / 3, rel=1e-4)
    assert np.array_equal(first, second)


def test_one_of_two_enabled_drives_may_move_alone():
    name = channel()
    drives = [replace(DRIVE, bus=name), DriveConfig("X2", 6, name)]
    physics = Rigid(("X1", "X2"))
    with raw_master(SimulatedMachine([name], drives, [], physics, seed=1), name, nodes=(5, 6)) as master:
        master.set_up()
        master.enable()
        master.nodes = (6,)
        master.go(STEP_COUNTS)
    assert np.all(physics.history["X1"][-1].position == 0)
    assert physics.history["X2"][-1].position[-1] > 1.3


def test_two_buses_share_one_clock():
    names = [channel(), channel()]
    drives = [DriveConfig("X1", 5, names[0]), DriveConfig("X2", 5, names[1])]
    timing = Timing(window=100_000, deaf_s=0.1)  # this test reads one bus after the other
    with SimulatedMachine(names, drives, [], Rigid(("X1", "X2")), seed=1, timing=timing):
        masters = [RawMaster(name) for name in names]
        try:
            for master in masters:
                master.set_up()
            stamps = [m.wait(lambda f: f[1] == 0x185 and f[0] > 0.2)[0] for m in masters]
        finally:
            for master in masters:
                master.close()
    assert stamps[0] == pytest.approx(stamps[1], abs=0.001)


def test_paced_it_never_runs_ahead_of_the_wall_clock():
    """The machine is switched on after the clock is read: a busy PC only widens the distance."""
    name = channel()
    begin = time.perf_counter()
    with raw_master(machine(name, paced=True), name) as master:
        master.set_up()
        while (stamp := master.wait_status(lambda s: True)[0]) < 1.0:
            assert stamp <= time.perf_counter() - begin + BLOCK * TICK


def test_paced_it_moves_and_stops_at_once():
    name = channel()
    with raw_master(machine(name, paced=True), name) as master:
        master.beating.set()
        master.set_up()
        master.enable()
        end = master.go(STEP_COUNTS)
        assert statusword(end) & 0x0400
        master.send(rpdo(0x00, 0))
        assert master.wait_status(lambda s: s & 0x4F == 0x40)[0] - end[0] < 0.2


def test_a_listener_that_never_reads_is_bounded_and_does_not_stop_the_machine():
    name = channel()
    hasty = SimulatedMachine(
        [name],
        [replace(DRIVE, bus=name)],
        [],
        Rigid(),
        seed=1,
        timing=Timing(deaf_s=0.05, switch_on_s=0.0, patience_s=0.0, idle_s=5.0),
    )
    deaf = can.Bus(interface="virtual", channel=name)
    try:
        with hasty:
            for request in (sdo_write(0x1006, 0, 1000, 4), sdo_write(0x1005, 0, 0x40000080, 4), "000#0105"):
                deaf.send(message(request))
            deadline = time.monotonic() + 20
            while hasty.frames_lost == 0 and time.monotonic() < deadline:
                time.sleep(0.02)
            assert hasty.frames_lost > 0
            assert deaf.queue.qsize() == 65536
    finally:
        deaf.shutdown()


class Exploding(Rigid):
    def advance(self, duration: float, setpoints: Sequence[Setpoint]) -> list[Block]:
        raise FloatingPointError("the axis left the building")


def test_a_broken_physics_is_reported_when_the_machine_stops(caplog):
    name = channel()
    broken = machine(name, physics=Exploding())
    broken.start()
    bus = can.Bus(interface="virtual", channel=name)
    bus.send(can.Message(arbitration_id=0, data=[1, 5], is_extended_id=False))
    time.sleep(0.1)
    bus.shutdown()
    with pytest.raises(RuntimeError, match="broke down") as caught:
        broken.stop()
    assert isinstance(caught.value.__cause__, FloatingPointError)


def test_it_may_be_stopped_before_anybody_came():
    with machine(channel()) as lonely:
        time.sleep(0.05)
    assert lonely.time == 0.0


def test_a_machine_that_was_never_started_leaves_its_buses():
    machine(channel()).stop()


@pytest.mark.parametrize(
    ("drive", "sensor", "complaint"),
    [
        ({"bus": "elsewhere"}, {}, "wired to bus"),
        ({}, {"axis": "Y"}, "unknown to the physics"),
        ({}, {"time_id": 0x300}, "share"),
    ],
)
def test_wrong_wiring_is_refused(drive, sensor, complaint):
    name = channel()
    with pytest.raises(ValueError, match=complaint):
        SimulatedMachine(
            [name],
            [replace(DRIVE, **{"bus": name} | drive)],
            [replace(SENSOR, **{"bus": name} | sensor)],
            Rigid(),
            seed=1,
        )
