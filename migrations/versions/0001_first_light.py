"""The first tables: axes, runs, values, steps, alarms and model revisions."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0001"
down_revision = None
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Create all tables, those first that others refer to."""
    _axes()
    _runs()
    _alarms()
    _model_revisions()
    _run_axes()
    _alarm_events()
    _backlash_values()
    _steps()


def _axes() -> None:
    op.create_table(
        "axes",
        sa.Column("name", sa.String(length=64), nullable=False),
        sa.Column("group_name", sa.String(length=64), nullable=False),
        sa.Column("position", sa.Integer(), nullable=False),
        sa.Column("reference_m", sa.Float(), nullable=True),
        sa.Column("tolerance_m", sa.Float(), nullable=True),
        sa.Column("series", sa.String(length=64), nullable=False),
        sa.Column("configured", sa.Boolean(), nullable=False),
        sa.PrimaryKeyConstraint("name", name=op.f("pk_axes")),
    )


def _runs() -> None:
    op.create_table(
        "runs",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("kind", sa.String(length=16), nullable=False),
        sa.Column("state", sa.String(length=16), nullable=False),
        sa.Column("target", sa.String(length=64), nullable=False),
        sa.Column("group_name", sa.String(length=64), nullable=False),
        sa.Column("local_date", sa.Date(), nullable=True),
        sa.Column("requested_at_utc", sa.DateTime(), nullable=False),
        sa.Column("started_at_utc", sa.DateTime(), nullable=True),
        sa.Column("finished_at_utc", sa.DateTime(), nullable=True),
        sa.Column("reason", sa.String(length=64), nullable=True),
        sa.Column("detail", sa.Text(), nullable=True),
        sa.Column("capture_path", sa.Text(), nullable=True),
        sa.Column("capture_sha256", sa.String(length=64), nullable=True),
        sa.Column("idempotency_key", sa.String(length=255), nullable=True),
        sa.CheckConstraint(
            "(kind = 'nightly') = (local_date IS NOT NULL)", name=op.f("ck_runs_nightly_has_date")
        ),
        sa.CheckConstraint("kind IN ('on_demand', 'nightly')", name=op.f("ck_runs_kind")),
        sa.CheckConstraint(
            "state IN ('queued', 'running', 'ok', 'refused', 'failed')", name=op.f("ck_runs_state")
        ),
        sa.CheckConstraint(
            "state NOT IN ('refused', 'failed') OR reason IS NOT NULL", name=op.f("ck_runs_reason")
        ),
        sa.CheckConstraint("(capture_path IS NULL) = (capture_sha256 IS NULL)", name=op.f("ck_runs_capture")),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_runs")),
        sa.UniqueConstraint("group_name", "local_date", name=op.f("uq_runs_group_name_local_date")),
        sa.UniqueConstraint("idempotency_key", name=op.f("uq_runs_idempotency_key")),
        sqlite_autoincrement=True,
    )


def _alarms() -> None:
    op.create_table(
        "alarms",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("axis_name", sa.String(length=64), nullable=False),
        sa.Column("kind", sa.String(length=32), nullable=False),
        sa.Column("active", sa.Boolean(), nullable=False),
        sa.Column("acknowledged", sa.Boolean(), nullable=False),
        sa.Column("raised_at_utc", sa.DateTime(), nullable=False),
        sa.Column("cleared_at_utc", sa.DateTime(), nullable=True),
        sa.Column("acknowledged_at_utc", sa.DateTime(), nullable=True),
        sa.Column("acknowledged_by", sa.String(length=128), nullable=True),
        sa.Column("detail", sa.Text(), nullable=False),
        sa.ForeignKeyConstraint(["axis_name"], ["axes.name"], name=op.f("fk_alarms_axis_name")),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_alarms")),
        sqlite_autoincrement=True,
    )
    op.create_index(op.f("ix_alarms_axis_name_kind"), "alarms", ["axis_name", "kind"], unique=False)


def _model_revisions() -> None:
    op.create_table(
        "model_revisions",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("axis_name", sa.String(length=64), nullable=False),
        sa.Column("run_id", sa.Integer(), nullable=True),
        sa.Column("state", sa.String(length=16), nullable=False),
        sa.Column("finding", sa.JSON(), nullable=False),
        sa.Column("created_at_utc", sa.DateTime(), nullable=False),
        sa.Column("decided_at_utc", sa.DateTime(), nullable=True),
        sa.Column("decided_by", sa.String(length=128), nullable=True),
        sa.CheckConstraint(
            "state IN ('proposed', 'accepted', 'rejected')", name=op.f("ck_model_revisions_state")
        ),
        sa.ForeignKeyConstraint(["axis_name"], ["axes.name"], name=op.f("fk_model_revisions_axis_name")),
        sa.ForeignKeyConstraint(["run_id"], ["runs.id"], name=op.f("fk_model_revisions_run_id")),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_model_revisions")),
        sqlite_autoincrement=True,
    )
    op.create_index(op.f("ix_model_revisions_axis_name"), "model_revisions", ["axis_name"], unique=False)


def _run_axes() -> None:
    op.create_table(
        "run_axes",
        sa.Column("run_id", sa.Integer(), nullable=False),
        sa.Column("axis_name", sa.String(length=64), nullable=False),
        sa.Column("position", sa.Integer(), nullable=False),
        sa.ForeignKeyConstraint(["axis_name"], ["axes.name"], name=op.f("fk_run_axes_axis_name")),
        sa.ForeignKeyConstraint(["run_id"], ["runs.id"], name=op.f("fk_run_axes_run_id")),
        sa.PrimaryKeyConstraint("run_id", "axis_name", name=op.f("pk_run_axes")),
    )
    op.create_index(op.f("ix_run_axes_axis_name"), "run_axes", ["axis_name"], unique=False)


