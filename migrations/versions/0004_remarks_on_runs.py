"""What was noticed in a run beside its result: warnings of drives and sensors that ended nothing."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0004"
down_revision = "0003"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Add a column."""
    op.add_column("runs", sa.Column("remarks", sa.JSON(none_as_null=True), nullable=True))
