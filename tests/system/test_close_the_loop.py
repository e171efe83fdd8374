"""The loop on the running service, with a quick analysis: the guide rubs more one way from the third run on."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from fastapi.testclient import TestClient

from service.app import house
from service.demo import demo_settings, open_demo
from service.dynamics.effects.carriage import AsymmetricFriction
from tests.benchmarks.close_the_loop import check_and_wait
from tests.system.pull import PullAnalysis

PULLED = {"Y": (AsymmetricFriction(400.0),)}


def test_an_effect_that_begins_is_found_decided_and_restated(tmp_path: Path) -> None:
    machine = partial(open_demo, effects=PULLED, from_run=3)
    with (
        house(demo_settings(tmp_path), machine, analysis=PullAnalysis) as opened,
        TestClient(opened.web(), base_url="http://localhost") as api,
    ):
        for _ in range(5):
            check_and_wait(opened, api, "Y")
        (revision,) = api.get("/api/v1/revisions?state=proposed").json()["items"]
        assert revision["effects"] == ["asymmetric_friction"]
        assert [one["id"] for one in api.get("/api/v1/axes/Y").json()["proposed"]] == [revision["id"]]
        assert "friction that differs by direction" in api.get(revision["report"]).text
        accepted = api.post(f"/api/v1/revisions/{revision['id']}/accept", json={"by": "A. Smith"})
        assert accepted.status_code == 200
        assert opened.workbench.wait_idle(60)
        check_and_wait(opened, api, "Y")
        axis = api.get("/api/v1/axes/Y").json()
        assert axis["current"]["series"] == f"revision-{revision['id']}"
        assert axis["declared"]["run_id"] == axis["current"]["run_id"] == 6
        assert axis["current"]["trend"]["count"] == 6
        assert api.get("/api/v1/alarms?all=true").json()["items"] == []
