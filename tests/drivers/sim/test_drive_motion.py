"""Profile position, and what ends it before its time: stops, losses, limits, faults, bad drives."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from drivers.sim.drive_config import DriveFaults
from drivers.sim.physics import FloatArray
from tests.drivers.sim.rig import DRIVE, DT, STEP_COUNTS, Bench, Rigid, Scripted, of, speed, statusword

COUNT_RAD = 2 * np.pi / 65536


@pytest.fixture
def bench() -> Iterator[Bench]:
    bench = Bench()
    yield bench
    bench.close()


def driven(bench: Bench) -> tuple[FloatArray, FloatArray]:
    """Speed and acceleration of all set-points so far."""
    assert isinstance(bench.physics, Rigid)
    history = bench.physics.history["X1"]
    return np.concatenate([s.speed for s in history]), np.concatenate([s.acceleration for s in history])


def final_position(bench: Bench) -> float:
    return bench.drive.positioning.actual


def test_a_step_is_the_jerk_limited_profile(bench):
    bench.enable()
    bench.command(0x1F, STEP_COUNTS)
    frames = bench.step(150)
    v, a = driven(bench)
    duration = 4 * (STEP_COUNTS * COUNT_RAD / 2 / 66667) ** (1 / 3)
    moving = np.flatnonzero(v)
    assert (moving[-1] - moving[0] + 1) * DT == pytest.approx(duration, abs=2 * DT)
    assert np.max(np.abs(np.diff(a))) <= 66667 * DT * 1.001
    assert final_position(bench) == pytest.approx(STEP_COUNTS * COUNT_RAD, abs=1e-12)
    assert max(speed(f) for f in of(frames, 0x185)) == pytest.approx(np.max(v) / DRIVE.speed_lsb_rad_s, abs=1)


def test_the_handshake_bits(bench):
    bench.enable()
    bench.command(0x1F, STEP_COUNTS)
    assert statusword(of(bench.step(5), 0x185)[-1]) == 0x1237
    bench.command(0x0F, STEP_COUNTS)
    assert statusword(of(bench.step(5), 0x185)[-1]) == 0x0237
    frames = of(bench.step(100), 0x185)
    assert statusword(frames[-1]) == 0x0637
    reached = next(f[0] for f in frames if statusword(f) & 0x0400)
    stopped = next(f[0] for f in frames if speed(f) == 0)
    assert reached - stopped == pytest.approx(DRIVE.position_window_s, abs=0.002)


def test_speed_and_deceleration_limits_are_the_masters(bench):
    bench.enable()
    bench.write(0x6081, 0, 2000, 4)  # 10.47 rad/s
    bench.write(0x6084, 0, 1000, 4)  # 100 rad/s²
    bench.command(0x1F, 65536)
    bench.step(1500)
    v, a = driven(bench)
    assert np.max(v) == pytest.approx(10.471975, rel=1e-6)
    assert np.min(a) == pytest.approx(-100, rel=1e-9) and np.max(a) > 300
    assert final_position(bench) == pytest.approx(2 * np.pi, abs=1e-12)


def test_max_profile_velocity_limits_the_profile_velocity(bench):
    bench.enable()
    bench.write(0x607F, 0, 1000, 4)
    bench.command(0x1F, 65536)
    bench.step(1500)
    assert np.max(driven(bench)[0]) == pytest.approx(5.2359877, rel=1e-6)


def test_relative_targets_add_up(bench):
    bench.enable()
    for _ in range(2):
        bench.command(0x5F, 1000)
        bench.step(150)
        bench.command(0x0F, 1000)
    assert final_position(bench) == pytest.approx(2000 * COUNT_RAD)


def test_a_second_setpoint_waits_for_the_first(bench):
    bench.enable()
    bench.command(0x1F, STEP_COUNTS)
    bench.step(20)
    bench.command(0x0F)
    bench.command(0x1F, 0)
    bench.step(20)
    assert final_position(bench) > 0
    bench.command(0x0F)
    assert statusword(of(bench.step(5), 0x185)[-1]) & 0x1000, "the queue is taken: not yet acknowledged away"
    bench.step(250)
    assert bench.drive.positioning.moves == 2
    assert final_position(bench) == 0.0


def test_quick_stop_in_mid_move_brakes_by_its_own_ramp(bench):
    bench.enable()
    bench.command(0x1F, STEP_COUNTS)
    bench.step(45)
    v_before = driven(bench)[0][-1]
    bench.command(0x0B)  # bit 2 = 0
    frames = bench.step(60)
    v, a = driven(bench)
    ramp = v[-60 * 8 :]
    assert v_before > 25
    assert np.all(a[-60 * 8 :][ramp > 0] == -5000)
    assert np.count_nonzero(ramp) * DT == pytest.approx(v_before / 5000, abs=DT)
    assert [statusword(f) & 0x6F for f in of(frames, 0x185)[1:5]] == [0x07] * 4
    assert statusword(of(frames, 0x185)[-1]) & 0x4F == 0x40, "option 2 ends in Switch on disabled"
    assert 0 < final_position(bench) < STEP_COUNTS * COUNT_RAD


def test_quick_stop_option_6_stays_and_comes_back(bench):
    bench.enable()
    bench.write(0x605A, 0, 6, 2)
    bench.command(0x1F, STEP_COUNTS)
    bench.step(45)
    bench.command(0x0B)
    assert statusword(of(bench.step(60), 0x185)[-1]) & 0x6F == 0x07
    bench.command(0x0F)
    assert statusword(of(bench.step(5), 0x185)[-1]) & 0x6F == 0x27


def test_quick_stop_option_2_does_not_come_back_by_itself(bench):
    bench.enable()
    bench.command(0x1F, STEP_COUNTS)
    bench.step(45)
    bench.command(0x0B)
    bench.command(0x0F)
    assert statusword(of(bench.step(60), 0x185)[-1]) & 0x4F == 0x40


def test_halt_brakes_by_the_profile_deceleration_and_stays_enabled(bench):
    bench.enable()
    bench.command(0x1F, STEP_COUNTS)
    bench.step(45)
    bench.command(0x11F, STEP_COUNTS)
    frames = bench.step(60)
    assert np.min(driven(bench)[1]) == pytest.approx(-2000)
    assert speed(of(frames, 0x185)[-1]) == 0 and statusword(of(frames, 0x185)[-1]) & 0x46F == 0x27


@pytest.mark.parametrize(("controlword", "state"), [(0x07, 0x23), (0x06, 0x21), (0x00, 0x40)])
def test_disabled_in_mid_move_it_coasts(bench, controlword, state):
    bench.enable()
    bench.command(0x1F, STEP_COUNTS)
    bench.step(45)
    v_before = driven(bench)[0][-1]
    bench.command(controlword)
    frames = of(bench.step(100), 0x185)
    assert isinstance(bench.physics, Rigid)
    assert not any(s.enabled for s in bench.physics.history["X1"][-20:])
    assert statusword(frames[-1]) & 0x6F == state
    coasting = v_before * np.exp(-5 * 0.099) / DRIVE.speed_lsb_rad_s
    assert speed(frames[-1]) == pytest.approx(coasting, rel=0.01)


def test_enabled_again_it_holds_where_it_coasted_to(bench):
    bench.enable()
    bench.command(0x1F, STEP_COUNTS)
    bench.step(45)
    bench.command(0x00)
    bench.step(2000)
    where = final_position(bench)
    for controlword in (0x06, 0x07, 0x0F):
        bench.command(controlword)
    bench.step(20)
    assert final_position(bench) == pytest.approx(where, abs=1e-9)
    assert where != pytest.approx(STEP_COUNTS * COUNT_RAD, abs=0.1)


def beat_then_start_a_long_move(bench: Bench) -> None:
    bench.write(0x6081, 0, 1000, 4)
    bench.send("77f#05")
    bench.command(0x1F, 65536)  # 1.2 s at 5.2 rad/s


def test_a_lost_master_stops_the_axis_in_mid_move(bench):
    bench.enable()
    beat_then_start_a_long_move(bench)
    begin = bench.core.time
    frames = bench.step(400)
    emcy = of(frames, 0x085)
    assert [f[2].hex() for f in emcy] == ["3081110000000000"]
    assert emcy[0][0] - begin == pytest.approx(0.3, abs=0.006)
    assert statusword(of(frames, 0x185)[-1]) & 0x4F == 0x40
    v, a = driven(bench)
    assert v[-1] == 0 and np.min(a) == -5000


def test_a_beating_master_is_not_lost(bench):
    bench.enable()
    beat_then_start_a_long_move(bench)
    for _ in range(14):
        frames = bench.step(100)
        bench.send("77f#05")
        assert of(frames, 0x085) == []
    assert final_position(bench) == pytest.approx(2 * np.pi)


def test_nobody_is_lost_who_never_beat(bench):
    bench.enable()
    assert of(bench.step(1000), 0x085) == []


@pytest.mark.parametrize(
    ("option", "state", "powered"), [(0, 0x27, True), (1, 0x08, False), (2, 0x40, False)]
)
def test_the_other_reactions_to_a_lost_master(bench, option, state, powered):
    bench.enable()
    bench.write(0x6007, 0, option, 2)
    beat_then_start_a_long_move(bench)
    frames = bench.step(400)
    assert statusword(of(frames, 0x185)[-1]) & 0x6F == state
    assert isinstance(bench.physics, Rigid)
    assert bench.physics.history["X1"][-1].enabled is powered


def test_a_watch_set_anew_waits_for_its_first_heartbeat(bench):
    """CiA 301: what passed while 0x1016 was 0 does not count, however long the master was away."""
    bench.enable()
    bench.send("77f#05")
    bench.write(0x1016, 1, 0, 4)
    bench.step(2000)
    bench.write(0x1016, 1, 127 << 16 | 300, 4)
    assert of(bench.step(1000), 0x085) == []


def test_the_error_of_the_lost_master_goes_when_it_is_back(bench):
    bench.enable()
    beat_then_start_a_long_move(bench)
    bench.step(400)
    bench.send("77f#05")
    assert [f[2].hex() for f in of(bench.step(10), 0x085)] == ["0000000000000000"]


def test_nmt_stop_counts_as_a_lost_connection(bench):
    bench.enable()
    bench.command(0x1F, STEP_COUNTS)
    bench.step(45)
    bench.send("000#0205")
    bench.step(60)
    v, a = driven(bench)
    assert v[-1] == 0 and np.min(a) == -5000


@pytest.mark.parametrize(("target", "limit"), [(20_000, 10_000), (-20_000, -5_000)])
def test_software_limits_hold_and_say_so(bench, target, limit):
    bench.enable()
    bench.write(0x607D, 1, -5_000, 4)
    bench.write(0x607D, 2, 10_000, 4)
    bench.command(0x1F, target)
    frames = bench.step(200)
    assert final_position(bench) == pytest.approx(limit * COUNT_RAD)
    assert statusword(of(frames, 0x185)[-1]) & 0x0C00 == 0x0800, "limit active, target not reached"


def test_a_blocked_axis_ends_in_a_following_error():
    bench = Bench(Scripted(motor_position=0.0))
    bench.enable()
    bench.command(0x1F, 20 * 65536)
    frames = bench.step(600)
    bench.close()
    assert [f[2].hex() for f in of(frames, 0x085)] == ["1186210000000000"]
    assert statusword(of(frames, 0x185)[-1]) & 0x204F == 0x2008


def test_a_move_without_speed_is_a_parameter_error(bench):
    bench.enable()
    bench.write(0x6081, 0, 0, 4)
    bench.command(0x1F, STEP_COUNTS)
    frames = bench.step(20)
    assert [f[2].hex() for f in of(frames, 0x085)] == ["2063210000000000"]


def test_a_drive_without_jerk_limit():
    bench = Bench(drives=[replace(DRIVE, faults=DriveFaults(refuses_jerk_limit=True))])
    assert bench.ask("605#2b86600002000000") == "8086600030000906"
    assert bench.ask("605#23a460016b040100") == "80a4600100000206"
    assert bench.ask("605#2b86600000000000") == "6086600000000000"
    bench.close()


def test_a_drive_that_forgets_a_write():
    bench = Bench(drives=[replace(DRIVE, faults=DriveFaults(ignored_writes=frozenset({0x605A})))])
    assert bench.ask("605#2b5a600006000000") == "605a600000000000"
    assert bench.ask("605#405a600000000000") == "4b5a600002000000"
    bench.close()


def test_a_drive_that_loses_tpdos():
    bench = Bench(drives=[replace(DRIVE, faults=DriveFaults(tpdo_loss=0.1))])
    bench.set_up()
    frames = bench.step(4000)
    bench.close()
    lost = len(of(frames, 0x080)) - len(of(frames, 0x185))
    assert abs(lost - 400) < 4 * np.sqrt(4000 * 0.1 * 0.9)


def test_a_drive_that_falls_silent_in_a_move():
    bench = Bench(drives=[replace(DRIVE, faults=DriveFaults(silent_from_move=0))])
    bench.enable()
    assert of(bench.step(10), 0x185)
    bench.command(0x1F, STEP_COUNTS)
    bench.read()
    frames = bench.step(100)
    bench.close()
    assert len(of(frames, 0x185)) <= 1 and of(frames, 0x080)


def test_a_drive_whose_heartbeat_stops():
    bench = Bench(drives=[replace(DRIVE, faults=DriveFaults(heartbeat_stops_at_s=0.25))])
    bench.write(0x1017, 0, 100, 2)
    beats = of(bench.step(1000), 0x705)
    bench.close()
    assert [round(f[0], 2) for f in beats if f[2] != b"\0"] == [0.10, 0.20]
