"""Explanations, revisions and separating moves over REST, bad input included."""

from __future__ import annotations

from typing import Any

import pytest

from service.runs.pairs import NothingToExplain
from service.store.model_records import ExplanationEnd
from tests.service.api.house import NOON, PAGE, House

ERROR = {"train_rms": 0.03, "validation_rms": 0.031, "backlash_m": 57e-6, "interval_95_m": [56e-6, 58e-6]}
FINDING: dict[str, Any] = {
    "axis": "X1",
    "channel": "acceleration",
    "finding": "effect",
    "effects": ["sensor_latency"],
    "indistinguishable": [],
    "separating_move": None,
    "candidates": [{"effect": "sensor_latency", "validation_rms": 0.031, "p_value": 1e-9}],
    "noise_rms": 0.03,
    "before": {**ERROR, "backlash_m": 80e-6},
    "after": ERROR,
    "parameters": {"latency_s": {"value": 0.0017, "std": 1e-5, "unit": "s"}},
    "added_later": 7,
}


def problem(response: Any, status: int, kind: str) -> dict[str, Any]:
    assert response.status_code == status, response.text
    assert response.headers["Content-Type"] == "application/problem+json"
    found: dict[str, Any] = response.json()
    assert found["type"] == f"urn:flankwatch:problem:{kind}"
    return found


def explained(house: House, run_id: int = 21) -> int:
    number = house.loop.explain(run_id, ())
    end = ExplanationEnd(number, "done", NOON, None, {"axes": [FINDING]}, f"e-{number}.parquet")
    house.repository.models.finish(end)
    return number


def proposed(house: House) -> int:
    return house.repository.models.propose("X1", FINDING, NOON, run_id=21, explanation_id=explained(house))


def test_an_explanation_is_accepted_followed_and_read(nights: House) -> None:
    response = nights.client.post("/api/v1/runs/21/explanations")
    assert response.status_code == 202
    location = response.headers["Location"]
    assert response.json() == {"id": 1, "location": location, "train_run_ids": [20]}
    assert nights.get(location)["state"] == "queued"
    problem(nights.client.get(f"{location}/report"), 404, "nothing-to-show")
    number = explained(nights)
    found = nights.get(f"/api/v1/explanations/{number}")
    assert found["found"]["axes"][0] == {**FINDING, "accepted": [], "absent": []}
    assert "time lag" in found["in_words"]["X1"]
    page = nights.client.get(found["report"])
    assert (page.text, page.headers["Content-Type"]) == (PAGE, "text/html; charset=utf-8")
    checks = nights.get("/api/v1/runs/21")["model_checks"]
    assert [check["state"] for check in checks] == ["done", "queued"]
    assert len(nights.get("/api/v1/runs/21/explanations")["items"]) == 2


def test_predictions_are_downloaded_while_they_are_there(nights: House) -> None:
    number = explained(nights)
    problem(nights.client.get(f"/api/v1/explanations/{number}/predictions"), 404, "nothing-to-show")
    nights.captures.mkdir()
    (nights.captures / f"e-{number}.parquet").write_bytes(b"PAR1")
    assert nights.client.get(f"/api/v1/explanations/{number}/predictions").content == b"PAR1"


def test_a_finding_is_shown_where_the_value_is(nights: House) -> None:
    revision = proposed(nights)
    axis = nights.get("/api/v1/axes/X1")
    assert [one["id"] for one in axis["proposed"]] == [revision]
    assert axis["model_check"]["in_words"]["X1"].startswith("The model lacks a time lag")
    assert (axis["revision"], axis["declared"]) == (None, None)
    nights.client.post(f"/api/v1/revisions/{revision}/accept", json={"by": "A. Smith"})
    axis = nights.get("/api/v1/axes/X1")
    assert axis["revision"]["id"] == revision
    assert axis["series"] == f"revision-{revision}"
    assert axis["current"] is None, "nothing is restated yet"
    assert axis["declared"]["backlash_m"] == pytest.approx(80e-6)


def test_a_revision_is_listed_read_and_decided_once(nights: House) -> None:
    revision = proposed(nights)
    (listed,) = nights.get("/api/v1/revisions?axis=X1&state=proposed")["items"]
    assert (listed["backlash_before_m"], listed["backlash_after_m"]) == (80e-6, 57e-6)
    path = f"/api/v1/revisions/{revision}"
    assert nights.get(path)["finding"]["parameters"]["latency_s"]["unit"] == "s"
    assert nights.client.get(f"{path}/report").text == PAGE
    decided = nights.client.post(f"{path}/reject", json={"by": "A. Smith", "note": "a test weight"}).json()
    assert (decided["state"], decided["decided_by"], decided["note"]) == (
        "rejected",
        "A. Smith",
        "a test weight",
    )
    again = problem(nights.client.post(f"{path}/accept", json={"by": "B"}), 409, "already-decided")
    assert "A. Smith" in again["detail"]
    assert nights.get("/api/v1/revisions?state=proposed")["items"] == []


