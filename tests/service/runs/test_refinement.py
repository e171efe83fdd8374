"""The fit's answer takes the immediate value's place: a better value, or the refusal of a run that has none."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import pytest

from service.backlash.results import AxisResult, Reason
from service.runs.judging import judge_result
from service.runs.refinement import refine
from service.store.records import AxisOutcome, AxisRecord, CaptureFile, Queued, RunEnd, RunOrder, RunRecord
from tests.service.runs.bench import NOON, Bench, NoteReader

WHY = "the flanks changed sides in no step"


@dataclass
class Fits(NoteReader):
    """An analysis whose fit is known beforehand."""

    answers: Sequence[AxisResult] = ()

    def refined(self, path: Path, sha256: str) -> Sequence[AxisResult]:
        return self.answers


def plain(axis: str, b: float) -> AxisResult:
    return AxisResult(axis, "ok", "paper", None, None, b, (0.9 * b, 1.1 * b))


def fitted(axis: str, b: float) -> AxisResult:
    return AxisResult(axis, "ok", "model_fit", None, None, b, (b - 1e-7, b + 1e-7))


def refused(axis: str, reason: Reason) -> AxisResult:
    return AxisResult(axis, "refused", "model_fit", reason, WHY)


def measured(bench: Bench, immediate: Sequence[AxisResult], detail: str | None = None) -> int:
    """A run that ended ok with these immediate values."""
    repository, axes = bench.repository, tuple(one.axis for one in immediate)
    repository.declare_axes([AxisRecord(axis, axis, 57e-6, 10e-6) for axis in axes])
    answer = repository.queue_run(RunOrder("on_demand", axes[0], "all", axes, NOON))
    assert isinstance(answer, Queued)
    judged = [judge_result(repository, repository.axis(one.axis), one, NOON)[0] for one in immediate]
    end = RunEnd(answer.run_id, "ok", NOON, detail=detail, capture=CaptureFile("run.parquet", "5" * 64))
    repository.finish_run(end, judged)
    return answer.run_id


def refining(bench: Bench, run_id: int, *answers: AxisResult) -> RunRecord:
    """The run after the fit has answered."""
    refine(replace(bench.workshop, analysis=Fits(answers=answers)), run_id)
    return bench.repository.run(run_id)


def outcomes(bench: Bench, run_id: int) -> dict[tuple[str, str], AxisOutcome]:
    found = [value.outcome for value in bench.repository.outcomes(run_id)]
    return {(one.result.axis, one.result.method): one for one in found}


def test_a_better_value_takes_the_place_of_the_immediate_one(bench: Bench) -> None:
    run = measured(bench, [plain("Y", 55e-6)])
    assert refining(bench, run, fitted("Y", 57e-6)).state == "ok"
    assert bench.repository.history("Y", "model_fit").b == pytest.approx([57e-6])
    assert not outcomes(bench, run)["Y", "paper"].reported


@pytest.mark.parametrize("reason", [Reason.GAP_NOT_CROSSED, Reason.MISFIT, Reason.STEPS_DISAGREE])
def test_what_the_fit_refuses_for_the_run_itself_withdraws_the_immediate_value(
    bench: Bench, reason: Reason
) -> None:
    """Nothing is lost: the run tells which value it has shown, and that stands beside the refusal."""
    run = measured(bench, [plain("Y", 16e-6)])
    ended = refining(bench, run, refused("Y", reason))
    assert (ended.state, ended.reason) == ("refused", reason)
    assert ended.finished_at == NOON
    assert ended.detail is not None
    assert "Y: the immediate value of 16.0 µm is withdrawn" in ended.detail
    assert WHY in ended.detail
    found = outcomes(bench, run)
    assert found["Y", "model_fit"].reported
    assert not found["Y", "paper"].reported
    assert found["Y", "paper"].result.backlash == pytest.approx(16e-6)
    assert bench.repository.history("Y", "paper").b.size == 0


@pytest.mark.parametrize("reason", [Reason.INTERVAL_TOO_WIDE, Reason.TOO_FEW_STEPS])
def test_what_only_the_fit_cannot_do_leaves_the_immediate_value(bench: Bench, reason: Reason) -> None:
    run = measured(bench, [plain("Y", 55e-6)])
    ended = refining(bench, run, refused("Y", reason))
    assert (ended.state, ended.reason, ended.detail) == ("ok", None, None)
    assert bench.repository.history("Y", "paper").b == pytest.approx([55e-6])
    assert not outcomes(bench, run)["Y", "model_fit"].reported


def test_a_run_keeps_what_another_axis_says(bench: Bench) -> None:
    run = measured(bench, [plain("X1", 16e-6), plain("X2", 55e-6)], detail="a remark of its own")
    ended = refining(bench, run, refused("X1", Reason.GAP_NOT_CROSSED), fitted("X2", 57e-6))
    assert (ended.state, ended.reason) == ("ok", None)
    assert ended.detail is not None
    assert ended.detail.startswith("a remark of its own; X1: the immediate value of 16.0 µm is withdrawn")
    assert "X2" not in ended.detail
    assert bench.repository.history("X1", "paper").b.size == 0
    assert bench.repository.history("X2", "model_fit").b == pytest.approx([57e-6])


def test_a_withdrawn_value_raises_no_alarm_and_stands_in_no_trend(bench: Bench) -> None:
    for _ in range(6):
        run = measured(bench, [plain("Y", 90e-6)])
        assert refining(bench, run, refused("Y", Reason.GAP_NOT_CROSSED)).state == "refused"
    assert bench.repository.active_alarms("Y") == frozenset()
