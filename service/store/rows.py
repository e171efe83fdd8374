"""Rows to records and records to rows; nothing else knows the columns' names."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from sqlalchemy import RowMapping

from service.backlash.results import AxisResult, PlaceValue, Reason, StepResult
from service.monitoring.alarm import AlarmEvent, AlarmKind, AlarmState
from service.monitoring.trend import Trend
from service.store.model_records import ExplanationOrder, ExplanationRecord, RevisionRecord
from service.store.records import (
    AlarmEventRecord,
    AlarmRecord,
    AxisOutcome,
    AxisRecord,
    CaptureFile,
    RunOrder,
    RunRecord,
    StepParameters,
    ValueRecord,
)

Values = Mapping[str, Any]


def axis_of(row: RowMapping) -> AxisRecord:
    """Read an axis."""
    return AxisRecord(
        row["name"],
        row["group_name"],
        row["reference_m"],
        row["tolerance_m"],
        row["series"],
        row["configured"],
    )


def order_values(order: RunOrder) -> Values:
    """Write a run that waits."""
    return {
        "kind": order.kind,
        "state": "queued",
        "target": order.target,
        "group_name": order.group,
        "local_date": order.local_date,
        "requested_at_utc": order.requested_at,
        "idempotency_key": order.idempotency_key,
        **_step_parameters(order.steps),
    }


def _step_parameters(steps: StepParameters | None) -> Values:
    if steps is None:
        return {}
    return {
        "step_length_m": steps.length,
        "step_jerk_m_s3": steps.jerk,
        "step_direction": steps.direction,
        "step_places_m": list(steps.places) or None,
    }


def run_of(row: RowMapping, axes: tuple[str, ...]) -> RunRecord:
    """Read a run."""
    capture = CaptureFile(row["capture_path"], row["capture_sha256"]) if row["capture_path"] else None
    places = tuple(row["step_places_m"] or ())
    steps = StepParameters(row["step_length_m"], row["step_jerk_m_s3"], row["step_direction"], places)
    return RunRecord(
        id=row["id"],
        kind=row["kind"],
        state=row["state"],
        target=row["target"],
        group=row["group_name"],
        axes=axes,
        requested_at=row["requested_at_utc"],
        started_at=row["started_at_utc"],
        finished_at=row["finished_at_utc"],
        local_date=row["local_date"],
        reason=row["reason"],
        detail=row["detail"],
        capture=capture,
        idempotency_key=row["idempotency_key"],
        steps=None if row["step_length_m"] is None else steps,
        remarks=tuple(row["remarks"] or ()),
    )


def outcome_values(outcome: AxisOutcome) -> Values:
    """Write one method's answer."""
    result, trend = outcome.result, outcome.trend
    low, high = result.interval_95 or (None, None)
    return {
        "axis_name": result.axis,
        "method": result.method,
        "series": outcome.series,
        "reported": outcome.reported,
        "model_revision_id": outcome.model_revision,
        "verdict": result.verdict,
        "reason": result.reason,
        "detail": result.detail,
        "backlash_m": result.backlash,
        "interval_low_m": low,
        "interval_high_m": high,
        **_trend_values(trend),
    }


def _trend_values(trend: Trend | None) -> Values:
    if trend is None:
        return {}
    low, high = trend.interval or (None, None)
    slope_low, slope_high = trend.slope_interval or (None, None)
    return {
        "trend_m": trend.level,
        "trend_low_m": low,
        "trend_high_m": high,
        "trend_slope_m_per_s": trend.slope,
        "trend_slope_low_m_per_s": slope_low,
        "trend_slope_high_m_per_s": slope_high,
        "trend_count": trend.count,
    }


def value_of(row: RowMapping, steps: tuple[StepResult, ...] = ()) -> ValueRecord:
    """Read one method's answer."""
    result = AxisResult(
        axis=row["axis_name"],
        verdict=row["verdict"],
        method=row["method"],
        reason=_reason(row),
        detail=row["detail"],
        backlash=row["backlash_m"],
        interval_95=_pair(row["interval_low_m"], row["interval_high_m"]),
        steps=steps,
    )
    outcome = AxisOutcome(result, row["reported"], row["series"], _trend_of(row), row["model_revision_id"])
    return ValueRecord(row["id"], row["run_id"], row["measured_at_utc"], outcome)