def test_an_axis_that_is_gone_takes_no_revision(nights: House) -> None:
    revision = proposed(nights)
    nights.repository.declare_axes([])
    response = nights.client.post(f"/api/v1/revisions/{revision}/accept", json={"by": "A"})
    problem(response, 409, "axis-gone")
    assert nights.client.post(f"/api/v1/revisions/{revision}/reject", json={"by": "A"}).status_code == 200


@pytest.mark.parametrize(
    "path",
    ["/runs/999/explanations", "/explanations/999", "/explanations/999/report", "/revisions/999"],
)
def test_what_is_not_there_is_said_so(nights: House, path: str) -> None:
    problem(nights.client.get(f"/api/v1{path}"), 404, "unknown-record")


@pytest.mark.parametrize("what", ["/runs/999/explanations", "/revisions/999/accept", "/revisions/999/reject"])
def test_nothing_unknown_is_acted_on(nights: House, what: str) -> None:
    body = None if what.startswith("/runs") else {"by": "A"}
    problem(nights.client.post(f"/api/v1{what}", json=body), 404, "unknown-record")


@pytest.mark.parametrize("kind", ["no-capture", "capture-missing", "capture-changed", "no-train-run"])
def test_a_run_that_cannot_be_explained_says_why(nights: House, kind: str) -> None:
    nights.loop.nothing = NothingToExplain(kind, "because")
    found = problem(nights.client.post("/api/v1/runs/21/explanations"), 409, kind)
    assert found["detail"] == "because"


@pytest.mark.parametrize("body", [{}, {"by": ""}, {"by": "A", "why": 1}])
def test_a_decision_needs_a_name(nights: House, body: dict[str, object]) -> None:
    problem(
        nights.client.post(f"/api/v1/revisions/{proposed(nights)}/accept", json=body), 422, "invalid-request"
    )


def test_a_separating_move_becomes_a_run_of_these_steps(house: House) -> None:
    move = {
        "axis": "X1",
        "length_m": 0.008,
        "jerk_m_s3": 50.0,
        "direction": -1,
        "position": "as before",
        "why": "x",
    }
    response = house.client.post("/api/v1/moves", json=move)
    assert response.status_code == 202
    run = house.get(response.headers["Location"])
    assert run["other_steps"] == {"length_m": 0.008, "jerk_m_s3": 50.0, "direction": -1, "positions_m": []}
    problem(house.client.post("/api/v1/moves", json=move), 409, "busy")


def test_what_looks_alike_is_shown_with_the_move_that_tells_it_apart(nights: House) -> None:
    move = {"length_m": 0.008, "jerk_m_s3": 50.0, "direction": -1, "position": "as before", "why": "slower"}
    alike = FINDING | {"indistinguishable": [["sensor_latency", "speed_filter"]], "separating_move": move}
    number = nights.loop.explain(21, ())
    nights.repository.models.finish(ExplanationEnd(number, "done", NOON, None, {"axes": [alike]}))
    axis = nights.get("/api/v1/axes/X1")
    assert axis["model_check"]["separating_moves"] == {"X1": move}
    assert nights.client.post("/api/v1/moves", json={"axis": "X1", **move}).status_code == 202
    nights.repository.models.propose("X1", alike, NOON, run_id=21, explanation_id=number)
    assert nights.get("/api/v1/axes/X1")["proposed"][0]["separating_move"] == move


@pytest.mark.parametrize(
    ("change", "kind"),
    [
        ({"length_m": 5.0}, "beyond-limits"),
        ({"length_m": -1.0}, "invalid-request"),
        ({"jerk_m_s3": 0.0}, "invalid-request"),
        ({"direction": 2}, "invalid-request"),
        ({"axis": "Q"}, "unknown-target"),
    ],
)
def test_a_move_beyond_the_limits_moves_nothing(house: House, change: dict[str, object], kind: str) -> None:
    move = {"axis": "X1", "length_m": 0.008, "jerk_m_s3": 50.0} | change
    problem(house.client.post("/api/v1/moves", json=move), 422, kind)
    assert house.get("/api/v1/runs")["items"] == []
