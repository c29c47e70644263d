"""Keep the certificates of rigs

Revision: 0008, after 0007
"""

import sqlalchemy as sa
from alembic import op

revision = "0008"
down_revision = "0007"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.create_table(
        "rig_certificate",
        sa.Column("owner", sa.String(length=64), nullable=False),
        sa.Column("id", sa.String(length=64), nullable=False),
        sa.Column("rig", sa.String(length=64), nullable=False),
        sa.Column("document", sa.JSON(none_as_null=True), nullable=False),
        sa.Column("created_at", sa.Double(), nullable=False),
        sa.PrimaryKeyConstraint("owner", "id", name=op.f("pk_rig_certificate")),
    )
    op.create_index(
        "ix_rig_certificate_owner_rig_created_at", "rig_certificate", ["owner", "rig", "created_at"], unique=False
    )


def downgrade() -> None:
    op.drop_table("rig_certificate")