def _alarm_events() -> None:
    op.create_table(
        "alarm_events",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("alarm_id", sa.Integer(), nullable=False),
        sa.Column("run_id", sa.Integer(), nullable=True),
        sa.Column("event", sa.String(length=16), nullable=False),
        sa.Column("at_utc", sa.DateTime(), nullable=False),
        sa.Column("actor", sa.String(length=128), nullable=True),
        sa.Column("detail", sa.Text(), nullable=False),
        sa.CheckConstraint(
            "event IN ('raised', 'cleared', 'acknowledged')", name=op.f("ck_alarm_events_event")
        ),
        sa.ForeignKeyConstraint(["alarm_id"], ["alarms.id"], name=op.f("fk_alarm_events_alarm_id")),
        sa.ForeignKeyConstraint(["run_id"], ["runs.id"], name=op.f("fk_alarm_events_run_id")),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_alarm_events")),
        sqlite_autoincrement=True,
    )
    op.create_index(op.f("ix_alarm_events_alarm_id"), "alarm_events", ["alarm_id"], unique=False)


def _backlash_values() -> None:
    op.create_table(
        "backlash_values",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("run_id", sa.Integer(), nullable=False),
        sa.Column("axis_name", sa.String(length=64), nullable=False),
        sa.Column("method", sa.String(length=64), nullable=False),
        sa.Column("series", sa.String(length=64), nullable=False),
        sa.Column("reported", sa.Boolean(), nullable=False),
        sa.Column("model_revision_id", sa.Integer(), nullable=True),
        sa.Column("measured_at_utc", sa.DateTime(), nullable=False),
        sa.Column("verdict", sa.String(length=16), nullable=False),
        sa.Column("reason", sa.String(length=64), nullable=True),
        sa.Column("detail", sa.Text(), nullable=True),
        sa.Column("backlash_m", sa.Float(), nullable=True),
        sa.Column("interval_low_m", sa.Float(), nullable=True),
        sa.Column("interval_high_m", sa.Float(), nullable=True),
        sa.Column("trend_m", sa.Float(), nullable=True),
        sa.Column("trend_low_m", sa.Float(), nullable=True),
        sa.Column("trend_high_m", sa.Float(), nullable=True),
        sa.Column("trend_slope_m_per_s", sa.Float(), nullable=True),
        sa.Column("trend_slope_low_m_per_s", sa.Float(), nullable=True),
        sa.Column("trend_slope_high_m_per_s", sa.Float(), nullable=True),
        sa.Column("trend_count", sa.Integer(), nullable=True),
        sa.CheckConstraint(
            "(verdict = 'ok' AND backlash_m IS NOT NULL AND backlash_m BETWEEN 0 AND 0.1 AND reason IS "
            "NULL) OR (verdict = 'refused' "
            "AND reason IS NOT NULL AND backlash_m IS NULL AND interval_low_m IS NULL AND interval_high_m "
            "IS NULL AND trend_m IS NULL)",
            name=op.f("ck_backlash_values_verdict"),
        ),
        sa.ForeignKeyConstraint(["axis_name"], ["axes.name"], name=op.f("fk_backlash_values_axis_name")),
        sa.ForeignKeyConstraint(
            ["model_revision_id"], ["model_revisions.id"], name=op.f("fk_backlash_values_model_revision_id")
        ),
        sa.ForeignKeyConstraint(["run_id"], ["runs.id"], name=op.f("fk_backlash_values_run_id")),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_backlash_values")),
        sa.UniqueConstraint(
            "run_id",
            "axis_name",
            "method",
            "series",
            name=op.f("uq_backlash_values_run_id_axis_name_method_series"),
        ),
        sqlite_autoincrement=True,
    )
    op.create_index(
        op.f("ix_backlash_values_axis_name_series_reported_measured_at_utc"),
        "backlash_values",
        ["axis_name", "series", "reported", "measured_at_utc"],
        unique=False,
    )


def _steps() -> None:
    op.create_table(
        "steps",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("value_id", sa.Integer(), nullable=False),
        sa.Column("step_index", sa.Integer(), nullable=False),
        sa.Column("direction", sa.Integer(), nullable=False),
        sa.Column("verdict", sa.String(length=16), nullable=False),
        sa.Column("reason", sa.String(length=64), nullable=True),
        sa.Column("detail", sa.Text(), nullable=True),
        sa.Column("backlash_m", sa.Float(), nullable=True),
        sa.Column("t1_s", sa.Float(), nullable=True),
        sa.Column("t2_s", sa.Float(), nullable=True),
        sa.CheckConstraint(
            "(verdict = 'ok' AND backlash_m IS NOT NULL AND reason IS NULL) OR (verdict = 'refused' AND "
            "backlash_m IS NULL AND reason IS NOT NULL)",
            name=op.f("ck_steps_verdict"),
        ),
        sa.CheckConstraint("direction IN (-1, 1)", name=op.f("ck_steps_direction")),
        sa.ForeignKeyConstraint(["value_id"], ["backlash_values.id"], name=op.f("fk_steps_value_id")),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_steps")),
        sa.UniqueConstraint("value_id", "step_index", name=op.f("uq_steps_value_id_step_index")),
    )
