"""The move that tells two effects apart, over the virtual bus: asked for as the finding says, made, and judged."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any

import pytest
from fastapi.testclient import TestClient

from service.app import House, house
from service.captures import read_capture
from service.demo import demo_settings, open_demo
from service.dynamics.effects.carriage import AsymmetricFriction
from tests.benchmarks.close_the_loop import check_and_wait
from tests.system.pull import PullAnalysis

PULLED = {axis: (AsymmetricFriction(400.0),) for axis in ("X1", "X2", "Y")}


@pytest.fixture(scope="module")
def opened(tmp_path_factory: pytest.TempPathFactory) -> Iterator[House]:
    settings = demo_settings(tmp_path_factory.mktemp("house"))
    with house(settings, partial(open_demo, effects=PULLED), analysis=PullAnalysis) as flankwatch:
        with TestClient(flankwatch.web(), base_url="http://localhost") as client:
            for axis in ("Y", "Y", "X2", "X2"):  # a finding needs a run to fit to, and one to judge
                check_and_wait(flankwatch, client, axis)
        yield flankwatch


@pytest.fixture
def api(opened: House) -> Iterator[TestClient]:
    with TestClient(opened.web(), base_url="http://localhost") as client:
        yield client


def make(opened: House, api: TestClient, move: dict[str, Any]) -> dict[str, Any]:
    """Ask for a move over REST and return the run as it ended."""
    accepted = api.post("/api/v1/moves", json=move)
    assert accepted.status_code == 202, accepted.text
    opened.box.wait(accepted.json()["run_id"], 60)
    opened.refinement.wait_idle()
    opened.workbench.wait_idle()
    ended: dict[str, Any] = api.get(accepted.headers["Location"]).json()
    return ended


@pytest.mark.parametrize("axis", ["Y", "X2"])
def test_the_proposed_move_is_made_and_settles_what_looked_alike(
    opened: House, api: TestClient, axis: str
) -> None:
    """Once for a single axis, once for a side of a gantry, whose other side moves along."""
    before = api.get(f"/api/v1/axes/{axis}").json()
    move = before["model_check"]["separating_moves"][axis]
    run = make(opened, api, {"axis": axis, **move})
    assert run["state"] in ("ok", "refused"), run["detail"]
    assert run["axes"] == (["X1", "X2"] if axis == "X2" else ["Y"])
    assert run["other_steps"] == {"length_m": 0.008, "jerk_m_s3": 50.0, "direction": -1, "positions_m": []}
    record = opened.repository.run(run["id"])
    assert record.capture is not None
    moves = read_capture(opened.settings.storage.captures / record.capture.path).moves
    assert [(m.length, m.jerk, m.direction) for m in moves] == [(0.008, 50.0, -1), (0.008, 50.0, 1)] * 5
    assert not any(result["reported"] for result in run["results"])
    (check,) = run["model_checks"]
    assert check["separating_moves"] == {}
    assert len(check["train_run_ids"]) == 2
    after = api.get(f"/api/v1/axes/{axis}").json()
    assert after["current"] == before["current"], "a separating move measures nothing"
    assert after["model_check"]["run_id"] == run["id"]


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"length_m": 2.0, "jerk_m_s3": 1.0}, "longer than its travel of 1000 mm"),
        ({"length_m": 0.01, "jerk_m_s3": 2000.0}, "a_max = 27.1 m/s², the axis' limit is 10"),
        ({"length_m": 0.5, "jerk_m_s3": 1e-3}, "raise the jerk"),
        ({"positions_m": [0.0, 0.499]}, "position 0.499 m leaves no room"),
    ],
)
def test_a_move_beyond_the_limits_is_refused_before_a_run_begins(
    opened: House, api: TestClient, change: dict[str, float], says: str
) -> None:
    known = len(api.get("/api/v1/runs").json()["items"])
    refused = api.post("/api/v1/moves", json={"axis": "Y", "length_m": 0.008, "jerk_m_s3": 50.0} | change)
    assert (refused.status_code, refused.json()["type"]) == (422, "urn:flankwatch:problem:beyond-limits")
    assert says in refused.json()["detail"]
    assert len(api.get("/api/v1/runs").json()["items"]) == known


def test_a_move_is_made_where_it_is_wanted(opened: House, api: TestClient) -> None:
    move = {"axis": "Y", "length_m": 0.008, "jerk_m_s3": 50.0, "direction": -1, "positions_m": [-0.05, 0.05]}
    run = make(opened, api, move)
    assert run["other_steps"]["positions_m"] == [-0.05, 0.05]
    record = opened.repository.run(run["id"])
    assert record.capture is not None
    moves = read_capture(opened.settings.storage.captures / record.capture.path).moves
    middles = [m.position + m.direction * m.length / 2 for m in moves if m.position is not None]
    assert middles == pytest.approx([-0.05] * 10 + [0.05] * 10, abs=2e-4)
    assert moves[0].direction == -1


def test_a_move_without_room_where_the_axis_stands_fails_and_says_what_to_do(
    opened: House, api: TestClient
) -> None:
    """Within the travel of 1 m, but not from its middle."""
    run = make(opened, api, {"axis": "Y", "length_m": 0.6, "jerk_m_s3": 5.0})
    assert (run["state"], run["reason"]) == ("failed", "NotPermitted")
    assert "no room for a step of 600 mm: Y stands at" in run["detail"]
    assert run["results"] == []
