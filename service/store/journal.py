"""Alarms inside an open transaction: their state, and the journal of what happened to them."""

from __future__ import annotations

from datetime import datetime
from typing import Any

from sqlalchemy import Connection, or_, select

from service.monitoring.alarm import AlarmEvent, AlarmKind, AlarmState, transition
from service.store import rows, tables
from service.store.records import AlarmChange, AlarmRecord

_TIME_OF = {
    AlarmEvent.RAISED: "raised_at_utc",
    AlarmEvent.CLEARED: "cleared_at_utc",
    AlarmEvent.ACKNOWLEDGED: "acknowledged_at_utc",
}


def apply_change(connection: Connection, change: AlarmChange, at: datetime, run_id: int | None) -> None:
    """Raise or clear an alarm; a decision that says nothing new writes nothing."""
    found = retained(connection, change.axis, change.change.kind)
    state = found.state if found else AlarmState()
    after = transition(state, change.change.event)
    if after == state:
        return
    alarm_id = found.id if found else _insert(connection, change, at)
    _record(connection, alarm_id, change.change.event, at, change.change.detail, run_id=run_id, state=after)


def acknowledge(connection: Connection, alarm: AlarmRecord, at: datetime, by: str, comment: str) -> None:
    """Acknowledge an alarm; a second acknowledgement writes nothing."""
    after = transition(alarm.state, AlarmEvent.ACKNOWLEDGED)
    if after != alarm.state:
        _record(connection, alarm.id, AlarmEvent.ACKNOWLEDGED, at, comment, by=by, state=after)


def remark(connection: Connection, alarm: AlarmRecord, at: datetime, by: str | None, text: str) -> None:
    """Leave a line in an alarm's journal, which changes nothing else."""
    _line(connection, alarm.id, AlarmEvent.REMARKED, at, text, by=by)


def retained(connection: Connection, axis: str, kind: AlarmKind) -> AlarmRecord | None:
    """Return the axis' alarm of a kind that is still to be shown; there is at most one."""
    alarms = tables.alarms.c
    open_alarm = select(tables.alarms).where(
        alarms.axis_name == axis, alarms.kind == kind, or_(alarms.active, ~alarms.acknowledged)
    )
    row = connection.execute(open_alarm).mappings().one_or_none()
    return rows.alarm_of(row) if row else None


def _insert(connection: Connection, change: AlarmChange, at: datetime) -> int:
    values = {
        "axis_name": change.axis,
        "kind": change.change.kind,
        "active": False,
        "acknowledged": True,
        "raised_at_utc": at,
        "detail": change.change.detail,
    }
    inserted = tables.alarms.insert().values(values).returning(tables.alarms.c.id)
    return int(connection.execute(inserted).scalar_one())


def _record(
    connection: Connection,
    alarm_id: int,
    event: AlarmEvent,
    at: datetime,
    detail: str,
    *,
    state: AlarmState,
    by: str | None = None,
    run_id: int | None = None,
) -> None:
    """Add the journal's line and bring the alarm's row to its new state."""
    _line(connection, alarm_id, event, at, detail, by=by, run_id=run_id)
    values: dict[str, Any] = {"active": state.active, "acknowledged": state.acknowledged, _TIME_OF[event]: at}
    if event is AlarmEvent.ACKNOWLEDGED:
        values["acknowledged_by"] = by
    if event is AlarmEvent.RAISED:
        values |= {
            "detail": detail,
            "cleared_at_utc": None,
            "acknowledged_at_utc": None,
            "acknowledged_by": None,
        }
    connection.execute(tables.alarms.update().where(tables.alarms.c.id == alarm_id).values(values))


def _line(
    connection: Connection,
    alarm_id: int,
    event: AlarmEvent,
    at: datetime,
    detail: str,
    *,
    by: str | None = None,
    run_id: int | None = None,
) -> None:
    values = {"alarm_id": alarm_id, "run_id": run_id, "event": event, "at_utc": at}
    connection.execute(tables.alarm_events.insert().values(values | {"actor": by, "detail": detail}))
