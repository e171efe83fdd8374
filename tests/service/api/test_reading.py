"""Axes, histories, runs, captures and pictures as they are read."""

from __future__ import annotations

import numpy as np
import pytest

from tests.service.api.house import SVG, House, run_map, run_night


def test_an_axis_shows_value_interval_trend_and_alarm(nights: House) -> None:
    axis = nights.get("/api/v1/axes/X1")
    assert (axis["reference_m"], axis["tolerance_m"], axis["alarm_state"]) == (57e-6, 15e-6, "unacknowledged")
    current = axis["current"]
    assert (current["backlash_m"], current["method"], current["run_id"]) == (80e-6, "paper", 21)
    assert current["interval_95_m"] == [80e-6 - 1e-6, 80e-6 + 1e-6]
    assert current["trend"]["level_m"] == 80e-6
    assert current["trend"]["count"] == 9
    assert [alarm["kind"] for alarm in axis["alarms"]] == ["backlash_high"]


def test_a_refused_night_leaves_the_last_value_standing_and_shows(house: House) -> None:
    run_night(house.repository, 0, 57e-6)
    run_night(house.repository, 1, None)
    axis = house.get("/api/v1/axes/X1")
    assert axis["current"]["run_id"] == 1
    assert (axis["latest"]["run_id"], axis["latest"]["verdict"]) == (2, "refused")
    assert (axis["latest"]["backlash_m"], axis["latest"]["interval_95_m"]) == (None, None)
    assert "loose" in axis["latest"]["reason_in_words"]


def test_an_axis_that_was_never_measured_is_null_not_zero(house: House) -> None:
    axes = house.get("/api/v1/axes")["items"]
    assert [axis["name"] for axis in axes] == ["X1", "X2", "Y"]
    assert all(axis["current"] is None and axis["alarm_state"] == "normal" for axis in axes)


def test_history_pages_without_gap_or_overlap(nights: House) -> None:
    runs, cursor, pages = [], "", 0
    while cursor is not None:
        page = nights.get(f"/api/v1/axes/X1/history?limit=5{cursor and '&cursor=' + cursor}")
        runs += [item["run_id"] for item in page["items"]]
        cursor, pages = page["next_cursor"], pages + 1
    assert runs == list(range(21, 0, -1))
    assert pages == 5


def test_a_new_night_between_two_pages_moves_nothing(nights: House) -> None:
    first = nights.get("/api/v1/axes/X1/history?limit=5")
    run_night(nights.repository, 30, 80e-6)
    second = nights.get(f"/api/v1/axes/X1/history?limit=5&cursor={first['next_cursor']}")
    assert [item["run_id"] for item in second["items"]] == [16, 15, 14, 13, 12]


def test_runs_page_and_filter_by_axis(nights: House) -> None:
    first = nights.get("/api/v1/runs?limit=20")
    assert len(first["items"]) == 20
    second = nights.get(f"/api/v1/runs?limit=20&cursor={first['next_cursor']}")
    assert ([run["id"] for run in second["items"]], second["next_cursor"]) == ([1], None)
    assert nights.get("/api/v1/runs?axis=Y")["items"] == []


def test_a_run_shows_its_steps_and_the_reason_of_each_refusal(nights: House) -> None:
    run = nights.get("/api/v1/runs/1")
    x1, x2 = run["results"]
    assert (run["kind"], run["local_date"], run["axes"]) == ("nightly", "2026-09-01", ["X1", "X2"])
    assert [step["direction"] for step in x1["steps"]] == [1, -1] * 5
    assert (x1["steps"][0]["t1_s"], x1["steps"][0]["backlash_m"]) == (0.1, 57e-6)
    assert (x2["verdict"], x2["reason"], x2["backlash_m"], x2["steps"]) == (
        "refused",
        "sensor_flat",
        None,
        [],
    )
    assert x2["reason_in_words"].startswith("The accelerometer shows no motion.")


