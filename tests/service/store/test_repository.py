"""The repository: what goes in comes out, and what must not go in does not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from datetime import UTC, date, datetime, timedelta, timezone

import pytest
from sqlalchemy.exc import IntegrityError, StatementError

from service.backlash.results import AxisResult, ByProduct, PlaceValue, Reason, StepResult
from service.monitoring.alarm import AlarmEvent, AlarmKind, Change
from service.monitoring.trend import Trend
from service.store.errors import AlreadyDecidedError, StoreError, UnknownRecordError
from service.store.records import (
    AlarmChange,
    AlreadyRun,
    AxisOutcome,
    AxisRecord,
    Busy,
    CaptureFile,
    KeyReused,
    Queued,
    RunEnd,
    RunOrder,
)
from service.store.repository import Repository

NOON = datetime(2026, 11, 21, 12, tzinfo=UTC)
STEPS = (
    StepResult(0, 1, "ok", backlash=57.1e-6, t1=0.3951, t2=0.4068),
    StepResult(1, -1, "refused", Reason.NO_RECONTACT, "the flanks were not seen to meet"),
)
ACCEPTED = AxisResult("X1", "ok", "paper", None, None, 57.1e-6, (56.0e-6, 58.2e-6), STEPS)
REFUSED = AxisResult("X2", "refused", "paper", Reason.STEPS_DISAGREE, "the steps differ by 30 µm")


def order(at: datetime = NOON, key: str | None = None, night: date | None = None) -> RunOrder:
    kind = "on_demand" if night is None else "nightly"
    return RunOrder(kind, "X1", "gantry", ("X1", "X2"), at, night, key)


def queued(repository: Repository, at: datetime = NOON, night: date | None = None) -> int:
    answer = repository.queue_run(order(at, night=night))
    assert isinstance(answer, Queued)
    return answer.run_id


def finished(repository: Repository, at: datetime, outcomes: Sequence[AxisOutcome]) -> int:
    run_id = queued(repository, at)
    repository.start_run(run_id, at)
    repository.finish_run(RunEnd(run_id, "ok", at), outcomes)
    return run_id


def value(b: float, method: str = "paper") -> AxisOutcome:
    return AxisOutcome(AxisResult("X1", "ok", method, backlash=b))


def change(event: AlarmEvent, detail: str = "the trend left the band") -> AlarmChange:
    return AlarmChange("X1", Change(AlarmKind.BACKLASH_HIGH, event, detail))


def test_a_run_comes_back_as_it_went_in(repository: Repository) -> None:
    capture = CaptureFile("2026/run.parquet", "a" * 64)
    trend = Trend(57e-6, (56e-6, 58e-6), 1e-13, (0.0, 2e-13), 9)
    run_id = queued(repository)
    repository.start_run(run_id, NOON + timedelta(seconds=1))
    end = RunEnd(run_id, "ok", NOON + timedelta(seconds=20), capture=capture)
    repository.finish_run(end, [AxisOutcome(ACCEPTED, trend=trend), AxisOutcome(REFUSED)])

    run = repository.run(run_id)
    assert (run.state, run.axes, run.group, run.target) == ("ok", ("X1", "X2"), "gantry", "X1")
    assert run.started_at == NOON + timedelta(seconds=1)
    assert run.capture == capture
    first, second = repository.outcomes(run_id)
    assert first.outcome == AxisOutcome(ACCEPTED, trend=trend)
    assert first.measured_at == end.finished_at
    assert second.outcome == AxisOutcome(REFUSED)


def test_times_are_utc_whatever_zone_they_came_in(repository: Repository) -> None:
    berlin = timezone(timedelta(hours=2))
    run_id = queued(repository, datetime(2026, 7, 1, 2, 30, tzinfo=berlin))
    assert repository.run(run_id).requested_at == datetime(2026, 7, 1, 0, 30, tzinfo=UTC)
    assert repository.run(run_id).requested_at.utcoffset() == timedelta(0)


def test_a_time_without_a_zone_is_refused(repository: Repository) -> None:
    naive = datetime(2026, 7, 1, 2, 30)
    with pytest.raises(StatementError, match="without a zone"):
        queued(repository, naive)


def test_one_run_at_a_time(repository: Repository) -> None:
    run_id = queued(repository)
    assert repository.queue_run(order()) == Busy(run_id)
    repository.start_run(run_id, NOON)
    assert repository.queue_run(order()) == Busy(run_id)
    repository.finish_run(RunEnd(run_id, "failed", NOON, "drive_fault", "0x8611"))
    assert repository.queue_run(order()) == Queued(run_id + 1)


def test_an_idempotency_key_gives_the_same_run_even_when_it_has_ended(repository: Repository) -> None:
    first = repository.queue_run(order(key="k1"))
    assert isinstance(first, Queued)
    assert repository.queue_run(order(key="k1")) == Queued(first.run_id, replayed=True)
    repository.finish_run(RunEnd(first.run_id, "failed", NOON, "drive_fault"))
    assert repository.queue_run(order(key="k1")) == Queued(first.run_id, replayed=True)
    other = RunOrder("on_demand", "Y", "Y", ("Y",), NOON, idempotency_key="k1")
    assert repository.queue_run(other) == KeyReused(first.run_id)


def test_one_nightly_run_per_group_and_local_date(repository: Repository) -> None:
    night = date(2026, 10, 25)
    run_id = queued(repository, night=night)
    repository.finish_run(RunEnd(run_id, "failed", NOON, "drive_fault"))
    assert repository.queue_run(order(night=night)) == AlreadyRun(run_id)
    assert isinstance(repository.queue_run(order(night=date(2026, 10, 26))), Queued)
    assert set(repository.nightly_runs("gantry", night)) == {night, date(2026, 10, 26)}


def test_a_finished_run_is_never_changed(repository: Repository) -> None:
    run_id = finished(repository, NOON, [value(57e-6)])
    with pytest.raises(StoreError, match="ended before"):
        repository.finish_run(RunEnd(run_id, "failed", NOON, "drive_fault"))
    assert repository.run(run_id).state == "ok"


def test_a_run_is_stored_whole_or_not_at_all(repository: Repository) -> None:
    """The second answer breaks a rule of the tables; the first, the run's end and the alarm go with it."""
    run_id = queued(repository)
    wrong = AxisOutcome(AxisResult("X2", "refused", "paper", Reason.MISFIT, backlash=57e-6))
    with pytest.raises(IntegrityError):
        repository.finish_run(
            RunEnd(run_id, "ok", NOON), [AxisOutcome(ACCEPTED), wrong], [change(AlarmEvent.RAISED)]
        )
    assert repository.run(run_id).state == "queued"
    assert repository.outcomes(run_id) == ()
    assert repository.alarms() == ()


