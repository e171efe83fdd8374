"""The store's door to what is known of the axes' models: explanations and revisions, every change one transaction."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import datetime
from typing import Any

from sqlalchemy import Connection, Select, Table, select

from service.store import rows, tables
from service.store.database import Database
from service.store.errors import AlreadyDecidedError, UnknownRecordError
from service.store.model_records import (
    ExplanationEnd,
    ExplanationOrder,
    ExplanationRecord,
    RevisionRecord,
    RevisionState,
)
from service.store.records import DECLARED

UNFINISHED = ("queued", "running")


class ModelStore:
    """Explanations and model revisions of one database."""

    def __init__(self, database: Database) -> None:
        """Work on an open database, which stays the caller's to close."""
        self._database = database

    # explanations

    def order(self, order: ExplanationOrder) -> int:
        """Keep an explanation that waits; return its id."""
        inserted = (
            tables.explanations.insert()
            .values(rows.explanation_values(order))
            .returning(tables.explanations.c.id)
        )
        with self._database.writing() as connection:
            return int(connection.execute(inserted).scalar_one())

    def begin(self, explanation_id: int) -> None:
        """Note that an explanation is being computed."""
        with self._database.writing() as connection:
            connection.execute(_by_id(tables.explanations, explanation_id).values(state="running"))

    def finish(self, end: ExplanationEnd) -> None:
        """Keep how an explanation ended."""
        values = {
            "state": end.state,
            "finished_at_utc": end.finished_at,
            "detail": end.detail,
            "found": None if end.found is None else dict(end.found),
            "predictions_path": end.predictions_path,
        }
        with self._database.writing() as connection:
            connection.execute(_by_id(tables.explanations, end.id).values(values))

    def give_up_unfinished(self, at: datetime) -> int:
        """Skip what the end of the service before left waiting or half done; return how many."""
        explanations = tables.explanations
        skipped = {
            "state": "skipped",
            "finished_at_utc": at,
            "detail": "the service ended before this was done; ask for it again if it matters",
        }
        unfinished = explanations.update().where(explanations.c.state.in_(UNFINISHED)).values(skipped)
        with self._database.writing() as connection:
            return int(connection.execute(unfinished).rowcount)

    def explanation(self, explanation_id: int) -> ExplanationRecord:
        """Return an explanation; raise UnknownRecordError."""
        query = select(tables.explanations).where(tables.explanations.c.id == explanation_id)
        return rows.explanation_of(self._one(query, f"explanation {explanation_id}"))

    def explanations(
        self, *, run_id: int | None = None, axis: str | None = None, limit: int = 50
    ) -> tuple[ExplanationRecord, ...]:
        """Return the explanations of a run, of an axis' runs, or all: those of the newest runs first."""
        explanations = tables.explanations.c
        query = select(tables.explanations).order_by(explanations.run_id.desc(), explanations.id.desc())
        if run_id is not None:
            query = query.where(explanations.run_id == run_id)
        if axis is not None:
            moved = select(tables.run_axes.c.run_id).where(tables.run_axes.c.axis_name == axis)
            query = query.where(explanations.run_id.in_(moved))
        return tuple(rows.explanation_of(row) for row in self._all(query.limit(limit)))

    # revisions

    def propose(
        self,
        axis: str,
        finding: Mapping[str, Any],
        at: datetime,
        *,
        run_id: int | None = None,
        explanation_id: int | None = None,
    ) -> int:
        """Keep a finding as a proposed model revision of an axis; return its id."""
        values = {
            "axis_name": axis,
            "run_id": run_id,
            "explanation_id": explanation_id,
            "state": "proposed",
            "finding": dict(finding),
            "created_at_utc": at,
        }
        inserted = tables.model_revisions.insert().values(values).returning(tables.model_revisions.c.id)
        with self._database.writing() as connection:
            return int(connection.execute(inserted).scalar_one())

    def decide(
        self, revision_id: int, *, accept: bool, at: datetime, by: str, note: str | None = None
    ) -> RevisionRecord:
        """Accept or reject a proposed revision, once; an accepted one begins the axis' new series.

        Raises
        ------
        UnknownRecordError, AlreadyDecidedError
        """
        revisions = tables.model_revisions
        decision = {
            "state": "accepted" if accept else "rejected",
            "decided_at_utc": at,
            "decided_by": by,
            "note": note,
        }
        with self._database.writing() as connection:
            _require_proposed(connection, revision_id)
            changed = _by_id(revisions, revision_id).values(decision).returning(*revisions.c)
            decided = rows.revision_of(connection.execute(changed).mappings().one())
            if accept:
                axis = tables.axes.update().where(tables.axes.c.name == decided.axis)
                connection.execute(axis.values(series=decided.series))
            return decided

    def revision(self, revision_id: int) -> RevisionRecord:
        """Return a revision; raise UnknownRecordError."""
        query = select(tables.model_revisions).where(tables.model_revisions.c.id == revision_id)
        return rows.revision_of(self._one(query, f"model revision {revision_id}"))

    def revisions(
        self, axis: str | None = None, state: RevisionState | None = None
    ) -> tuple[RevisionRecord, ...]:
        """Return the model revisions, of one axis and state or of all, the newest first."""
        revisions = tables.model_revisions.c
        query = select(tables.model_revisions).order_by(revisions.id.desc())
        if axis is not None:
            query = query.where(revisions.axis_name == axis)
        if state is not None:
            query = query.where(revisions.state == state)
        return tuple(rows.revision_of(row) for row in self._all(query))

    def in_force(self, axis: str) -> RevisionRecord | None:
        """Return the accepted revision that an axis' current series is computed with; None when declared."""
        query = select(tables.axes.c.series).where(tables.axes.c.name == axis)
        series = self._one(query, f"axis {axis!r}")["series"]
        accepted = self.revisions(axis, "accepted") if series != DECLARED else ()
        return next((revision for revision in accepted if revision.series == series), None)

    def _all(self, query: Select[Any]) -> Sequence[Any]:
        with self._database.reading() as connection:
            return connection.execute(query).mappings().all()

    def _one(self, query: Select[Any], what: str) -> Any:
        found = self._all(query)
        if not found:
            raise UnknownRecordError(f"there is no {what}")
        return found[0]


def _by_id(table: Table, row_id: int) -> Any:
    return table.update().where(table.c.id == row_id)


def _require_proposed(connection: Connection, revision_id: int) -> None:
    query = select(tables.model_revisions).where(tables.model_revisions.c.id == revision_id)
    row = connection.execute(query).mappings().one_or_none()
    if row is None:
        raise UnknownRecordError(f"there is no model revision {revision_id}")
    if row["state"] != "proposed":
        raise AlreadyDecidedError(
            f"model revision {revision_id} of axis {row['axis_name']} was {row['state']} by {row['decided_by']} at "
            f"{row['decided_at_utc']:%Y-%m-%d %H:%M} UTC; a decision stands, and a new finding gets a new revision"
        )
