"""Remember who was served

Revision: 0005, after 0004
"""

import sqlalchemy as sa
from alembic import op

revision = "0005"
down_revision = "0004"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.add_column("scan", sa.Column("served", sa.Integer(), server_default=sa.text("0"), nullable=False))
    op.add_column("scan", sa.Column("served_at", sa.Double(), nullable=True))


def downgrade() -> None:
    with op.batch_alter_table("scan") as batch_op:
        batch_op.drop_column("served_at")
        batch_op.drop_column("served")
