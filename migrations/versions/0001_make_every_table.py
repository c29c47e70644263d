"""Make every table

Revision: 0001, after
"""

import sqlalchemy as sa
from alembic import op

revision = "0001"
down_revision = None
branch_labels = None
depends_on = None


def upgrade() -> None:

    op.create_table(
        "artifact",
        sa.Column("digest", sa.String(length=64), nullable=False),
        sa.Column("size", sa.BigInteger(), nullable=False),
        sa.Column("media_type", sa.String(length=127), nullable=False),
        sa.Column("state", sa.String(length=32), nullable=False),
        sa.Column("created_at", sa.Double(), nullable=False),
        sa.PrimaryKeyConstraint("digest", name=op.f("pk_artifact")),
    )
    op.create_table(
        "scan",
        sa.Column("id", sa.String(length=36), nullable=False),
        sa.Column("owner", sa.String(length=64), nullable=False),
        sa.Column("root_id", sa.String(length=36), nullable=False),
        sa.Column("name", sa.String(length=64), nullable=False),
        sa.Column("source_kind", sa.String(length=32), nullable=False),
        sa.Column("spec", sa.JSON(none_as_null=True), nullable=False),
        sa.Column("spec_digest", sa.String(length=64), nullable=False),
        sa.Column("plant", sa.String(length=64), nullable=True),
        sa.Column("state", sa.String(length=32), nullable=False),
        sa.Column("generation", sa.Integer(), nullable=False),
        sa.Column("priority", sa.Integer(), nullable=False),
        sa.Column("version", sa.Integer(), nullable=False),
        sa.Column("cancel_seq", sa.Integer(), nullable=False),
        sa.Column("max_failed_frames", sa.Integer(), nullable=False),
        sa.Column("frames", sa.Integer(), nullable=True),
        sa.Column("deadline_at", sa.Double(), nullable=True),
        sa.Column("error", sa.JSON(none_as_null=True), nullable=True),
        sa.Column("created_at", sa.Double(), nullable=False),
        sa.Column("started_at", sa.Double(), nullable=True),
        sa.Column("finished_at", sa.Double(), nullable=True),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_scan")),
    )
    with op.batch_alter_table("scan", schema=None) as batch_op:
        batch_op.create_index("ix_scan_owner_id", ["owner", "id"], unique=False)
        batch_op.create_index("ix_scan_owner_plant_id", ["owner", "plant", "id"], unique=False)
        batch_op.create_index("ix_scan_owner_state_id", ["owner", "state", "id"], unique=False)
        batch_op.create_index("ix_scan_root_id", ["root_id"], unique=False)

    op.create_table(
        "worker",
        sa.Column("id", sa.String(length=36), nullable=False),
        sa.Column("host", sa.String(length=255), nullable=False),
        sa.Column("pid", sa.Integer(), nullable=False),
        sa.Column("queues", sa.String(length=255), nullable=False),
        sa.Column("slots", sa.Integer(), nullable=False),
        sa.Column("state", sa.String(length=32), nullable=False),
        sa.Column("lease_until", sa.Double(), nullable=False),
        sa.Column("started_at", sa.Double(), nullable=False),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_worker")),
    )
    op.create_table(
        "event",
        sa.Column("id", sa.BigInteger().with_variant(sa.Integer(), "sqlite"), autoincrement=True, nullable=False),
        sa.Column("scan_id", sa.String(length=36), nullable=False),
        sa.Column("step_id", sa.String(length=36), nullable=True),
        sa.Column("generation", sa.Integer(), nullable=False),
        sa.Column("from_state", sa.String(length=32), nullable=True),
        sa.Column("to_state", sa.String(length=32), nullable=False),
        sa.Column("reason", sa.String(length=64), nullable=False),
        sa.Column("at", sa.Double(), nullable=False),
        sa.ForeignKeyConstraint(["scan_id"], ["scan.id"], name=op.f("fk_event_scan_id_scan"), ondelete="CASCADE"),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_event")),
    )
    with op.batch_alter_table("event", schema=None) as batch_op:
        batch_op.create_index("ix_event_scan_id_id", ["scan_id", "id"], unique=False)

    op.create_table(
        "idempotency_key",
        sa.Column("owner", sa.String(length=64), nullable=False),
        sa.Column("key", sa.String(length=255), nullable=False),
        sa.Column("body_digest", sa.String(length=64), nullable=False),
        sa.Column("scan_id", sa.String(length=36), nullable=False),
        sa.Column("created_at", sa.Double(), nullable=False),
        sa.ForeignKeyConstraint(
            ["scan_id"], ["scan.id"], name=op.f("fk_idempotency_key_scan_id_scan"), ondelete="CASCADE"
        ),
        sa.PrimaryKeyConstraint("owner", "key", name=op.f("pk_idempotency_key")),
    )
    op.create_table(
        "scan_tag",
        sa.Column("scan_id", sa.String(length=36), nullable=False),
        sa.Column("tag", sa.String(length=64), nullable=False),
        sa.ForeignKeyConstraint(["scan_id"], ["scan.id"], name=op.f("fk_scan_tag_scan_id_scan"), ondelete="CASCADE"),
        sa.PrimaryKeyConstraint("scan_id", "tag", name=op.f("pk_scan_tag")),
    )
    with op.batch_alter_table("scan_tag", schema=None) as batch_op:
        batch_op.create_index("ix_scan_tag_tag_scan_id", ["tag", "scan_id"], unique=False)

    op.create_table(
        "step",
        sa.Column("id", sa.String(length=36), nullable=False),
        sa.Column("scan_id", sa.String(length=36), nullable=False),
        sa.Column("kind", sa.String(length=32), nullable=False),
        sa.Column("frame", sa.Integer(), nullable=False),
        sa.Column("generation", sa.Integer(), nullable=False),
        sa.Column("queue", sa.String(length=32), nullable=False),
        sa.Column("depth", sa.Integer(), nullable=False),
        sa.Column("state", sa.String(length=32), nullable=False),
        sa.Column("deps_left", sa.Integer(), nullable=False),
        sa.Column("fresh", sa.Boolean(), nullable=False),
        sa.Column("attempt", sa.Integer(), nullable=False),
        sa.Column("token", sa.Integer(), nullable=False),
        sa.Column("worker_id", sa.String(length=36), nullable=True),
        sa.Column("lease_until", sa.Double(), nullable=True),
        sa.Column("sent_at", sa.Double(), nullable=True),
        sa.Column("not_before", sa.Double(), nullable=True),
        sa.Column("progress_done", sa.Integer(), nullable=False),
        sa.Column("progress_total", sa.Integer(), nullable=False),
        sa.Column("progress_message", sa.Text(), nullable=False),
        sa.Column("input_digest", sa.String(length=64), nullable=True),
        sa.Column("reused_from", sa.String(length=36), nullable=True),
        sa.Column("error", sa.JSON(none_as_null=True), nullable=True),
        sa.Column("facts", sa.JSON(none_as_null=True), nullable=True),
        sa.Column("traceparent", sa.String(length=64), nullable=True),
        sa.Column("created_at", sa.Double(), nullable=False),
        sa.Column("started_at", sa.Double(), nullable=True),
        sa.Column("finished_at", sa.Double(), nullable=True),
        sa.CheckConstraint("deps_left >= 0", name=op.f("ck_step_deps_left")),
        sa.ForeignKeyConstraint(["scan_id"], ["scan.id"], name=op.f("fk_step_scan_id_scan"), ondelete="CASCADE"),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_step")),
        sa.UniqueConstraint(
            "scan_id", "kind", "frame", "generation", name=op.f("uq_step_scan_id_kind_frame_generation")
        ),
    )
    with op.batch_alter_table("step", schema=None) as batch_op:
        batch_op.create_index("ix_step_input_digest", ["input_digest"], unique=False)
        batch_op.create_index(
            "ix_step_queue_state",
            ["queue", "state"],
            unique=False,
            sqlite_where=sa.text("state IN ('pending', 'ready', 'sent', 'running')"),
            postgresql_where=sa.text("state IN ('pending', 'ready', 'sent', 'running')"),
        )
        batch_op.create_index("ix_step_scan_id_generation_state", ["scan_id", "generation", "state"], unique=False)

    op.create_table(
        "artifact_ref",
        sa.Column("step_id", sa.String(length=36), nullable=False),
        sa.Column("role", sa.String(length=255), nullable=False),
        sa.Column("name", sa.String(length=255), nullable=False),
        sa.Column("digest", sa.String(length=64), nullable=False),
        sa.ForeignKeyConstraint(["digest"], ["artifact.digest"], name=op.f("fk_artifact_ref_digest_artifact")),
        sa.ForeignKeyConstraint(
            ["step_id"], ["step.id"], name=op.f("fk_artifact_ref_step_id_step"), ondelete="CASCADE"
        ),
        sa.PrimaryKeyConstraint("step_id", "role", name=op.f("pk_artifact_ref")),
    )
    with op.batch_alter_table("artifact_ref", schema=None) as batch_op:
        batch_op.create_index("ix_artifact_ref_digest", ["digest"], unique=False)

    op.create_table(
        "attempt",
        sa.Column("step_id", sa.String(length=36), nullable=False),
        sa.Column("token", sa.Integer(), nullable=False),
        sa.Column("worker_id", sa.String(length=36), nullable=False),
        sa.Column("pid", sa.Integer(), nullable=True),
        sa.Column("started_at", sa.Double(), nullable=False),
        sa.Column("ended_at", sa.Double(), nullable=True),
        sa.Column("outcome", sa.String(length=32), nullable=True),
        sa.Column("exit_code", sa.Integer(), nullable=True),
        sa.Column("error", sa.JSON(none_as_null=True), nullable=True),
        sa.Column("log_key", sa.String(length=255), nullable=True),
        sa.Column("max_rss_bytes", sa.BigInteger(), nullable=True),
        sa.ForeignKeyConstraint(["step_id"], ["step.id"], name=op.f("fk_attempt_step_id_step"), ondelete="CASCADE"),
        sa.PrimaryKeyConstraint("step_id", "token", name=op.f("pk_attempt")),
    )
    op.create_table(
        "step_dependency",
        sa.Column("parent_id", sa.String(length=36), nullable=False),
        sa.Column("child_id", sa.String(length=36), nullable=False),
        sa.ForeignKeyConstraint(
            ["child_id"], ["step.id"], name=op.f("fk_step_dependency_child_id_step"), ondelete="CASCADE"
        ),
        sa.ForeignKeyConstraint(
            ["parent_id"], ["step.id"], name=op.f("fk_step_dependency_parent_id_step"), ondelete="CASCADE"
        ),
        sa.PrimaryKeyConstraint("parent_id", "child_id", name=op.f("pk_step_dependency")),
    )
    with op.batch_alter_table("step_dependency", schema=None) as batch_op:
        batch_op.create_index("ix_step_dependency_child_id", ["child_id"], unique=False)


