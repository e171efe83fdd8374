"""Explanations and revisions in the store, and an older file that gains them."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

import pytest
from sqlalchemy.exc import IntegrityError

import migrations
from service.monitoring.alarm import AlarmEvent, AlarmKind, Change
from service.store.database import _engine, open_database
from service.store.errors import UnknownRecordError
from service.store.model_records import ExplanationEnd, ExplanationOrder
from service.store.records import AlarmChange, Queued, RunOrder, StepParameters
from service.store.repository import Repository

NOON = datetime(2026, 11, 21, 12, tzinfo=UTC)
FOUND = {"axes": [{"axis": "X1", "finding": "effect", "effects": ["sensor_latency"]}]}


def run(repository: Repository, steps: StepParameters | None = None) -> int:
    answer = repository.queue_run(RunOrder("on_demand", "X1", "gantry", ("X1", "X2"), NOON, steps=steps))
    assert isinstance(answer, Queued)
    return answer.run_id


def ordered(repository: Repository, run_id: int) -> int:
    return repository.models.order(ExplanationOrder(run_id, (run_id,), "background", NOON))


def test_an_explanation_comes_back_as_it_was_found(repository: Repository) -> None:
    number = ordered(repository, run(repository))
    assert repository.models.explanation(number).state == "queued"
    repository.models.begin(number)
    repository.models.finish(ExplanationEnd(number, "done", NOON, None, FOUND, "2026/e.parquet"))
    (kept,) = repository.models.explanations(axis="X2")
    assert (kept.state, kept.found, kept.predictions_path) == ("done", FOUND, "2026/e.parquet")
    assert kept.of_axis("X1") == FOUND["axes"][0]
    assert kept.of_axis("X2") is None
    assert repository.models.explanations(axis="Y") == ()


@pytest.mark.parametrize("end", [("done", None, None), ("skipped", None, None), ("cannot_tell", "x", FOUND)])
def test_a_verdict_has_what_was_found_or_why_there_is_none(
    repository: Repository, end: tuple[str, str | None, dict[str, object] | None]
) -> None:
    number = ordered(repository, run(repository))
    state, detail, found = end
    with pytest.raises(IntegrityError):
        repository.models.finish(ExplanationEnd(number, state, NOON, detail, found))  # type: ignore[arg-type]


def test_what_a_restart_interrupted_is_skipped_and_says_so(repository: Repository) -> None:
    waiting = ordered(repository, run(repository))
    assert repository.models.give_up_unfinished(NOON) == 1
    assert repository.models.give_up_unfinished(NOON) == 0
    kept = repository.models.explanation(waiting)
    assert kept.state == "skipped"
    assert "the service ended" in (kept.detail or "")


def test_a_run_keeps_the_steps_that_it_was_asked_for(repository: Repository) -> None:
    steps = StepParameters(0.008, 50.0, -1)
    assert repository.run(run(repository, steps)).steps == steps


def test_a_remark_changes_nothing_of_an_alarm(repository: Repository) -> None:
    raised = Change(AlarmKind.BACKLASH_HIGH, AlarmEvent.RAISED, "the trend left the band")
    repository.change_alarms([AlarmChange("X1", raised)], NOON)
    (before,) = repository.alarms()
    assert repository.remark_alarms("X1", NOON, "revision 1 was accepted", "A. Smith") == 1
    assert repository.alarms() == (before,)
    last = repository.alarm_events(before.id)[-1]
    assert (last.event, last.by, last.detail) == (AlarmEvent.REMARKED, "A. Smith", "revision 1 was accepted")
    assert repository.remark_alarms("Y", NOON, "nothing to remark") == 0


@pytest.mark.parametrize("what", ["explanation", "revision"])
def test_an_unknown_one_is_said_so(repository: Repository, what: str) -> None:
    with pytest.raises(UnknownRecordError, match=f"{what} 7"):
        getattr(repository.models, what)(7)


def test_an_older_store_keeps_its_alarms_through_the_migration(tmp_path: Path) -> None:
    path = tmp_path / "old.sqlite"
    engine = _engine(path)
    with engine.begin() as connection:
        migrations.upgrade(connection, "0001")
        for statement in (
            "INSERT INTO axes VALUES ('X1', 'X1', 0, NULL, NULL, 'declared', 1)",
            "INSERT INTO alarms (id, axis_name, kind, active, acknowledged, raised_at_utc, detail) "
            "VALUES (1, 'X1', 'backlash_high', 1, 0, '2026-11-20 02:30:00', 'high')",
            "INSERT INTO alarm_events (alarm_id, event, at_utc, detail) "
            "VALUES (1, 'raised', '2026-11-20 02:30:00', 'high')",
        ):
            connection.exec_driver_sql(statement)
    engine.dispose()
    database = open_database(path)
    repository = Repository(database)
    assert repository.remark_alarms("X1", NOON, "after the migration") == 1
    assert [line.detail for line in repository.alarm_events(1)] == ["high", "after the migration"]
    database.close()
