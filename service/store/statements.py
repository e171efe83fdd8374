"""What the repository's transactions are made of; every function works inside an open one."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from datetime import datetime
from typing import Any

from sqlalchemy import ColumnElement, Connection, Select, select

from service.backlash.results import AxisResult
from service.store import rows, tables
from service.store.errors import StoreError
from service.store.records import (
    AlreadyRun,
    AxisOutcome,
    AxisRecord,
    Busy,
    KeyReused,
    Queued,
    RunEnd,
    RunOrder,
    RunRecord,
)

UNFINISHED = ("queued", "running")


def declare(connection: Connection, axis: AxisRecord, position: int) -> None:
    values = {
        "group_name": axis.group,
        "position": position,
        "reference_m": axis.reference,
        "tolerance_m": axis.tolerance,
        "configured": True,
    }
    known = connection.execute(tables.axes.update().where(tables.axes.c.name == axis.name).values(values))
    if known.rowcount == 0:
        connection.execute(tables.axes.insert().values(name=axis.name, series=axis.series, **values))


def refusal(connection: Connection, order: RunOrder) -> Queued | Busy | KeyReused | AlreadyRun | None:
    """Say why a run cannot be put into the box, or that it already is there."""
    runs = tables.runs.c
    if order.idempotency_key is not None and (
        found := first(connection, runs.idempotency_key == order.idempotency_key)
    ):
        same = found["target"] == order.target
        return Queued(found["id"], replayed=True) if same else KeyReused(found["id"])
    if order.local_date is not None and (
        found := first(connection, runs.group_name == order.group, runs.local_date == order.local_date)
    ):
        return AlreadyRun(found["id"])
    if found := first(connection, runs.state.in_(UNFINISHED)):
        return Busy(found["id"])
    return None


def first(connection: Connection, *where: ColumnElement[bool]) -> Any | None:
    return connection.execute(select(tables.runs).where(*where).limit(1)).mappings().one_or_none()


def end_values(end: RunEnd) -> dict[str, Any]:
    return {
        "state": end.state,
        "finished_at_utc": end.finished_at,
        "reason": end.reason,
        "detail": end.detail,
        "remarks": list(end.remarks) or None,
        "capture_path": None if end.capture is None else end.capture.path,
        "capture_sha256": None if end.capture is None else end.capture.sha256,
    }


def set_run(connection: Connection, run_id: int, states: Iterable[str], values: Mapping[str, Any]) -> None:
    """Change a run that is in one of the given states; of a finished run only its values can be withdrawn."""
    changed = connection.execute(
        tables.runs.update().where(tables.runs.c.id == run_id, tables.runs.c.state.in_(states)).values(values)
    )
    if changed.rowcount != 1:
        raise StoreError(f"run {run_id} is not {' or '.join(states)}: it is unknown, or was ended before")


def add_outcomes(connection: Connection, run_id: int, at: datetime, outcomes: Sequence[AxisOutcome]) -> None:
    for outcome in outcomes:
        if outcome.reported:
            withdraw_report(connection, run_id, outcome)
        values = {"run_id": run_id, "measured_at_utc": at, **rows.outcome_values(outcome)}
        inserted = tables.backlash_values.insert().values(values).returning(tables.backlash_values.c.id)
        add_parts(connection, connection.execute(inserted).scalar_one(), outcome.result)


def add_parts(connection: Connection, value_id: int, result: AxisResult) -> None:
    """Write the steps, the map and the by-products of a value that was just added."""
    for step in result.steps:
        connection.execute(tables.steps.insert().values(rows.step_values(step, value_id)))
    for index, place in enumerate(result.by_place):
        connection.execute(tables.places.insert().values(rows.place_values(place, value_id, index)))
    for product in result.by_products:
        connection.execute(tables.by_products.insert().values(value_id=value_id, **vars(product)))


def withdraw_report(connection: Connection, run_id: int, outcome: AxisOutcome) -> None:
    values = tables.backlash_values.c
    same = (
        values.run_id == run_id, values.axis_name == outcome.result.axis, values.series == outcome.series
    )  # fmt: skip
    connection.execute(tables.backlash_values.update().where(*same).values(reported=False))


def runs(connection: Connection, query: Select[Any]) -> tuple[RunRecord, ...]:
    found = connection.execute(query).mappings().all()
    return tuple(rows.run_of(row, axes_of(connection, row["id"])) for row in found)


def axes_of(connection: Connection, run_id: int) -> tuple[str, ...]:
    moved = tables.run_axes.c
    query = select(moved.axis_name).where(moved.run_id == run_id).order_by(moved.position)
    return tuple(connection.execute(query).scalars())


def steps(connection: Connection, value_id: int) -> tuple[Any, ...]:
    query = (
        select(tables.steps).where(tables.steps.c.value_id == value_id).order_by(tables.steps.c.step_index)
    )
    return tuple(rows.step_of(row) for row in connection.execute(query).mappings())


def reported(axis: str, series: str | None = None) -> Select[Any]:
    """Select the reported values of an axis in a series, its current one where none is named."""
    values = tables.backlash_values.c
    current = select(tables.axes.c.series).where(tables.axes.c.name == axis).scalar_subquery()
    return select(tables.backlash_values).where(
        values.axis_name == axis, values.series == (current if series is None else series), values.reported
    )
