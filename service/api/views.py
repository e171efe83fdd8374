"""Records of the store as what the API shows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from service.api.alarm_schemas import AlarmDetail, AlarmEventView, AlarmState, AlarmView
from service.api.by_products import by_product_view
from service.api.model_schemas import ComputingView
from service.api.model_views import model_check_view, revision_view, steps_view
from service.api.part_views import direction_view, place_view
from service.api.ports import NO_MASSES, Masses
from service.api.schemas import AxisView, ProgressView, RunDetail, RunView
from service.api.value_schemas import ResultView, StepView, TrendView, ValueView
from service.api.words import in_words
from service.backlash.results import PlaceValue, StepResult
from service.monitoring.repeatability import tolerance_hint
from service.monitoring.trend import Trend
from service.store.model_records import ExplanationRecord, RevisionRecord
from service.store.records import (
    AlarmEventRecord,
    AlarmRecord,
    AxisRecord,
    Progress,
    RunRecord,
    ValueRecord,
)

_DAY = 86_400.0


def trend_view(trend: Trend | None) -> TrendView | None:
    """Show a trend."""
    if trend is None:
        return None
    low_high = trend.slope_interval
    return TrendView(
        level_m=trend.level,
        interval_95_m=trend.interval,
        slope_m_per_day=None if trend.slope is None else trend.slope * _DAY,
        slope_interval_95_m_per_day=None if low_high is None else (low_high[0] * _DAY, low_high[1] * _DAY),
        count=trend.count,
    )


def value_view(value: ValueRecord) -> ValueView:
    """Show one answer."""
    outcome, result = value.outcome, value.outcome.result
    return ValueView(
        run_id=value.run_id,
        axis=result.axis,
        measured_at=value.measured_at,
        method=result.method,
        series=outcome.series,
        reported=outcome.reported,
        verdict=result.verdict,
        reason=result.reason,
        reason_in_words=in_words(result.reason),
        detail=result.detail,
        backlash_m=result.backlash,
        interval_95_m=result.interval_95,
        trend=trend_view(outcome.trend),
    )


def step_view(step: StepResult) -> StepView:
    """Show one step."""
    return StepView(
        index=step.index,
        direction=1 if step.direction > 0 else -1,
        verdict=step.verdict,
        reason=step.reason,
        reason_in_words=in_words(step.reason),
        detail=step.detail,
        backlash_m=step.backlash,
        t1_s=step.t1,
        t2_s=step.t2,
        position_m=step.position,
    )


def result_view(value: ValueRecord, masses: Mapping[str, Masses]) -> ResultView:
    """Show one answer with its steps and what else it says; ``masses`` are the moved ones, by axis."""
    result = value.outcome.result
    return ResultView(
        **dict(value_view(value)),
        steps=[step_view(step) for step in result.steps],
        by_direction=[direction_view(part) for part in result.by_direction],
        by_place=[place_view(part) for part in result.by_place],
        by_products=[
            by_product_view(product, masses.get(result.axis, NO_MASSES)) for product in result.by_products
        ],
    )


def alarm_view(alarm: AlarmRecord) -> AlarmView:
    """Show an alarm."""
    return AlarmView(
        id=alarm.id,
        axis=alarm.axis,
        kind=alarm.kind,
        active=alarm.state.active,
        acknowledged=alarm.state.acknowledged,
        raised_at=alarm.raised_at,
        cleared_at=alarm.cleared_at,
        acknowledged_at=alarm.acknowledged_at,
        acknowledged_by=alarm.acknowledged_by,
        detail=alarm.detail,
    )


def alarm_detail(alarm: AlarmRecord, events: Sequence[AlarmEventRecord]) -> AlarmDetail:
    """Show an alarm with its journal."""
    shown = [
        AlarmEventView(event=line.event, at=line.at, by=line.by, run_id=line.run_id, detail=line.detail)
        for line in events
    ]
    return AlarmDetail(**dict(alarm_view(alarm)), events=shown)


def alarm_state(alarms: Sequence[AlarmRecord]) -> AlarmState:
    """Name the most urgent state among an axis' alarms."""
    states = {(alarm.state.active, alarm.state.acknowledged) for alarm in alarms}
    if (True, False) in states:
        return "unacknowledged"
    if (False, False) in states:
        return "returned_unacknowledged"
    return "acknowledged" if (True, True) in states else "normal"


def axis_view(
    axis: AxisRecord,
    current: ValueRecord | None,
    latest: ValueRecord | None,
    alarms: Sequence[AlarmRecord],
    *,
    sigma: float | None = None,
    diagnostic_positions: Sequence[float] = (),
    by_place: Sequence[PlaceValue] = (),
    declared: ValueRecord | None = None,
    model_check: ExplanationRecord | None = None,
    revision: RevisionRecord | None = None,
    proposed: Sequence[RevisionRecord] = (),
) -> AxisView:
    """Show an axis as it stands."""
    return AxisView(
        name=axis.name,
        group=axis.group,
        reference_m=axis.reference,
        tolerance_m=axis.tolerance,
        repeatability_m=sigma,
        tolerance_hint=tolerance_hint(axis.tolerance, sigma),
        diagnostic_positions_m=list(diagnostic_positions),
        series=axis.series,
        current=None if current is None else value_view(current),
        by_place=[place_view(part) for part in by_place] if len(by_place) > 1 else [],
        latest=None if latest is None else value_view(latest),
        declared=None if declared is None else value_view(declared),
        model_check=None if model_check is None else model_check_view(model_check),
        revision=None if revision is None else revision_view(revision),
        proposed=[revision_view(one) for one in proposed],
        alarm_state=alarm_state(alarms),
        alarms=[alarm_view(alarm) for alarm in alarms],
    )


def run_view(run: RunRecord) -> RunView:
    """Show a run in short."""
    return RunView(
        id=run.id,
        kind=run.kind,
        state=run.state,
        target=run.target,
        group=run.group,
        axes=list(run.axes),
        local_date=run.local_date,
        requested_at=run.requested_at,
        started_at=run.started_at,
        finished_at=run.finished_at,
        reason=run.reason,
        reason_in_words=in_words(run.reason),
        detail=run.detail,
        other_steps=steps_view(run.steps),
        remarks=list(run.remarks),
        capture_sha256=None if run.capture is None else run.capture.sha256,
    )


def run_detail(
    run: RunRecord,
    found: Sequence[ValueRecord],
    checks: Sequence[ExplanationRecord],
    masses: Mapping[str, Masses],
) -> RunDetail:
    """Show a run with all that it found."""
    return RunDetail(
        **dict(run_view(run)),
        results=[result_view(value, masses) for value in found],
        model_checks=[model_check_view(one) for one in checks],
    )


def computing_view(progress: tuple[int, str] | None) -> ComputingView | None:
    """Show what is being computed."""
    return None if progress is None else ComputingView(run_id=progress[0], what=progress[1])


def progress_view(progress: Progress | None) -> ProgressView | None:
    """Show where the run in the box stands."""
    if progress is None:
        return None
    return ProgressView(
        run_id=progress.run_id,
        target=progress.target,
        phase=progress.phase,
        done=progress.done,
        total=progress.total,
    )
