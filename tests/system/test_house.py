"""The whole house: a check over the API moves the simulated machine and ends as a value, a trend and a capture."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import can
import pytest
from fastapi.testclient import TestClient

from drivers.sim.accelerometer_node import AccelerometerFaults
from drivers.sim.drive_config import DriveFaults
from service.app import House, house
from service.backlash.estimate import immediate
from service.backlash.results import AxisResult, Reason
from service.captures import read_capture
from service.demo import TRUTH, demo_settings, open_demo
from service.runs.analysis import Analysis
from service.store.records import AxisOutcome, Busy, Queued


def run(opened: House, target: str) -> int:
    answer = opened.box.request(target)
    assert isinstance(answer, Queued), answer
    opened.box.wait(answer.run_id, 60)
    return answer.run_id


def outcome(opened: House, run_id: int, method: str) -> AxisOutcome:
    """What one method said of the run's only axis."""
    found = (value.outcome for value in opened.repository.outcomes(run_id))
    return next(one for one in found if one.result.method == method)


@pytest.fixture(scope="module")
def opened(tmp_path_factory: pytest.TempPathFactory) -> Iterator[House]:
    settings = demo_settings(tmp_path_factory.mktemp("house"))
    with house(settings, open_demo) as flankwatch:
        yield flankwatch


@pytest.fixture(scope="module")
def checked(opened: House) -> int:
    return run(opened, "Y")


@pytest.fixture
def api(opened: House) -> Iterator[TestClient]:
    with TestClient(opened.web(), base_url="http://localhost") as client:
        yield client


def test_the_immediate_value_is_within_a_tenth_of_its_truth(opened: House, checked: int) -> None:
    plain = outcome(opened, checked, "paper")
    assert plain.result.verdict == "ok"
    assert plain.result.backlash == pytest.approx(TRUTH["Y"], rel=0.1)


def test_the_refined_value_takes_its_place_and_is_within_a_micrometre(opened: House, checked: int) -> None:
    opened.refinement.wait_idle()
    fit = outcome(opened, checked, "model_fit")
    assert fit.reported
    assert not outcome(opened, checked, "paper").reported
    assert fit.result.backlash == pytest.approx(TRUTH["Y"], abs=1e-6)


def test_the_capture_is_kept_under_its_checksum_and_gives_the_same_value_again(
    opened: House, checked: int
) -> None:
    record = opened.repository.run(checked)
    assert record.capture is not None
    path = opened.settings.storage.captures / record.capture.path
    assert hashlib.sha256(path.read_bytes()).hexdigest() == record.capture.sha256
    again = immediate(read_capture(path))
    assert [result.backlash for result in again] == [outcome(opened, checked, "paper").result.backlash]


def test_the_api_tells_value_interval_and_alarm_state(api: TestClient, checked: int) -> None:
    axis = api.get("/api/v1/axes/Y").json()
    assert axis["current"]["run_id"] == checked
    low, high = axis["current"]["interval_95_m"]
    assert low < axis["current"]["backlash_m"] < high
    assert api.get("/readyz").status_code == 200
    assert api.get(f"/api/v1/runs/{checked}").json()["results"][0]["steps"][0]["t1_s"] > 0
    picture = api.get(f"/api/v1/runs/{checked}/picture?axis=Y&step=0")
    assert picture.headers["content-type"].startswith("image/svg+xml")


def test_a_check_is_accepted_and_a_second_one_finds_the_machine_busy(opened: House, api: TestClient) -> None:
    accepted = api.post("/api/v1/checks", json={"group": "X"})
    assert accepted.status_code == 202
    assert api.post("/api/v1/checks", json={"axis": "Y"}).status_code == 409
    assert isinstance(opened.box.request("Y"), Busy)
    location = accepted.headers["Location"]
    opened.box.wait(int(location.rsplit("/", 1)[1]), 60)
    ended = api.get(location).json()
    assert ended["state"] in ("ok", "refused")
    assert {result["axis"] for result in ended["results"]} == {"X1", "X2"}


