"""Count what ends

Revision: 0003, after 0002
"""

import sqlalchemy as sa
from alembic import op

revision = "0003"
down_revision = "0002"
branch_labels = None
depends_on = None

LIVE_SCAN = sa.text("state IN ('uploading', 'queued', 'running', 'paused', 'canceling')")


def upgrade() -> None:
    op.create_table(
        "meter",
        sa.Column("name", sa.String(length=64), nullable=False),
        sa.Column("labels", sa.String(length=255), nullable=False),
        sa.Column("value", sa.Double(), nullable=False),
        sa.PrimaryKeyConstraint("name", "labels", name=op.f("pk_meter")),
    )
    op.add_column("step", sa.Column("ready_at", sa.Double(), nullable=True))
    op.add_column("attempt", sa.Column("counted", sa.Boolean(), server_default=sa.false(), nullable=False))
    op.create_index(
        "ix_attempt_uncounted",
        "attempt",
        ["ended_at"],
        sqlite_where=sa.text("counted = 0"),
        postgresql_where=sa.text("NOT counted"),
    )
    op.create_index("ix_scan_live", "scan", ["state"], sqlite_where=LIVE_SCAN, postgresql_where=LIVE_SCAN)


def downgrade() -> None:
    op.drop_index("ix_scan_live", table_name="scan")
    op.drop_index("ix_attempt_uncounted", table_name="attempt")
    with op.batch_alter_table("attempt") as batch_op:
        batch_op.drop_column("counted")
    with op.batch_alter_table("step") as batch_op:
        batch_op.drop_column("ready_at")
    op.drop_table("meter")
