"""The map along the rack over the virtual bus: travel, step, travel on, and come back; and what stops a travel."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import can
import numpy as np
import pytest
from fastapi.testclient import TestClient
from numpy.typing import NDArray

from drivers.errors import DriveFault
from drivers.sim.drive_config import DriveFaults
from service.app import house
from service.backlash.estimate import immediate
from service.config import Settings
from service.demo import TRUTH, demo_settings, open_demo
from service.motion.messages import Progress, Recorded
from service.motion.process import RunStopped
from service.store.records import Queued
from tests.system.worn import WornBeyond

PLACES = (-0.06, 0.08)
WEAR = 30e-6


def settings_at(folder: Path, *axes: str, steps: int = 10) -> Settings:
    """The demo's machine with diagnostic positions on some axes."""
    plain = demo_settings(folder, places=dict.fromkeys(axes, PLACES))
    return Settings.model_validate(plain.model_dump() | {"excitation": {"steps": steps}})


def go_on() -> None:
    """Nothing stops the run."""


def ignore(progress: Progress) -> None:
    """Nobody watches."""


@pytest.fixture(scope="module")
def mapped(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    worn = {"Y": (WornBeyond(0.0, WEAR),)}
    with open_demo(settings_at(tmp_path_factory.mktemp("map"), "Y"), effects=worn) as machine:
        return machine.execute("Y", go_on, ignore)


def test_each_step_says_where_the_axis_stood_before_it(mapped: Recorded) -> None:
    moves = mapped.recording.moves
    assert len(moves) == 20
    middles = [m.position + m.direction * m.length / 2 for m in moves if m.position is not None]
    assert middles == pytest.approx([PLACES[0]] * 10 + [PLACES[1]] * 10, abs=2e-4)


def test_the_motor_travels_to_the_places_it_names(mapped: Recorded) -> None:
    """The recorded speed, integrated from the first place to the second, is their distance."""
    speed = mapped.recording.trace("Y", "motor_speed")
    assert speed is not None
    before, after = mapped.recording.moves[0].start, mapped.recording.moves[10].start
    way = speed.between(before, after)
    assert 0.003 * np.trapezoid(way.value, way.time) == pytest.approx(PLACES[1] - PLACES[0], rel=2e-3)


def test_the_map_shows_where_the_rack_is_worn(mapped: Recorded) -> None:
    (result,) = immediate(mapped.recording)
    assert result.verdict == "ok", result.detail
    assert [place.position for place in result.by_place] == pytest.approx(PLACES, abs=2e-4)
    here, there = (place.backlash for place in result.by_place)
    assert here == pytest.approx(TRUTH["Y"], rel=0.1)
    assert there == pytest.approx(TRUTH["Y"] + WEAR, rel=0.1)


def test_a_gantry_travels_with_both_sides_and_comes_back(tmp_path: Path) -> None:
    """Run twice: the second one finds the bridge where the first one found it."""
    settings = settings_at(tmp_path, "X1", "X2", steps=4)
    told: list[str] = []
    with open_demo(settings) as machine:
        first, second = (
            machine.execute("X", go_on, lambda progress: told.append(progress.text)).recording
            for _ in range(2)
        )
    assert told[0].startswith("travel to -0.060 m, place 1 of 2")
    assert sum(text.startswith("travel back to 0.000 m") for text in told) == 2
    for recording in (first, second):
        speeds = [recording.traces[axis, "motor_speed"] for axis in ("X1", "X2")]
        ways = [0.003 * np.trapezoid(speed.value, speed.time) for speed in speeds]
        assert ways[0] == pytest.approx(ways[1], abs=1e-4)
        assert [move.position for move in recording.moves[::4]] == pytest.approx(
            [place - 0.002 for place in PLACES], abs=2e-4
        )


def test_a_drive_that_trips_on_the_way_says_where_and_stops_the_other_side(tmp_path: Path) -> None:
    """The second travel is the sixth move; the partner would have gone on to 0.078 m."""
    settings = settings_at(tmp_path, "X1", "X2", steps=4)
    faults = {"X1": DriveFaults(trip_in_move=5, trip_after_s=0.3)}
    where = r"travel to 0\.080 m, place 2 of 2: X1 .* X1 and X2 stopped on the way"
    with open_demo(settings, drive_faults=faults) as machine:
        with pytest.raises(DriveFault, match=where):
            machine.execute("X", go_on, ignore)
        (tmp_path / "run.blf").write_bytes(machine.bus_log())
    speeds, statusword = last_of_drive(tmp_path / "run.blf", node=2)
    assert statusword & 0x6F != 0x27
    assert 0.003 * 0.001 * np.sum(speeds) < 0.05  # from 0, at a SYNC each millisecond


def last_of_drive(log: Path, node: int) -> tuple[NDArray[np.float64], int]:
    """Motor speeds [rad/s] out of a drive's TPDO1, INTEGER32 of 0.05 rpm, and its last statusword."""
    with can.BLFReader(log) as frames:
        sent = [f.data for f in frames if f.arbitration_id == 0x180 + node and len(f.data) == 8]
    counts = [int.from_bytes(data[:4], "little", signed=True) for data in sent]
    return np.array(counts) * 0.05 * 2 * np.pi / 60, int.from_bytes(sent[-1][6:], "little")


def test_a_travel_is_stopped_on_request_and_the_axis_stays_usable(tmp_path: Path) -> None:
    settings = settings_at(tmp_path, "Y", steps=4)
    travelling: list[str] = []

    def guard() -> None:
        if len(travelling) > 1:
            raise RunStopped("enough")

    def watch(progress: Progress) -> None:
        if progress.text.startswith("travel"):
            travelling.append(progress.text)

    with open_demo(settings) as machine:
        with pytest.raises(RunStopped):
            machine.execute("Y", guard, watch)
        travelling.clear()
        stopped_at = machine.execute("Y", go_on, ignore).recording.moves[0].position
    assert stopped_at == pytest.approx(PLACES[0] - 0.002, abs=2e-4)


def test_the_api_shows_the_map_of_the_latest_value(tmp_path: Path) -> None:
    machine = partial(open_demo, effects={"Y": (WornBeyond(0.0, WEAR),)})
    with (
        house(settings_at(tmp_path, "Y", steps=4), machine, refine=False) as opened,
        TestClient(opened.web(), base_url="http://localhost") as api,
    ):
        before = api.get("/api/v1/axes/Y").json()
        assert (before["diagnostic_positions_m"], before["by_place"]) == (list(PLACES), [])
        answer = opened.box.request("Y")
        assert isinstance(answer, Queued)
        run = opened.box.wait(answer.run_id, 60)
        assert run.state == "ok", run.detail
        shown = api.get("/api/v1/axes/Y").json()["by_place"]
        assert [place["position_m"] for place in shown] == pytest.approx(PLACES, abs=2e-4)
        assert shown[1]["backlash_m"] - shown[0]["backlash_m"] == pytest.approx(WEAR, rel=0.3)
        steps = api.get(f"/api/v1/runs/{answer.run_id}").json()["results"][0]["steps"]
        assert [step["position_m"] for step in steps] == pytest.approx(
            [PLACES[0]] * 4 + [PLACES[1]] * 4, abs=2e-4
        )