@pytest.mark.parametrize(
    ("faults", "state", "reason"),
    [
        ({"drive_faults": {"Y": DriveFaults(refuses_jerk_limit=True)}}, "failed", "JerkProfileRefused"),
        ({"sensor_faults": {"Y": AccelerometerFaults(silent=True)}}, "failed", "SensorSilent"),
        ({"sensor_faults": {"Y": AccelerometerFaults(blocked=True)}}, "refused", "sensor_flat"),
        ({"sensor_faults": {"Y": AccelerometerFaults(inverted=True)}}, "refused", "wrong_sign"),
        ({"sensor_faults": {"Y": AccelerometerFaults(loss=0.05)}}, "refused", "frame_loss"),
    ],
)
def test_a_faulty_machine_never_leaves_a_value(
    tmp_path: Path, faults: dict[str, object], state: str, reason: str
) -> None:
    settings = demo_settings(tmp_path)
    with house(settings, partial(open_demo, **faults)) as flankwatch:  # type: ignore[arg-type]
        record = flankwatch.repository.run(run(flankwatch, "Y"))
        assert (record.state, record.reason) == (state, reason)
        assert record.detail
        (log,) = settings.storage.captures.rglob(f"*-Y-{record.id}.blf")
        with can.BLFReader(log) as frames:
            assert any(frame.arbitration_id == 0x583 for frame in frames)  # the drive's answers to SDO
        assert flankwatch.repository.history("Y").b.size == 0


def test_a_drive_that_warns_and_goes_on_leaves_a_value_and_a_remark(tmp_path: Path) -> None:
    machine = partial(open_demo, drive_faults={"Y": DriveFaults(warns_in_move=4)})
    with house(demo_settings(tmp_path), machine, refine=False) as flankwatch:
        number = run(flankwatch, "Y")
        record = flankwatch.repository.run(number)
        assert (record.state, record.detail) == ("ok", None)
        (remark,) = record.remarks
        assert "Y (node 3) warned of 0x4310, drive too hot" in remark
        with TestClient(flankwatch.web(), base_url="http://localhost") as client:
            assert client.get(f"/api/v1/runs/{number}").json()["remarks"] == [remark]


def test_a_run_that_was_cut_short_is_failed_at_the_next_start(tmp_path: Path) -> None:
    settings = demo_settings(tmp_path)
    with house(settings, open_demo) as flankwatch:
        order = flankwatch.box.request("Y")
        assert isinstance(order, Queued)
    with house(settings, open_demo) as flankwatch:
        assert flankwatch.repository.run(order.run_id).state == "failed"


class NothingCrosses(Analysis):
    """The plain method sees a gap; the fit sees that no step has crossed it."""

    def refined(self, path: Path, sha256: str) -> tuple[AxisResult, ...]:
        detail = "The flanks changed sides in no step; the step is too short or slow for the gap."
        axes = [one.axis for one in self.immediate(path, sha256)]
        return tuple(AxisResult(a, "refused", "model_fit", Reason.GAP_NOT_CROSSED, detail) for a in axes)


def test_a_value_that_the_fit_disproves_is_withdrawn_and_the_api_says_so(tmp_path: Path) -> None:
    with (
        house(demo_settings(tmp_path), open_demo, analysis=NothingCrosses) as flankwatch,
        TestClient(flankwatch.web(), base_url="http://localhost") as client,
    ):
        number = run(flankwatch, "Y")
        flankwatch.refinement.wait_idle()
        shown = client.get(f"/api/v1/runs/{number}").json()
        axis = client.get("/api/v1/axes/Y").json()
    assert (shown["state"], shown["reason"]) == ("refused", "gap_not_crossed")
    plain = next(one for one in shown["results"] if one["method"] == "paper")
    assert f"the immediate value of {plain['backlash_m'] * 1e6:.1f} µm is withdrawn" in shown["detail"]
    assert "changed sides in no step" in shown["detail"]
    assert [one["method"] for one in shown["results"] if one["reported"]] == ["model_fit"]
    assert axis["current"] is None
