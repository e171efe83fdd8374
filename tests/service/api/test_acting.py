"""Checks and acknowledgements: what a person can do."""

from __future__ import annotations

import pytest

from service.store.records import Progress, RunEnd
from tests.service.api.house import NOON, House


def test_a_check_is_accepted_and_can_be_followed(house: House) -> None:
    response = house.client.post("/api/v1/checks", json={"axis": "X1"})
    assert response.status_code == 202
    assert response.headers["Location"] == response.json()["location"] == "/api/v1/runs/1"
    run = house.get(response.headers["Location"])
    assert (run["state"], run["kind"], run["target"]) == ("queued", "on_demand", "X1")


def test_a_busy_machine_says_who_is_in_the_way(house: House) -> None:
    house.client.post("/api/v1/checks", json={"group": "gantry"})
    response = house.client.post("/api/v1/checks", json={"axis": "Y"})
    assert (response.status_code, response.json()["run_id"]) == (409, 1)
    assert response.json()["type"] == "urn:flankwatch:problem:busy"


def test_the_same_key_gives_the_same_run_and_moves_once(house: House) -> None:
    asks = [
        house.client.post("/api/v1/checks", json={"axis": "X1"}, headers={"Idempotency-Key": "a"})
        for _ in range(3)
    ]
    assert [ask.json()["run_id"] for ask in asks] == [1, 1, 1]
    assert [ask.json()["replayed"] for ask in asks] == [False, True, True]
    house.repository.finish_run(RunEnd(1, "failed", NOON, "drive_fault"))
    other = house.client.post("/api/v1/checks", json={"axis": "Y"}, headers={"Idempotency-Key": "a"})
    assert (other.status_code, other.json()["type"]) == (422, "urn:flankwatch:problem:key-reused")
    assert len(house.get("/api/v1/runs")["items"]) == 1


@pytest.mark.parametrize(
    "body",
    [
        {},
        {"axis": "X1", "group": "gantry"},
        {"axis": "nowhere"},
        {"axis": "gantry"},
        {"group": "X1"},
        {"axis": "X1", "speed": 3},
        {"axis": 7},
        [],
        "X1",
        None,
    ],
)
def test_what_is_not_understood_moves_nothing(house: House, body: object) -> None:
    response = house.client.post("/api/v1/checks", json=body)
    assert response.status_code == 422
    assert response.headers["Content-Type"] == "application/problem+json"
    assert house.get("/api/v1/runs")["items"] == []


@pytest.mark.parametrize(
    ("content", "header", "says"),
    [
        ('{"axis":', "application/json", "body: is not JSON (at character 8)"),
        ("axis=Y", "application/x-www-form-urlencoded", "with the header Content-Type: application/json"),
        ("", "application/json", "is not a JSON object"),
    ],
)
def test_a_body_that_is_no_object_is_told_what_it_should_be(
    house: House, content: str, header: str, says: str
) -> None:
    response = house.client.post("/api/v1/checks", content=content, headers={"Content-Type": header})
    assert response.status_code == 422
    assert says in response.json()["detail"]


def test_a_machine_that_cannot_move_says_why(house: House) -> None:
    house.box.unavailable = "no heartbeat from drive 2: check its supply and the CAN cable"
    response = house.client.post("/api/v1/checks", json={"axis": "X1"})
    assert (response.status_code, response.json()["detail"]) == (503, house.box.unavailable)


def test_status_shows_where_a_check_stands(house: House) -> None:
    assert house.get("/api/v1/status")["progress"] is None
    house.box.now = Progress(4, "gantry", "step back", 3, 10)
    assert house.get("/api/v1/status")["progress"] == {
        "run_id": 4, "target": "gantry", "phase": "step back", "done": 3, "total": 10,
    }  # fmt: skip


def test_an_alarm_is_acknowledged_and_stays_active(nights: House) -> None:
    (alarm,) = nights.get("/api/v1/alarms")["items"]
    path = f"/api/v1/alarms/{alarm['id']}"
    response = nights.client.post(f"{path}/acknowledge", json={"by": "A. Smith", "comment": "pinion ordered"})
    assert response.status_code == 200
    seen = response.json()
    assert (seen["active"], seen["acknowledged"], seen["acknowledged_by"]) == (True, True, "A. Smith")
    assert [(line["event"], line["by"]) for line in seen["events"]] == [
        ("raised", None),
        ("acknowledged", "A. Smith"),
    ]
    assert nights.get("/api/v1/axes/X1")["alarm_state"] == "acknowledged"
    assert nights.get(path) == seen


def test_acknowledging_twice_changes_nothing(nights: House) -> None:
    path = "/api/v1/alarms/1/acknowledge"
    first = nights.client.post(path, json={"by": "A"}).json()
    assert nights.client.post(path, json={"by": "B"}).json() == first


@pytest.mark.parametrize("body", [{}, {"by": ""}, {"by": "x" * 200}, {"by": "A", "clear": True}])
def test_an_acknowledgement_needs_a_name_and_nothing_else(nights: House, body: dict[str, object]) -> None:
    assert nights.client.post("/api/v1/alarms/1/acknowledge", json=body).status_code == 422
    assert nights.get("/api/v1/alarms/1")["acknowledged"] is False


def test_ended_alarms_are_kept_and_shown_on_request(house: House) -> None:
    from service.monitoring.alarm import AlarmEvent, AlarmKind, Change
    from service.store.records import AlarmChange

    def change(event: AlarmEvent) -> list[AlarmChange]:
        return [AlarmChange("Y", Change(AlarmKind.RUN_MISSING, event, "two nights without a value"))]

    house.repository.change_alarms(change(AlarmEvent.RAISED), NOON)
    house.client.post("/api/v1/alarms/1/acknowledge", json={"by": "A"})
    house.repository.change_alarms(change(AlarmEvent.CLEARED), NOON)
    assert house.get("/api/v1/alarms")["items"] == []
    assert [alarm["axis"] for alarm in house.get("/api/v1/alarms?all=true")["items"]] == ["Y"]
