"""Ten steps over the virtual bus, drivers and all: what is recorded, and what a faulty machine leads to."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from drivers.errors import DriveFault, DriverError, JerkProfileRefused, ProtectionNotConfirmed, SensorSilent
from drivers.sim.accelerometer_node import AccelerometerFaults
from drivers.sim.drive_config import DriveFaults
from service.demo import demo_settings, open_demo
from service.dynamics.effects.carriage import ConstantForce
from service.motion.messages import Progress, Recorded
from service.motion.process import RunStopped


def ignore(progress: Progress) -> None:
    """Nobody watches."""


def go_on() -> None:
    """Nothing stops the run."""


def record(tmp_path: Path, group: str = "Y", **options: object) -> Recorded:
    settings = demo_settings(tmp_path)
    with open_demo(settings, **options) as machine:  # type: ignore[arg-type]
        return machine.execute(group, go_on, ignore)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    return record(tmp_path_factory.mktemp("run"))


def test_every_channel_covers_every_move(recorded: Recorded) -> None:
    recording = recorded.recording
    assert len(recording.moves) == 10
    for channel in ("motor_speed", "motor_torque", "acceleration"):
        trace = recording.trace("Y", channel)
        assert trace is not None
        assert trace.time[0] < recording.moves[0].start
        assert trace.time[-1] > recording.moves[-1].end
        assert np.all(np.diff(trace.time) > 0)


def test_the_motor_travels_what_was_commanded(recorded: Recorded) -> None:
    """Integrated over each move, the speed times D_p/(2i) is ±SL to within its quantisation."""
    speed = recorded.recording.trace("Y", "motor_speed")
    assert speed is not None
    for move in recorded.recording.moves:
        part = speed.between(move.start - 0.01, move.end + 0.2)
        travelled = 0.003 * np.trapezoid(part.value, part.time)
        assert travelled == pytest.approx(move.direction * move.length, rel=0.01)


def test_samples_are_placed_by_the_sensors_own_clock(recorded: Recorded) -> None:
    """The simulated sensor runs 2.1 % fast; its nominal rate must not be believed."""
    acceleration = recorded.recording.trace("Y", "acceleration")
    assert acceleration is not None
    assert 1 / np.median(np.diff(acceleration.time)) == pytest.approx(4000 * 1.021, rel=1e-3)


def test_one_seed_gives_the_same_recording_again(recorded: Recorded, tmp_path: Path) -> None:
    """Every value is the same; the times are, too, but for where on the machine's clock the run began."""
    again = record(tmp_path).recording
    for key, trace in recorded.recording.traces.items():
        assert np.array_equal(again.traces[key].value, trace.value), key
        np.testing.assert_allclose(again.traces[key].time, trace.time, rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("faults", "error"),
    [
        ({"drive_faults": {"Y": DriveFaults(refuses_jerk_limit=True)}}, JerkProfileRefused),
        ({"drive_faults": {"Y": DriveFaults(ignored_writes=frozenset({0x6007}))}}, ProtectionNotConfirmed),
        ({"drive_faults": {"Y": DriveFaults(trip_in_move=4)}}, DriveFault),
        ({"sensor_faults": {"Y": AccelerometerFaults(silent=True)}}, SensorSilent),
        ({"sensor_faults": {"Y": AccelerometerFaults(lost_between_s=(3.0, 99.0))}}, SensorSilent),
    ],
)
def test_a_fault_of_the_machine_ends_the_run_by_its_name(
    tmp_path: Path, faults: dict[str, object], error: type[DriverError]
) -> None:
    with pytest.raises(error, match="What to do"):
        record(tmp_path, **faults)


def test_a_stopped_run_leaves_the_axis_disabled_and_usable(tmp_path: Path) -> None:
    settings = demo_settings(tmp_path)
    steps: list[int] = []

    def guard() -> None:
        if len(steps) > 3:
            raise RunStopped("enough")

    with open_demo(settings) as machine:
        with pytest.raises(RunStopped):
            machine.execute("Y", guard, lambda progress: steps.append(progress.done))
        assert machine.execute("Y", go_on, ignore).recording.moves[0].start > 0


def test_an_axis_with_weight_on_it_stays_where_it_is_between_runs(tmp_path: Path) -> None:
    """600 N along travel are more than the guide holds: the brake has to, and to close before the torque goes."""
    weight = {"Y": (ConstantForce(600.0),)}
    with open_demo(demo_settings(tmp_path), effects=weight) as machine:
        stood = [machine.execute("Y", go_on, ignore).recording.moves[0].position for _ in range(3)]
    assert stood == pytest.approx([0.0] * 3, abs=2e-6)
