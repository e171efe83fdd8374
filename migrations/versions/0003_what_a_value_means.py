"""What a value means: where each step was made, the map along the rack, and the model's other parameters."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0003"
down_revision = "0002"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Add a column and two tables."""
    op.add_column("steps", sa.Column("position_m", sa.Float(), nullable=True))
    _places()
    _by_products()


def _places() -> None:
    op.create_table(
        "places",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("value_id", sa.Integer(), nullable=False),
        sa.Column("place_index", sa.Integer(), nullable=False),
        sa.Column("position_m", sa.Float(), nullable=False),
        sa.Column("verdict", sa.String(length=16), nullable=False),
        sa.Column("reason", sa.String(length=64), nullable=True),
        sa.Column("detail", sa.Text(), nullable=True),
        sa.Column("backlash_m", sa.Float(), nullable=True),
        sa.Column("interval_low_m", sa.Float(), nullable=True),
        sa.Column("interval_high_m", sa.Float(), nullable=True),
        sa.CheckConstraint(
            "(verdict = 'ok' AND backlash_m IS NOT NULL AND reason IS NULL) OR (verdict = 'refused' AND "
            "backlash_m IS NULL AND reason IS NOT NULL)",
            name=op.f("ck_places_verdict"),
        ),
        sa.ForeignKeyConstraint(["value_id"], ["backlash_values.id"], name=op.f("fk_places_value_id")),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_places")),
        sa.UniqueConstraint("value_id", "place_index", name=op.f("uq_places_value_id_place_index")),
    )


def _by_products() -> None:
    op.create_table(
        "by_products",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("value_id", sa.Integer(), nullable=False),
        sa.Column("name", sa.String(length=64), nullable=False),
        sa.Column("value", sa.Float(), nullable=False),
        sa.Column("std", sa.Float(), nullable=False),
        sa.Column("unit", sa.String(length=32), nullable=False),
        sa.ForeignKeyConstraint(["value_id"], ["backlash_values.id"], name=op.f("fk_by_products_value_id")),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_by_products")),
        sa.UniqueConstraint("value_id", "name", name=op.f("uq_by_products_value_id_name")),
    )
