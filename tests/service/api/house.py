"""What the tests of the API live in: a store, a box of runs that moves nothing, and nights to fill it with."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

from fastapi.testclient import TestClient

from service.backlash.results import AxisResult, ByProduct, PlaceValue, Reason, StepResult
from service.monitoring.alarm import Band, judge
from service.runs.deciding import AxisGoneError
from service.runs.pairs import NothingToExplain
from service.store.model_records import ExplanationOrder, RevisionRecord
from service.store.records import (
    AlarmChange,
    AxisOutcome,
    BeyondLimits,
    CaptureFile,
    CheckAnswer,
    Progress,
    Queued,
    RunEnd,
    RunOrder,
    RunRecord,
    StepParameters,
    StepsAnswer,
    Unavailable,
)
from service.store.repository import Repository

NOON = datetime(2026, 9, 1, 12, tzinfo=UTC)
PAGE = "<!doctype html><title>found</title>"
SVG = '<svg xmlns="http://www.w3.org/2000/svg"/>'


@dataclass
class Box:
    """A box of one run that never moves anything: a test ends its runs."""

    repository: Repository
    unavailable: str | None = None
    now: Progress | None = None

    def request(self, target: str, idempotency_key: str | None) -> CheckAnswer:
        if self.unavailable is not None:
            return Unavailable(self.unavailable)
        order = RunOrder("on_demand", target, "gantry", ("X1", "X2"), NOON, idempotency_key=idempotency_key)
        return self.repository.queue_run(order)

    def request_steps(self, target: str, steps: StepParameters) -> StepsAnswer:
        if steps.length > 1.0:
            return BeyondLimits(f"axis {target}: the step is longer than its travel")
        order = RunOrder("on_demand", target, "gantry", ("X1", "X2"), NOON, steps=steps)
        return self.repository.queue_run(order)

    def progress(self) -> Progress | None:
        return self.now


@dataclass
class Loop:
    """Computes nothing: a test ends what is asked for."""

    repository: Repository
    nothing: NothingToExplain | None = None
    now: tuple[int, str] | None = None

    def explain(self, run_id: int, train: Sequence[int]) -> int:
        self.repository.run(run_id)
        if self.nothing is not None:
            raise self.nothing
        order = ExplanationOrder(run_id, tuple(train) or (run_id - 1,), "on_demand", NOON)
        return self.repository.models.order(order)

    def decide(self, revision_id: int, *, accept: bool, by: str, note: str | None) -> RevisionRecord:
        axis = self.repository.models.revision(revision_id).axis
        if accept and not self.repository.axis(axis).configured:
            raise AxisGoneError(f"axis {axis} is no longer in the configuration")
        return self.repository.models.decide(revision_id, accept=accept, at=NOON, by=by, note=note)

    def progress(self) -> tuple[int, str] | None:
        return self.now


@dataclass
class House:
    """What a test of the API has in its hands."""

    client: TestClient
    repository: Repository
    box: Box
    captures: Path
    rebuild: Callable[..., TestClient]
    missing: list[str]
    loop: Loop

    def get(self, path: str) -> dict[str, Any]:
        response = self.client.get(path)
        assert response.status_code == 200, response.text
        found: dict[str, Any] = response.json()
        return found


def run_night(repository: Repository, day: int, b: float | None) -> int:
    """Store one nightly run of X1 and X2: X1 with the value b [m] or refused, X2 always refused."""
    at = NOON + timedelta(days=day)
    answer = repository.queue_run(RunOrder("nightly", "gantry", "gantry", ("X1", "X2"), at, at.date()))
    assert isinstance(answer, Queued)
    history = repository.history("X1").with_value(at.timestamp(), b)
    judged = judge(history.t, history.b, Band(57e-6, 15e-6), repository.active_alarms("X1"))
    steps = tuple(StepResult(i, 1 - 2 * (i % 2), "ok", backlash=b, t1=0.1, t2=0.2) for i in range(10) if b)
    interval = None if b is None else (b - 1e-6, b + 1e-6)
    first = AxisResult("X1", "ok", "paper", None, None, b, interval, steps)
    if b is None:
        first = AxisResult("X1", "refused", "paper", Reason.MISFIT, "something is loose")
    second = AxisResult("X2", "refused", "paper", Reason.SENSOR_FLAT, "the accelerometer shows no motion")
    outcomes = [AxisOutcome(first, trend=judged.trend if b else None), AxisOutcome(second)]
    changes = [AlarmChange("X1", change) for change in judged.changes]
    capture = CaptureFile(f"night-{day}.parquet", "5" * 64)
    repository.finish_run(RunEnd(answer.run_id, "ok", at, capture=capture), outcomes, changes)
    return answer.run_id


def run_map(repository: Repository, day: int) -> int:
    """Store a check of Y at three places along its rack, refused at the last."""
    at = NOON + timedelta(days=day)
    answer = repository.queue_run(RunOrder("on_demand", "Y", "Y", ("Y",), at))
    assert isinstance(answer, Queued)
    places = (
        PlaceValue(-0.6, "ok", None, None, 40e-6, (39e-6, 41e-6)),
        PlaceValue(0.0, "ok", None, None, 47e-6, (45e-6, 48e-6)),
        PlaceValue(0.6, "refused", Reason.MISFIT, "something is loose"),
    )
    steps = (StepResult(0, 1, "ok", backlash=40e-6, t1=0.1, t2=0.2, position=-0.6),)
    value = AxisResult("Y", "ok", "paper", None, None, 43e-6, (42e-6, 44e-6), steps, by_place=places)
    end = RunEnd(answer.run_id, "ok", at, capture=CaptureFile("map.parquet", "5" * 64))
    repository.finish_run(end, [AxisOutcome(value)])
    return answer.run_id


def run_products(repository: Repository, day: int, stiffness: float) -> int:
    """Store a check of Y that found a contact stiffness [N/(m kg)], a steady friction and a skew beside it."""
    at = NOON + timedelta(days=day)
    answer = repository.queue_run(RunOrder("on_demand", "Y", "Y", ("Y",), at))
    assert isinstance(answer, Queued)
    wobble = (-1) ** day
    products = (
        ByProduct("contact_stiffness", stiffness, 1e4, "N/(m kg)"),
        ByProduct("coulomb_friction", 1.0 + 0.01 * wobble, 0.02, "N/kg"),
        ByProduct("skew", 2e-6 * wobble, 1e-6, "s"),
    )
    value = AxisResult("Y", "ok", "model_fit", None, None, 43e-6, (42e-6, 44e-6), by_products=products)
    repository.finish_run(RunEnd(answer.run_id, "ok", at), [AxisOutcome(value)])
    return answer.run_id


def picture(run: RunRecord, axis: str, step: int) -> str | None:
    return SVG if (axis, step) == ("X1", 3) else None
