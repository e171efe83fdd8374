"""The store's one door: dataclasses in, dataclasses out, every change one transaction."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, date, datetime
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from sqlalchemy import Select, func, or_, select, tuple_

from service.monitoring.alarm import AlarmKind
from service.store import journal, parts, rows, statements, tables
from service.store.database import Database
from service.store.errors import UnknownRecordError
from service.store.models import ModelStore
from service.store.records import (
    AlarmChange,
    AlarmEventRecord,
    AlarmRecord,
    AxisOutcome,
    AxisRecord,
    History,
    QueueAnswer,
    Queued,
    RunEnd,
    RunOrder,
    RunRecord,
    ValueRecord,
    Withdrawal,
)

T = TypeVar("T")


class Repository:
    """Axes, runs, values and alarms of one database; ``models`` holds what is known of the axes' models,
    ``parts`` what was found beside the backlash."""

    def __init__(self, database: Database) -> None:
        """Work on an open database, which stays the caller's to close."""
        self._database = database
        self.models = ModelStore(database)
        self.parts = parts.PartStore(database)

    # axes

    def declare_axes(self, axes: Sequence[AxisRecord]) -> None:
        """Take over the configuration's axes in its order; one that it no longer names keeps its history.

        The series stays what the store holds: it follows accepted model revisions, not the configuration.
        """
        with self._database.writing() as connection:
            connection.execute(tables.axes.update().values(configured=False))
            for position, axis in enumerate(axes):
                statements.declare(connection, axis, position)

    def axes(self) -> tuple[AxisRecord, ...]:
        """Return the configured axes in the configuration's order."""
        query = select(tables.axes).where(tables.axes.c.configured).order_by(tables.axes.c.position)
        return tuple(rows.axis_of(row) for row in self._all(query))

    def axis(self, name: str) -> AxisRecord:
        """Return an axis, configured or not; raise UnknownRecordError."""
        return rows.axis_of(
            self._one(select(tables.axes).where(tables.axes.c.name == name), f"axis {name!r}")
        )

    # runs

    def queue_run(self, order: RunOrder) -> QueueAnswer:
        """Put a run into the box of one, or say why not."""
        with self._database.writing() as connection:
            if refusal := statements.refusal(connection, order):
                return refusal
            inserted = tables.runs.insert().values(rows.order_values(order)).returning(tables.runs.c.id)
            run_id = connection.execute(inserted).scalar_one()
            for position, axis in enumerate(order.axes):
                moved = {"run_id": run_id, "axis_name": axis, "position": position}
                connection.execute(tables.run_axes.insert().values(moved))
            return Queued(run_id)

    def start_run(self, run_id: int, at: datetime) -> None:
        """Note that a queued run moves now."""
        with self._database.writing() as connection:
            statements.set_run(connection, run_id, ("queued",), {"state": "running", "started_at_utc": at})

    def finish_run(
        self, end: RunEnd, outcomes: Sequence[AxisOutcome] = (), alarms: Sequence[AlarmChange] = ()
    ) -> None:
        """End a run with all that it found, in one transaction: values, steps, trends and alarms."""
        with self._database.writing() as connection:
            statements.set_run(connection, end.run_id, statements.UNFINISHED, statements.end_values(end))
            statements.add_outcomes(connection, end.run_id, end.finished_at, outcomes)
            for change in alarms:
                journal.apply_change(connection, change, end.finished_at, end.run_id)

    def add_outcomes(
        self, run_id: int, outcomes: Sequence[AxisOutcome], withdrawal: Withdrawal | None = None
    ) -> None:
        """Add answers to a finished run: a refined method's, or a series restated with a model revision.

        A reported answer takes that mark over from the one of the same axis and series, which stays beside
        it. With a ``withdrawal`` the run, which must have ended ok, ends as that says.
        """
        with self._database.writing() as connection:
            run = (
                connection.execute(select(tables.runs).where(tables.runs.c.id == run_id))
                .mappings()
                .one_or_none()
            )
            if run is None:
                raise UnknownRecordError(f"there is no run {run_id}")
            statements.add_outcomes(connection, run_id, run["finished_at_utc"], outcomes)
            if withdrawal is not None:
                statements.set_run(connection, run_id, ("ok",), vars(withdrawal))

    def fail_interrupted(self, at: datetime) -> tuple[int, ...]:
        """Fail the runs that a killed process left unfinished, once at the start; return their ids."""
        ended = {
            "state": "failed",
            "finished_at_utc": at,
            "reason": "interrupted",
            "detail": "the service ended while this run was waiting or moving: a power cut, a crash or a "
            "restart. "
            "The drives stop by themselves when the heartbeat is lost. Start the check again",
        }
        unfinished = tables.runs.update().where(tables.runs.c.state.in_(statements.UNFINISHED)).values(ended)
        with self._database.writing() as connection:
            return tuple(connection.execute(unfinished.returning(tables.runs.c.id)).scalars())

    def run(self, run_id: int) -> RunRecord:
        """Return a run; raise UnknownRecordError."""
        query = select(tables.runs).where(tables.runs.c.id == run_id)
        with self._database.reading() as connection:
            return _one_of(statements.runs(connection, query), f"run {run_id}")

    def runs(
        self, *, limit: int = 50, before: int | None = None, axis: str | None = None
    ) -> tuple[RunRecord, ...]:
        """Return runs, the newest first: those below the id ``before``, those that moved ``axis``."""
        query = select(tables.runs).order_by(tables.runs.c.id.desc()).limit(limit)
        if before is not None:
            query = query.where(tables.runs.c.id < before)
        if axis is not None:
            moved = select(tables.run_axes.c.run_id).where(tables.run_axes.c.axis_name == axis)
            query = query.where(tables.runs.c.id.in_(moved))
        with self._database.reading() as connection:
            return statements.runs(connection, query)

    def unfinished_run(self) -> RunRecord | None:
        """Return the run that is waiting or moving, if any."""
        query = select(tables.runs).where(tables.runs.c.state.in_(statements.UNFINISHED))
        with self._database.reading() as connection:
            return next(iter(statements.runs(connection, query)), None)

    def run_counts(self) -> dict[str, int]:
        """Count the runs by state."""
        query = select(tables.runs.c.state, func.count().label("runs")).group_by(tables.runs.c.state)
        return {row["state"]: row["runs"] for row in self._all(query)}

    def nightly_runs(self, group: str, since: date) -> dict[date, RunRecord]:
        """Return a group's nightly runs by local date, from ``since`` on."""
        runs = tables.runs.c
        query = select(tables.runs).where(runs.group_name == group, runs.local_date >= since)
        with self._database.reading() as connection:
            return {
                run.local_date: run
                for run in statements.runs(connection, query)
                if run.local_date is not None
            }

    # values

    def outcomes(self, run_id: int) -> tuple[ValueRecord, ...]:
        """Return all that a run found, with its steps, in the order of its axes."""
        values = tables.backlash_values
        query = select(values).where(values.c.run_id == run_id).order_by(values.c.id)
        with self._database.reading() as connection:
            found = connection.execute(query).mappings().all()
            return tuple(parts.whole(connection, rows.value_of(row)) for row in found)

    def values(
        self,
        axis: str,
        *,
        limit: int = 100,
        before: tuple[datetime, int] | None = None,
        accepted: bool = False,
        series: str | None = None,
    ) -> tuple[ValueRecord, ...]:
        """Return an axis' reported values of a series without steps, the newest first.

        Without ``series`` the one that is the axis' current.

        ``before`` continues below the (measured_at, id) of the last value seen; ``accepted`` leaves refusals
        out.
        """
        values = tables.backlash_values.c
        query = (
            statements.reported(axis, series)
            .order_by(values.measured_at_utc.desc(), values.id.desc())
            .limit(limit)
        )
        if before is not None:
            query = query.where(tuple_(values.measured_at_utc, values.id) < tuple_(*before))
        if accepted:
            query = query.where(values.verdict == "ok")
        return tuple(rows.value_of(row) for row in self._all(query))

    def history(
        self, axis: str, method: str | None = None, limit: int = 400, series: str | None = None
    ) -> History:
        """Return the latest accepted, reported values of an axis' series as arrays, oldest first.

        They are of one method, by default that of the newest: methods differ by more than an axis wears in
        a year.
        """
        latest = self.values(axis, limit=limit, accepted=True, series=series)
        one = method or (latest[0].outcome.result.method if latest else None)
        found = [v for v in reversed(latest) if v.outcome.result.method == one]
        t = np.array([v.measured_at.timestamp() for v in found], dtype=np.float64)
        return History(t, np.array([v.outcome.result.backlash for v in found], dtype=np.float64))

    # alarms

    def change_alarms(self, changes: Sequence[AlarmChange], at: datetime) -> None:
        """Apply decisions that belong to no run, such as a missing one."""
        with self._database.writing() as connection:
            for change in changes:
                journal.apply_change(connection, change, at, None)

    def active_alarms(self, axis: str) -> frozenset[AlarmKind]:
        """Return the kinds of an axis' active alarms: what ``monitoring.judge`` needs."""
        return frozenset(a.kind for a in self.alarms(axis=axis) if a.state.active)

    def alarms(
        self, *, axis: str | None = None, all_ever: bool = False, limit: int = 200
    ) -> tuple[AlarmRecord, ...]:
        """Return the alarms that are still to be shown, or all there ever were, the newest first."""
        alarms = tables.alarms.c
        query = select(tables.alarms).order_by(alarms.id.desc()).limit(limit)
        if not all_ever:
            query = query.where(or_(alarms.active, ~alarms.acknowledged))
        if axis is not None:
            query = query.where(alarms.axis_name == axis)
        return tuple(rows.alarm_of(row) for row in self._all(query))

    def alarm(self, alarm_id: int) -> AlarmRecord:
        """Return an alarm; raise UnknownRecordError."""
        query = select(tables.alarms).where(tables.alarms.c.id == alarm_id)
        return rows.alarm_of(self._one(query, f"alarm {alarm_id}"))

    def alarm_events(self, alarm_id: int) -> tuple[AlarmEventRecord, ...]:
        """Return an alarm's journal, oldest first."""
        events = tables.alarm_events
        query = select(events).where(events.c.alarm_id == alarm_id).order_by(events.c.id)
        return tuple(rows.alarm_event_of(row) for row in self._all(query))

    def acknowledge(self, alarm_id: int, at: datetime, by: str, comment: str = "") -> AlarmRecord:
        """Acknowledge an alarm and return it; acknowledging again changes nothing."""
        with self._database.writing() as connection:
            query = select(tables.alarms).where(tables.alarms.c.id == alarm_id)
            row = connection.execute(query).mappings().one_or_none()
            if row is None:
                raise UnknownRecordError(f"there is no alarm {alarm_id}")
            journal.acknowledge(connection, rows.alarm_of(row), at, by, comment)
        return self.alarm(alarm_id)

    def remark_alarms(self, axis: str, at: datetime, text: str, by: str | None = None) -> int:
        """Leave a line in the journal of every alarm of an axis that is still to be shown; return how many."""
        found = self.alarms(axis=axis)
        with self._database.writing() as connection:
            for alarm in found:
                journal.remark(connection, alarm, at, by, text)
        return len(found)

    # upkeep

    def backup(self, folder: Path, at: datetime) -> Path:
        """Write a verified backup of the live store and return its path."""
        return self._database.backup(folder, at.astimezone(UTC))

    def _all(self, query: Select[Any]) -> Sequence[Any]:
        with self._database.reading() as connection:
            return connection.execute(query).mappings().all()

    def _one(self, query: Select[Any], what: str) -> Any:
        return _one_of(self._all(query), what)


def _one_of(found: Sequence[T], what: str) -> T:
    if not found:
        raise UnknownRecordError(f"there is no {what}")
    return found[0]
