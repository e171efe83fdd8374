"""The tables. Column names carry units; a refused value can hold no number, by a check of the database
itself.

axes 1-n backlash_values n-1 runs; backlash_values 1-n steps, places and by_products
(whose unit stands beside); axes 1-n alarms 1-n alarm_events;
axes 1-n model_revisions n-1 explanations n-1 runs. A value belongs to a *method* (methods stand beside each
other, one per series is the *reported* one) and to a *series*: "declared" for the declared model, another name
for a history restated with an accepted model revision. Rows of values and of alarm events are never changed.
"""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Any

from sqlalchemy import (
    JSON,
    Boolean,
    CheckConstraint,
    Column,
    Date,
    DateTime,
    Dialect,
    Float,
    ForeignKey,
    Index,
    Integer,
    MetaData,
    String,
    Table,
    Text,
    TypeDecorator,
    UniqueConstraint,
)


class UtcDateTime(TypeDecorator[datetime]):
    """Aware datetimes in, aware UTC datetimes out; SQLite itself knows only naive ones."""

    impl = DateTime
    cache_ok = True

    def process_bind_param(self, value: datetime | None, dialect: Dialect) -> datetime | None:
        """Store UTC; refuse a naive time, whose zone nobody knows."""
        if value is None:
            return None
        if value.tzinfo is None:
            raise ValueError(f"a time without a zone cannot be stored: {value}")
        return value.astimezone(UTC).replace(tzinfo=None)

    def process_result_value(self, value: Any | None, dialect: Dialect) -> datetime | None:
        """Hand out UTC."""
        return None if value is None else value.replace(tzinfo=UTC)


metadata = MetaData(
    naming_convention={
        "ix": "ix_%(table_name)s_%(column_0_N_name)s",
        "uq": "uq_%(table_name)s_%(column_0_N_name)s",
        "ck": "ck_%(table_name)s_%(constraint_name)s",
        "fk": "fk_%(table_name)s_%(column_0_N_name)s",
        "pk": "pk_%(table_name)s",
    }
)

axes = Table(
    "axes",
    metadata,
    Column("name", String(64), primary_key=True),
    Column("group_name", String(64), nullable=False),
    Column("position", Integer, nullable=False),
    Column("reference_m", Float),
    Column("tolerance_m", Float),
    Column("series", String(64), nullable=False),
    Column("configured", Boolean, nullable=False),
)

runs = Table(
    "runs",
    metadata,
    Column("id", Integer, primary_key=True),
    Column("kind", String(16), nullable=False),
    Column("state", String(16), nullable=False),
    Column("target", String(64), nullable=False),
    Column("group_name", String(64), nullable=False),
    Column("local_date", Date),
    Column("requested_at_utc", UtcDateTime, nullable=False),
    Column("started_at_utc", UtcDateTime),
    Column("finished_at_utc", UtcDateTime),
    Column("reason", String(64)),
    Column("detail", Text),
    Column("remarks", JSON(none_as_null=True)),
    Column("capture_path", Text),
    Column("capture_sha256", String(64)),
    Column("idempotency_key", String(255)),
    Column("step_length_m", Float),
    Column("step_jerk_m_s3", Float),
    Column("step_direction", Integer),
    Column("step_places_m", JSON(none_as_null=True)),
    CheckConstraint("kind IN ('on_demand', 'nightly')", name="kind"),
    CheckConstraint("state IN ('queued', 'running', 'ok', 'refused', 'failed')", name="state"),
    CheckConstraint("(kind = 'nightly') = (local_date IS NOT NULL)", name="nightly_has_date"),
    CheckConstraint("state NOT IN ('refused', 'failed') OR reason IS NOT NULL", name="reason"),
    CheckConstraint("(capture_path IS NULL) = (capture_sha256 IS NULL)", name="capture"),
    UniqueConstraint("group_name", "local_date"),
    UniqueConstraint("idempotency_key"),
    sqlite_autoincrement=True,
)

run_axes = Table(
    "run_axes",
    metadata,
    Column("run_id", ForeignKey("runs.id"), primary_key=True),
    Column("axis_name", ForeignKey("axes.name"), primary_key=True),
    Column("position", Integer, nullable=False),
    Index(None, "axis_name"),
)

explanations = Table(
    "explanations",
    metadata,
    Column("id", Integer, primary_key=True),
    Column("run_id", ForeignKey("runs.id"), nullable=False),
    Column("train_run_ids", JSON, nullable=False),
    Column("kind", String(16), nullable=False),
    Column("state", String(16), nullable=False),
    Column("detail", Text),
    Column("found", JSON(none_as_null=True)),
    Column("predictions_path", Text),
    Column("requested_at_utc", UtcDateTime, nullable=False),
    Column("finished_at_utc", UtcDateTime),
    CheckConstraint("kind IN ('background', 'on_demand')", name="kind"),
    CheckConstraint(
        "state IN ('queued', 'running', 'done', 'cannot_tell', 'skipped', 'failed')", name="state"
    ),
    CheckConstraint("(state = 'done') = (found IS NOT NULL)", name="found"),
    CheckConstraint("state NOT IN ('cannot_tell', 'skipped', 'failed') OR detail IS NOT NULL", name="detail"),
    Index(None, "run_id"),
    sqlite_autoincrement=True,
)