def downgrade() -> None:

    with op.batch_alter_table("step_dependency", schema=None) as batch_op:
        batch_op.drop_index("ix_step_dependency_child_id")

    op.drop_table("step_dependency")
    op.drop_table("attempt")
    with op.batch_alter_table("artifact_ref", schema=None) as batch_op:
        batch_op.drop_index("ix_artifact_ref_digest")

    op.drop_table("artifact_ref")
    with op.batch_alter_table("step", schema=None) as batch_op:
        batch_op.drop_index("ix_step_scan_id_generation_state")
        batch_op.drop_index(
            "ix_step_queue_state",
            sqlite_where=sa.text("state IN ('pending', 'ready', 'sent', 'running')"),
            postgresql_where=sa.text("state IN ('pending', 'ready', 'sent', 'running')"),
        )
        batch_op.drop_index("ix_step_input_digest")

    op.drop_table("step")
    with op.batch_alter_table("scan_tag", schema=None) as batch_op:
        batch_op.drop_index("ix_scan_tag_tag_scan_id")

    op.drop_table("scan_tag")
    op.drop_table("idempotency_key")
    with op.batch_alter_table("event", schema=None) as batch_op:
        batch_op.drop_index("ix_event_scan_id_id")

    op.drop_table("event")
    op.drop_table("worker")
    with op.batch_alter_table("scan", schema=None) as batch_op:
        batch_op.drop_index("ix_scan_root_id")
        batch_op.drop_index("ix_scan_owner_state_id")
        batch_op.drop_index("ix_scan_owner_plant_id")
        batch_op.drop_index("ix_scan_owner_id")

    op.drop_table("scan")
    op.drop_table("artifact")