@pytest.mark.parametrize(
    "wrong",
    [
        AxisResult("X1", "refused", "paper", Reason.MISFIT, backlash=57e-6),
        AxisResult("X1", "refused", "paper"),
        AxisResult("X1", "ok", "paper"),
        AxisResult("X1", "ok", "paper", Reason.MISFIT, backlash=57e-6),
        AxisResult("X1", "ok", "paper", backlash=float("nan")),
        AxisResult("X1", "ok", "paper", backlash=float("inf")),
        AxisResult("X1", "ok", "paper", backlash=-57e-6),
        AxisResult("X1", "ok", "paper", backlash=57.0),
        AxisResult("nowhere", "ok", "paper", backlash=57e-6),
        AxisResult("X1", "ok", "paper", backlash=5e-5, steps=(StepResult(0, 1, "refused", backlash=5e-5),)),
    ],
)
def test_no_wrong_value_is_ever_stored(repository: Repository, wrong: AxisResult) -> None:
    """A refused answer with a number, an accepted one without, micrometres for metres, an unknown axis."""
    run_id = queued(repository)
    with pytest.raises(IntegrityError):
        repository.finish_run(RunEnd(run_id, "ok", NOON), [AxisOutcome(wrong)])
    assert repository.outcomes(run_id) == ()


def test_a_refused_run_needs_a_reason(repository: Repository) -> None:
    run_id = queued(repository)
    with pytest.raises(IntegrityError):
        repository.finish_run(RunEnd(run_id, "refused", NOON))


