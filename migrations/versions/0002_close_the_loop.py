"""What the model lacks: explanations of runs, notes on revisions, remarks on alarms, runs of other steps."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0002"
down_revision = "0001"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Add a table and columns; rebuild the alarms' journal, whose check gains the remark."""
    _explanations()
    _revisions()
    _runs()
    _alarm_events()


def _explanations() -> None:
    op.create_table(
        "explanations",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("run_id", sa.Integer(), nullable=False),
        sa.Column("train_run_ids", sa.JSON(), nullable=False),
        sa.Column("kind", sa.String(length=16), nullable=False),
        sa.Column("state", sa.String(length=16), nullable=False),
        sa.Column("detail", sa.Text(), nullable=True),
        sa.Column("found", sa.JSON(none_as_null=True), nullable=True),
        sa.Column("predictions_path", sa.Text(), nullable=True),
        sa.Column("requested_at_utc", sa.DateTime(), nullable=False),
        sa.Column("finished_at_utc", sa.DateTime(), nullable=True),
        sa.CheckConstraint("kind IN ('background', 'on_demand')", name=op.f("ck_explanations_kind")),
        sa.CheckConstraint(
            "state IN ('queued', 'running', 'done', 'cannot_tell', 'skipped', 'failed')",
            name=op.f("ck_explanations_state"),
        ),
        sa.CheckConstraint("(state = 'done') = (found IS NOT NULL)", name=op.f("ck_explanations_found")),
        sa.CheckConstraint(
            "state NOT IN ('cannot_tell', 'skipped', 'failed') OR detail IS NOT NULL",
            name=op.f("ck_explanations_detail"),
        ),
        sa.ForeignKeyConstraint(["run_id"], ["runs.id"], name=op.f("fk_explanations_run_id")),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_explanations")),
        sqlite_autoincrement=True,
    )
    op.create_index(op.f("ix_explanations_run_id"), "explanations", ["run_id"], unique=False)


def _revisions() -> None:
    op.add_column("model_revisions", sa.Column("note", sa.Text(), nullable=True))
    # Alembic adds no foreign key to a table of SQLite, though SQLite itself does
    op.execute(
        "ALTER TABLE model_revisions ADD COLUMN explanation_id INTEGER "
        "CONSTRAINT fk_model_revisions_explanation_id REFERENCES explanations (id)"
    )


def _runs() -> None:
    op.add_column("runs", sa.Column("step_length_m", sa.Float(), nullable=True))
    op.add_column("runs", sa.Column("step_jerk_m_s3", sa.Float(), nullable=True))
    op.add_column("runs", sa.Column("step_direction", sa.Integer(), nullable=True))


def _alarm_events() -> None:
    with op.batch_alter_table(
        "alarm_events", recreate="always", table_kwargs={"sqlite_autoincrement": True}
    ) as batch:
        batch.create_check_constraint(
            op.f("ck_alarm_events_event"), "event IN ('raised', 'cleared', 'acknowledged', 'remarked')"
        )