def _trend_of(row: RowMapping) -> Trend | None:
    if row["trend_m"] is None:
        return None
    return Trend(
        level=row["trend_m"],
        interval=_pair(row["trend_low_m"], row["trend_high_m"]),
        slope=row["trend_slope_m_per_s"],
        slope_interval=_pair(row["trend_slope_low_m_per_s"], row["trend_slope_high_m_per_s"]),
        count=row["trend_count"],
    )


def step_values(step: StepResult, value_id: int) -> Values:
    """Write one step."""
    return {
        "value_id": value_id,
        "step_index": step.index,
        "direction": step.direction,
        "verdict": step.verdict,
        "reason": step.reason,
        "detail": step.detail,
        "backlash_m": step.backlash,
        "t1_s": step.t1,
        "t2_s": step.t2,
        "position_m": step.position,
    }


def place_values(place: PlaceValue, value_id: int, index: int) -> Values:
    """Write one point of the map along the rack."""
    low, high = place.interval_95 or (None, None)
    return {
        "value_id": value_id,
        "place_index": index,
        "position_m": place.position,
        "verdict": place.verdict,
        "reason": place.reason,
        "detail": place.detail,
        "backlash_m": place.backlash,
        "interval_low_m": low,
        "interval_high_m": high,
    }


def step_of(row: RowMapping) -> StepResult:
    """Read one step."""
    return StepResult(
        index=row["step_index"],
        direction=row["direction"],
        verdict=row["verdict"],
        reason=_reason(row),
        detail=row["detail"],
        backlash=row["backlash_m"],
        t1=row["t1_s"],
        t2=row["t2_s"],
        position=row["position_m"],
    )


def alarm_of(row: RowMapping) -> AlarmRecord:
    """Read an alarm."""
    return AlarmRecord(
        id=row["id"],
        axis=row["axis_name"],
        kind=AlarmKind(row["kind"]),
        state=AlarmState(row["active"], row["acknowledged"]),
        raised_at=row["raised_at_utc"],
        detail=row["detail"],
        cleared_at=row["cleared_at_utc"],
        acknowledged_at=row["acknowledged_at_utc"],
        acknowledged_by=row["acknowledged_by"],
    )


def alarm_event_of(row: RowMapping) -> AlarmEventRecord:
    """Read a line of an alarm's journal."""
    return AlarmEventRecord(
        AlarmEvent(row["event"]), row["at_utc"], row["detail"], row["actor"], row["run_id"]
    )


def explanation_values(order: ExplanationOrder) -> Values:
    """Write an explanation that waits."""
    return {
        "run_id": order.run_id,
        "train_run_ids": list(order.train_run_ids),
        "kind": order.kind,
        "state": "queued",
        "requested_at_utc": order.requested_at,
    }


def explanation_of(row: RowMapping) -> ExplanationRecord:
    """Read an explanation."""
    return ExplanationRecord(
        id=row["id"],
        run_id=row["run_id"],
        train_run_ids=tuple(row["train_run_ids"]),
        kind=row["kind"],
        state=row["state"],
        requested_at=row["requested_at_utc"],
        finished_at=row["finished_at_utc"],
        detail=row["detail"],
        found=row["found"],
        predictions_path=row["predictions_path"],
    )


def revision_of(row: RowMapping) -> RevisionRecord:
    """Read a model revision."""
    return RevisionRecord(
        id=row["id"],
        axis=row["axis_name"],
        state=row["state"],
        finding=row["finding"],
        created_at=row["created_at_utc"],
        run_id=row["run_id"],
        decided_at=row["decided_at_utc"],
        decided_by=row["decided_by"],
        note=row["note"],
        explanation_id=row["explanation_id"],
    )


def _reason(row: RowMapping) -> Reason | None:
    return Reason(row["reason"]) if row["reason"] is not None else None


def _pair(low: float | None, high: float | None) -> tuple[float, float] | None:
    return None if low is None or high is None else (low, high)