def test_history_is_of_one_method_and_without_refusals(repository: Repository) -> None:
    refusal = AxisOutcome(AxisResult("X1", "refused", "paper", Reason.MISFIT))
    for day, outcome in enumerate(
        [value(57e-6), refusal, value(58e-6), value(61e-6, "model_fit"), value(59e-6)]
    ):
        finished(repository, NOON + timedelta(days=day), [outcome])
    assert list(repository.history("X1").b) == [57e-6, 58e-6, 59e-6]
    assert list(repository.history("X1", "model_fit").b) == [61e-6]
    assert repository.history("X1").t[0] == NOON.timestamp()
    assert len(repository.values("X1")) == 5
    assert repository.history("Y").b.size == 0


def test_a_refined_answer_takes_over_and_the_plain_one_stays_beside(repository: Repository) -> None:
    run_id = finished(repository, NOON, [value(57e-6)])
    repository.add_outcomes(run_id, [value(60e-6, "model_fit")])
    assert [(v.outcome.result.method, v.outcome.reported) for v in repository.outcomes(run_id)] == [
        ("paper", False),
        ("model_fit", True),
    ]
    assert list(repository.history("X1").b) == [60e-6]
    with pytest.raises(IntegrityError):
        repository.add_outcomes(run_id, [value(61e-6, "model_fit")])


