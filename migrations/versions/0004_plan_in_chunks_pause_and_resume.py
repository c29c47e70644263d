"""Plan in chunks, pause, resume, and one training per GPU

Revision: 0004, after 0003
"""

import sqlalchemy as sa
from alembic import op

revision = "0004"
down_revision = "0003"
branch_labels = None
depends_on = None

UNPLANTED = sa.text("unplanted_from IS NOT NULL")
PAUSED = sa.text("paused_for IS NOT NULL")


def upgrade() -> None:
    op.create_table(
        "resource_slot",
        sa.Column("host", sa.String(length=255), nullable=False),
        sa.Column("name", sa.String(length=32), nullable=False),
        sa.Column("step_id", sa.String(length=36), nullable=True),
        sa.Column("token", sa.Integer(), nullable=False),
        sa.PrimaryKeyConstraint("host", "name", name=op.f("pk_resource_slot")),
    )
    op.create_table(
        "chore",
        sa.Column("name", sa.String(length=32), nullable=False),
        sa.Column("begun_at", sa.Double(), nullable=False),
        sa.PrimaryKeyConstraint("name", name=op.f("pk_chore")),
    )
    op.add_column("scan", sa.Column("unplanted_from", sa.Integer(), nullable=True))
    op.add_column("scan", sa.Column("paused_for", sa.String(length=32), nullable=True))
    op.create_index(
        "ix_scan_unplanted_from", "scan", ["unplanted_from"], sqlite_where=UNPLANTED, postgresql_where=UNPLANTED
    )
    op.create_index("ix_scan_paused_for", "scan", ["paused_for"], sqlite_where=PAUSED, postgresql_where=PAUSED)
    op.add_column("step", sa.Column("resume_digest", sa.String(length=64), nullable=True))
    op.execute("UPDATE step SET queue = 'train-cpu' WHERE queue = 'train'")


def downgrade() -> None:
    op.execute("UPDATE step SET queue = 'train' WHERE queue IN ('train-cpu', 'train-gpu')")
    with op.batch_alter_table("step") as batch_op:
        batch_op.drop_column("resume_digest")
    op.drop_index("ix_scan_paused_for", table_name="scan")
    op.drop_index("ix_scan_unplanted_from", table_name="scan")
    with op.batch_alter_table("scan") as batch_op:
        batch_op.drop_column("paused_for")
        batch_op.drop_column("unplanted_from")
    op.drop_table("chore")
    op.drop_table("resource_slot")
