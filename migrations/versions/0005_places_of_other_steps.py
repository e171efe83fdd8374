"""Where along the rack the steps of a separating move are made."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0005"
down_revision = "0004"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Add a column."""
    op.add_column("runs", sa.Column("step_places_m", sa.JSON(none_as_null=True), nullable=True))