def test_values_page_without_gap_or_overlap(repository: Repository) -> None:
    for day in range(7):
        finished(repository, NOON + timedelta(days=day // 2), [value((50 + day) * 1e-6)])
    seen, before = [], None
    while page := repository.values("X1", limit=2, before=before):
        seen += [v.id for v in page]
        before = (page[-1].measured_at, page[-1].id)
    assert seen == sorted(seen, reverse=True)
    assert len(seen) == 7


def test_runs_page_and_filter(repository: Repository) -> None:
    ids = [finished(repository, NOON, []) for _ in range(5)]
    assert [run.id for run in repository.runs(limit=2)] == ids[:-3:-1]
    assert [run.id for run in repository.runs(before=ids[2])] == ids[1::-1]
    assert repository.runs(axis="Y") == ()
    assert repository.run_counts() == {"ok": 5}


def test_alarm_from_raise_to_end(repository: Repository) -> None:
    run_id = queued(repository)
    repository.finish_run(RunEnd(run_id, "ok", NOON), [], [change(AlarmEvent.RAISED)])
    (alarm,) = repository.alarms()
    assert (alarm.state.active, alarm.state.acknowledged, alarm.raised_at) == (True, False, NOON)
    assert repository.active_alarms("X1") == {AlarmKind.BACKLASH_HIGH}

    seen = repository.acknowledge(alarm.id, NOON + timedelta(hours=1), "A. Smith", "pinion ordered")
    assert (seen.state.active, seen.state.acknowledged, seen.acknowledged_by) == (True, True, "A. Smith")
    assert repository.acknowledge(alarm.id, NOON + timedelta(hours=2), "B").acknowledged_by == "A. Smith"

    repository.change_alarms([change(AlarmEvent.CLEARED, "back inside")], NOON + timedelta(days=3))
    assert repository.alarms() == ()
    assert repository.alarm(alarm.id).cleared_at == NOON + timedelta(days=3)
    journal = [(line.event, line.by, line.run_id, line.detail) for line in repository.alarm_events(alarm.id)]
    assert journal == [
        (AlarmEvent.RAISED, None, run_id, "the trend left the band"),
        (AlarmEvent.ACKNOWLEDGED, "A. Smith", None, "pinion ordered"),
        (AlarmEvent.CLEARED, None, None, "back inside"),
    ]


def test_an_unseen_alarm_that_comes_back_is_the_same_alarm(repository: Repository) -> None:
    for day, event in enumerate([AlarmEvent.RAISED, AlarmEvent.CLEARED, AlarmEvent.RAISED]):
        repository.change_alarms([change(event)], NOON + timedelta(days=day))
    (alarm,) = repository.alarms()
    assert (alarm.state.active, alarm.state.acknowledged, alarm.cleared_at) == (True, False, None)
    assert len(repository.alarm_events(alarm.id)) == 3


def test_failed_and_refused_runs_leave_an_alarm_as_it_is(repository: Repository) -> None:
    repository.change_alarms([change(AlarmEvent.RAISED)], NOON)
    before = repository.alarms()
    failed, refused = queued(repository), None
    repository.finish_run(RunEnd(failed, "failed", NOON, "drive_fault"))
    refused = queued(repository)
    repository.finish_run(RunEnd(refused, "refused", NOON, "misfit"), [AxisOutcome(REFUSED)])
    assert repository.alarms() == before


def test_an_interrupted_run_is_failed_with_its_reason(repository: Repository) -> None:
    run_id = queued(repository)
    repository.start_run(run_id, NOON)
    assert repository.fail_interrupted(NOON + timedelta(hours=1)) == (run_id,)
    run = repository.run(run_id)
    assert (run.state, run.reason) == ("failed", "interrupted")
    assert "heartbeat" in (run.detail or "")
    assert repository.fail_interrupted(NOON) == ()
    assert repository.unfinished_run() is None


def test_an_axis_that_left_the_configuration_keeps_its_history(repository: Repository) -> None:
    finished(repository, NOON, [value(57e-6)])
    repository.declare_axes([AxisRecord("Y", "Y", 40e-6, 10e-6)])
    assert [(axis.name, axis.reference) for axis in repository.axes()] == [("Y", 40e-6)]
    assert not repository.axis("X1").configured
    assert list(repository.history("X1").b) == [57e-6]


def test_an_accepted_revision_begins_a_series_beside_the_declared_one(repository: Repository) -> None:
    run_id = finished(repository, NOON, [value(57e-6)])
    finding = {"effects": ["sensor_latency"], "before": {"backlash_m": 57e-6}, "after": {"backlash_m": 60e-6}}
    revision_id = repository.models.propose("X1", finding, NOON, run_id=run_id)
    assert repository.models.revisions("X1")[0].state == "proposed"
    assert repository.models.in_force("X1") is None
    decided = repository.models.decide(revision_id, accept=True, at=NOON, by="A. Smith")
    assert repository.models.in_force("X1") == decided
    assert (decided.state, decided.finding, decided.decided_by) == ("accepted", finding, "A. Smith")
    series = repository.axis("X1").series
    restated = AxisOutcome(
        AxisResult("X1", "ok", "paper", backlash=60e-6), series=series, model_revision=revision_id
    )
    repository.add_outcomes(run_id, [restated])
    assert list(repository.history("X1").b) == [60e-6]
    assert [v.outcome.result.backlash for v in repository.outcomes(run_id)] == [57e-6, 60e-6]
    assert all(v.outcome.reported for v in repository.outcomes(run_id))
    assert list(repository.history("X1", series="declared").b) == [57e-6]
    with pytest.raises(AlreadyDecidedError, match=r"accepted by A\. Smith"):
        repository.models.decide(revision_id, accept=False, at=NOON, by="B")


@pytest.mark.parametrize("missing", ["run", "alarm", "axis"])
def test_what_is_not_there_is_said_so(repository: Repository, missing: str) -> None:
    ask = {
        "run": lambda: repository.run(7),
        "alarm": lambda: repository.acknowledge(7, NOON, "me"),
        "axis": lambda: repository.axis("Q"),
    }[missing]
    with pytest.raises(UnknownRecordError, match=f"no {missing} '?[7Q]'?"):
        ask()


def test_the_map_and_the_by_products_come_back_with_their_run(repository: Repository) -> None:
    place = PlaceValue(0.5, "ok", backlash=57.1e-6, interval_95=(56.0e-6, 58.2e-6))
    worn = PlaceValue(1.5, "refused", Reason.MISFIT, "something is loose there")
    product = ByProduct("skew", 1e-4, 1e-6, "s")
    result = replace(ACCEPTED, by_place=(place, worn), by_products=(product,))
    run_id = finished(repository, NOON, [AxisOutcome(result)])
    found = repository.outcomes(run_id)[0].outcome.result
    assert (found.by_place, found.by_products) == ((place, worn), (product,))


def test_a_by_product_has_a_history_of_accepted_values(repository: Repository) -> None:
    for hour, skew in enumerate((1e-4, 2e-4)):
        result = replace(ACCEPTED, by_products=(ByProduct("skew", skew, 1e-6, "s"),))
        finished(repository, NOON + timedelta(hours=hour), [AxisOutcome(result)])
    assert [record.product.value for record in repository.parts.by_products("X1")] == [2e-4, 1e-4]
    assert repository.parts.by_products("X2") == ()