model_revisions = Table(
    "model_revisions",
    metadata,
    Column("id", Integer, primary_key=True),
    Column("axis_name", ForeignKey("axes.name"), nullable=False),
    Column("run_id", ForeignKey("runs.id")),
    Column("state", String(16), nullable=False),
    Column("finding", JSON, nullable=False),
    Column("created_at_utc", UtcDateTime, nullable=False),
    Column("decided_at_utc", UtcDateTime),
    Column("decided_by", String(128)),
    Column("note", Text),
    Column("explanation_id", ForeignKey("explanations.id")),
    CheckConstraint("state IN ('proposed', 'accepted', 'rejected')", name="state"),
    Index(None, "axis_name"),
    sqlite_autoincrement=True,
)

backlash_values = Table(
    "backlash_values",
    metadata,
    Column("id", Integer, primary_key=True),
    Column("run_id", ForeignKey("runs.id"), nullable=False),
    Column("axis_name", ForeignKey("axes.name"), nullable=False),
    Column("method", String(64), nullable=False),
    Column("series", String(64), nullable=False),
    Column("reported", Boolean, nullable=False),
    Column("model_revision_id", ForeignKey("model_revisions.id")),
    Column("measured_at_utc", UtcDateTime, nullable=False),
    Column("verdict", String(16), nullable=False),
    Column("reason", String(64)),
    Column("detail", Text),
    Column("backlash_m", Float),
    Column("interval_low_m", Float),
    Column("interval_high_m", Float),
    Column("trend_m", Float),
    Column("trend_low_m", Float),
    Column("trend_high_m", Float),
    Column("trend_slope_m_per_s", Float),
    Column("trend_slope_low_m_per_s", Float),
    Column("trend_slope_high_m_per_s", Float),
    Column("trend_count", Integer),
    CheckConstraint(
        "(verdict = 'ok' AND backlash_m IS NOT NULL AND backlash_m BETWEEN 0 AND 0.1 AND reason IS NULL) OR "
        "(verdict = 'refused' AND "
        "reason IS NOT NULL"
        " AND backlash_m IS NULL AND interval_low_m IS NULL AND interval_high_m IS NULL AND trend_m IS NULL)",
        name="verdict",
    ),
    UniqueConstraint("run_id", "axis_name", "method", "series"),
    Index(None, "axis_name", "series", "reported", "measured_at_utc"),
    sqlite_autoincrement=True,
)

steps = Table(
    "steps",
    metadata,
    Column("id", Integer, primary_key=True),
    Column("value_id", ForeignKey("backlash_values.id"), nullable=False),
    Column("step_index", Integer, nullable=False),
    Column("direction", Integer, nullable=False),
    Column("verdict", String(16), nullable=False),
    Column("reason", String(64)),
    Column("detail", Text),
    Column("backlash_m", Float),
    Column("t1_s", Float),
    Column("t2_s", Float),
    Column("position_m", Float),
    CheckConstraint(
        "(verdict = 'ok' AND backlash_m IS NOT NULL AND reason IS NULL)"
        " OR (verdict = 'refused' AND backlash_m IS NULL AND reason IS NOT NULL)",
        name="verdict",
    ),
    CheckConstraint("direction IN (-1, 1)", name="direction"),
    UniqueConstraint("value_id", "step_index"),
)

places = Table(
    "places",
    metadata,
    Column("id", Integer, primary_key=True),
    Column("value_id", ForeignKey("backlash_values.id"), nullable=False),
    Column("place_index", Integer, nullable=False),
    Column("position_m", Float, nullable=False),
    Column("verdict", String(16), nullable=False),
    Column("reason", String(64)),
    Column("detail", Text),
    Column("backlash_m", Float),
    Column("interval_low_m", Float),
    Column("interval_high_m", Float),
    CheckConstraint(
        "(verdict = 'ok' AND backlash_m IS NOT NULL AND reason IS NULL)"
        " OR (verdict = 'refused' AND backlash_m IS NULL AND reason IS NOT NULL)",
        name="verdict",
    ),
    UniqueConstraint("value_id", "place_index"),
)

by_products = Table(
    "by_products",
    metadata,
    Column("id", Integer, primary_key=True),
    Column("value_id", ForeignKey("backlash_values.id"), nullable=False),
    Column("name", String(64), nullable=False),
    Column("value", Float, nullable=False),
    Column("std", Float, nullable=False),
    Column("unit", String(32), nullable=False),
    UniqueConstraint("value_id", "name"),
)

alarms = Table(
    "alarms",
    metadata,
    Column("id", Integer, primary_key=True),
    Column("axis_name", ForeignKey("axes.name"), nullable=False),
    Column("kind", String(32), nullable=False),
    Column("active", Boolean, nullable=False),
    Column("acknowledged", Boolean, nullable=False),
    Column("raised_at_utc", UtcDateTime, nullable=False),
    Column("cleared_at_utc", UtcDateTime),
    Column("acknowledged_at_utc", UtcDateTime),
    Column("acknowledged_by", String(128)),
    Column("detail", Text, nullable=False),
    Index(None, "axis_name", "kind"),
    sqlite_autoincrement=True,
)

alarm_events = Table(
    "alarm_events",
    metadata,
    Column("id", Integer, primary_key=True),
    Column("alarm_id", ForeignKey("alarms.id"), nullable=False),
    Column("run_id", ForeignKey("runs.id")),
    Column("event", String(16), nullable=False),
    Column("at_utc", UtcDateTime, nullable=False),
    Column("actor", String(128)),
    Column("detail", Text, nullable=False),
    CheckConstraint("event IN ('raised', 'cleared', 'acknowledged', 'remarked')", name="event"),
    Index(None, "alarm_id"),
    sqlite_autoincrement=True,
)