def test_what_the_client_has_is_not_sent_again(nights: House) -> None:
    for path in (
        "/api/v1/axes",
        "/api/v1/axes/X1/history",
        "/api/v1/runs",
        "/api/v1/runs/3",
        "/api/v1/alarms",
    ):
        tag = nights.client.get(path).headers["ETag"]
        again = nights.client.get(path, headers={"If-None-Match": f'"other", W/{tag}'})
        assert (again.status_code, again.content, again.headers["ETag"]) == (304, b"", tag)
        assert nights.client.get(path, headers={"If-None-Match": '"other"'}).status_code == 200


def test_the_tag_changes_with_the_content(nights: House) -> None:
    tag = nights.client.get("/api/v1/axes").headers["ETag"]
    run_night(nights.repository, 40, 80e-6)
    assert nights.client.get("/api/v1/axes", headers={"If-None-Match": tag}).status_code == 200


def test_the_capture_is_downloaded_byte_for_byte(nights: House) -> None:
    nights.captures.mkdir()
    (nights.captures / "night-0.parquet").write_bytes(b"PAR1 and so on")
    response = nights.client.get("/api/v1/runs/1/capture")
    assert response.content == b"PAR1 and so on"
    assert response.headers["Content-Type"] == "application/vnd.apache.parquet"
    assert 'filename="night-0.parquet"' in response.headers["Content-Disposition"]
    assert response.headers["ETag"] == '"' + "5" * 64 + '"'


def test_a_capture_that_is_gone_is_a_problem_not_an_error(nights: House) -> None:
    response = nights.client.get("/api/v1/runs/1/capture")
    assert response.status_code == 404
    assert "moved or deleted" in response.json()["detail"]


@pytest.mark.parametrize("secret", ["../secret", "/etc/hostname"])
def test_a_capture_outside_its_folder_is_never_sent(house: House, secret: str) -> None:
    from service.store.records import CaptureFile, RunEnd
    from tests.service.api.house import NOON

    house.captures.mkdir()
    (house.captures.parent / "secret").write_text("secret")
    answer = house.box.request("X1", None)
    house.repository.finish_run(RunEnd(answer.run_id, "ok", NOON, capture=CaptureFile(secret, "0" * 64)))
    assert house.client.get(f"/api/v1/runs/{answer.run_id}/capture").status_code == 404


def test_a_picture_of_a_step(nights: House) -> None:
    response = nights.client.get("/api/v1/runs/1/picture?axis=X1&step=3")
    assert (response.text, response.headers["Content-Type"]) == (SVG, "image/svg+xml")
    assert "default-src 'none'" in response.headers["Content-Security-Policy"]
    missing = nights.client.get("/api/v1/runs/1/picture?axis=X1&step=99")
    assert (missing.status_code, missing.json()["title"]) == (404, "Nothing to show")


def test_an_axis_shows_the_map_of_its_current_value(house: House) -> None:
    house.client = house.rebuild(diagnostic_positions={"Y": (-0.6, 0.0, 0.6)})
    assert house.get("/api/v1/axes/Y")["by_place"] == []
    run_map(house.repository, 0)
    axis = house.get("/api/v1/axes/Y")
    assert axis["diagnostic_positions_m"] == [-0.6, 0.0, 0.6]
    assert [(p["position_m"], p["backlash_m"]) for p in axis["by_place"]] == [
        (-0.6, 40e-6), (0.0, 47e-6), (0.6, None),
    ]  # fmt: skip
    assert "loose" in axis["by_place"][2]["reason_in_words"]
    assert house.get("/api/v1/axes/X1")["diagnostic_positions_m"] == []


def test_a_tolerance_that_chance_leaves_is_said_with_the_axis(house: House) -> None:
    """X1 scatters by 10 µm from night to night; 15 µm are less than three times that."""
    scatter = np.random.default_rng(5).normal(0.0, 10e-6, 40)
    for day, off in enumerate(scatter[:5]):
        run_night(house.repository, day, 57e-6 + off)
    early = house.get("/api/v1/axes/X1")
    assert (early["repeatability_m"], early["tolerance_hint"]) == (None, None)
    for day, off in enumerate(scatter[5:], 5):
        run_night(house.repository, day, 57e-6 + off)
    axis = house.get("/api/v1/axes/X1")
    assert axis["repeatability_m"] == pytest.approx(10e-6, rel=0.4)
    assert "tolerance_um" in axis["tolerance_hint"]
