"""Watch a fleet: plants, the modes of their scans, tracks, environment, alarms, schedules

Revision: 0007, after 0006
"""

import sqlalchemy as sa
from alembic import op

revision = "0007"
down_revision = "0006"
branch_labels = None
depends_on = None

TOUCHED = sa.text("touched > joined")


def upgrade() -> None:
    op.create_table(
        "plant",
        sa.Column("key", sa.String(length=36), nullable=False),
        sa.Column("owner", sa.String(length=64), nullable=False),
        sa.Column("id", sa.String(length=64), nullable=False),
        sa.Column("name", sa.String(length=120), nullable=False),
        sa.Column("treatment", sa.String(length=64), nullable=True),
        sa.Column("position", sa.String(length=64), nullable=True),
        sa.Column("study", sa.String(length=64), nullable=True),
        sa.Column("species", sa.String(length=120), nullable=True),
        sa.Column("genotype", sa.String(length=120), nullable=True),
        sa.Column("replicate", sa.String(length=64), nullable=True),
        sa.Column("block", sa.String(length=64), nullable=True),
        sa.Column("notes", sa.Text(), nullable=False),
        sa.Column("tags", sa.JSON(none_as_null=True), nullable=False),
        sa.Column("demo", sa.Boolean(), server_default=sa.false(), nullable=False),
        sa.Column("reference_from", sa.Double(), nullable=True),
        sa.Column("reference_until", sa.Double(), nullable=True),
        sa.Column("reference_scans", sa.Integer(), nullable=False),
        sa.Column("false_alarms_per_year", sa.Double(), nullable=False),
        sa.Column("covariates", sa.JSON(none_as_null=True), nullable=True),
        sa.Column("growth", sa.Boolean(), server_default=sa.false(), nullable=False),
        sa.Column("charts_from", sa.Double(), nullable=True),
        sa.Column("created_at", sa.Double(), nullable=False),
        sa.Column("scans", sa.Integer(), nullable=False),
        sa.Column("last_scan_id", sa.String(length=36), nullable=True),
        sa.Column("last_scan_state", sa.String(length=32), nullable=True),
        sa.Column("last_scan_at", sa.Double(), nullable=True),
        sa.Column("frequency_hz", sa.Double(), nullable=True),
        sa.Column("ratio", sa.Double(), nullable=True),
        sa.Column("latest", sa.JSON(none_as_null=True), nullable=False),
        sa.Column("spark", sa.JSON(none_as_null=True), nullable=False),
        sa.Column("open_alarms", sa.Integer(), nullable=False),
        sa.Column("worst", sa.String(length=32), nullable=True),
        sa.Column("missed_scans", sa.Integer(), nullable=False),
        sa.Column("touched", sa.Integer(), nullable=False),
        sa.Column("joined", sa.Integer(), nullable=False),
        sa.Column("drift", sa.JSON(none_as_null=True), nullable=True),
        sa.PrimaryKeyConstraint("key", name=op.f("pk_plant")),
        sa.UniqueConstraint("owner", "id", name=op.f("uq_plant_owner_id")),
    )
    op.create_index("ix_plant_owner_open_alarms", "plant", ["owner", "open_alarms"], unique=False)
    op.create_index("ix_plant_owner_ratio", "plant", ["owner", "ratio"], unique=False)
    op.create_index("ix_plant_owner_treatment", "plant", ["owner", "treatment"], unique=False)
    op.create_index(
        "ix_plant_touched", "plant", ["touched"], unique=False, sqlite_where=TOUCHED, postgresql_where=TOUCHED
    )
    op.create_table(
        "alarm",
        sa.Column("id", sa.String(length=36), nullable=False),
        sa.Column("owner", sa.String(length=64), nullable=False),
        sa.Column("plant_key", sa.String(length=36), nullable=False),
        sa.Column("kind", sa.String(length=32), nullable=False),
        sa.Column("subject", sa.String(length=64), nullable=False),
        sa.Column("severity", sa.String(length=32), nullable=False),
        sa.Column("state", sa.String(length=32), nullable=False),
        sa.Column("evidence", sa.JSON(none_as_null=True), nullable=False),
        sa.Column("opened_at", sa.Double(), nullable=False),
        sa.Column("acknowledged_at", sa.Double(), nullable=True),
        sa.Column("closed_at", sa.Double(), nullable=True),
        sa.Column("closed_by", sa.String(length=32), nullable=True),
        sa.Column("note", sa.Text(), nullable=False),
        sa.ForeignKeyConstraint(
            ["plant_key"], ["plant.key"], name=op.f("fk_alarm_plant_key_plant"), ondelete="CASCADE"
        ),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_alarm")),
    )
    op.create_index("ix_alarm_owner_id", "alarm", ["owner", "id"], unique=False)
    op.create_index("ix_alarm_owner_state_id", "alarm", ["owner", "state", "id"], unique=False)
    op.create_index("ix_alarm_plant_key_id", "alarm", ["plant_key", "id"], unique=False)
    op.create_table(
        "environment",
        sa.Column("id", sa.String(length=36), nullable=False),
        sa.Column("owner", sa.String(length=64), nullable=False),
        sa.Column("place", sa.String(length=36), nullable=False),
        sa.Column("plant_key", sa.String(length=36), nullable=True),
        sa.Column("at", sa.Double(), nullable=False),
        sa.Column("temperature_c", sa.Double(), nullable=True),
        sa.Column("humidity_percent", sa.Double(), nullable=True),
        sa.Column("light_umol_m2_s", sa.Double(), nullable=True),
        sa.Column("soil_water_percent", sa.Double(), nullable=True),
        sa.Column("mass_g", sa.Double(), nullable=True),
        sa.Column("free", sa.JSON(none_as_null=True), nullable=True),
        sa.ForeignKeyConstraint(
            ["plant_key"], ["plant.key"], name=op.f("fk_environment_plant_key_plant"), ondelete="CASCADE"
        ),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_environment")),
        sa.UniqueConstraint("owner", "place", "at", name=op.f("uq_environment_owner_place_at")),
    )
    op.create_table(
        "observation",
        sa.Column("scan_id", sa.String(length=36), nullable=False),
        sa.Column("organ", sa.String(length=64), nullable=False),
        sa.Column("mode", sa.Integer(), nullable=False),
        sa.Column("plant_key", sa.String(length=36), nullable=False),
        sa.Column("at", sa.Double(), nullable=False),
        sa.Column("frequency_hz", sa.Double(), nullable=False),
        sa.Column("frequency_std_hz", sa.Double(), nullable=True),
        sa.Column("damping_ratio", sa.Double(), nullable=True),
        sa.Column("damping_ratio_std", sa.Double(), nullable=True),
        sa.Column("amplitude_m", sa.Double(), nullable=True),
        sa.Column("verdict", sa.String(length=32), nullable=False),
        sa.Column("shape", sa.LargeBinary(), nullable=True),
        sa.Column("track_id", sa.String(length=36), nullable=True),
        sa.Column("link", sa.String(length=32), nullable=True),
        sa.Column("mac", sa.Double(), nullable=True),
        sa.ForeignKeyConstraint(
            ["plant_key"], ["plant.key"], name=op.f("fk_observation_plant_key_plant"), ondelete="CASCADE"
        ),
        sa.ForeignKeyConstraint(["scan_id"], ["scan.id"], name=op.f("fk_observation_scan_id_scan"), ondelete="CASCADE"),
        sa.PrimaryKeyConstraint("scan_id", "organ", "mode", name=op.f("pk_observation")),
    )
    op.create_index("ix_observation_plant_key_at", "observation", ["plant_key", "at"], unique=False)
    op.create_index("ix_observation_track_id_at", "observation", ["track_id", "at"], unique=False)
    op.create_table(
        "plant_event",
        sa.Column("id", sa.String(length=36), nullable=False),
        sa.Column("plant_key", sa.String(length=36), nullable=False),
        sa.Column("at", sa.Double(), nullable=False),
        sa.Column("kind", sa.String(length=32), nullable=False),
        sa.Column("note", sa.Text(), nullable=False),
        sa.Column("amount", sa.Double(), nullable=True),
        sa.Column("unit", sa.String(length=32), nullable=True),
        sa.ForeignKeyConstraint(
            ["plant_key"], ["plant.key"], name=op.f("fk_plant_event_plant_key_plant"), ondelete="CASCADE"
        ),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_plant_event")),
    )
    op.create_index("ix_plant_event_plant_key_at", "plant_event", ["plant_key", "at"], unique=False)
    op.create_table(
        "plant_scan",
        sa.Column("scan_id", sa.String(length=36), nullable=False),
        sa.Column("plant_key", sa.String(length=36), nullable=False),
        sa.Column("generation", sa.Integer(), nullable=False),
        sa.Column("at", sa.Double(), nullable=False),
        sa.Column("problem", sa.String(length=255), nullable=True),
        sa.ForeignKeyConstraint(
            ["plant_key"], ["plant.key"], name=op.f("fk_plant_scan_plant_key_plant"), ondelete="CASCADE"
        ),
        sa.ForeignKeyConstraint(["scan_id"], ["scan.id"], name=op.f("fk_plant_scan_scan_id_scan"), ondelete="CASCADE"),
        sa.PrimaryKeyConstraint("scan_id", name=op.f("pk_plant_scan")),
    )
    op.create_index("ix_plant_scan_plant_key_at", "plant_scan", ["plant_key", "at"], unique=False)
    op.create_table(
        "plant_tag",
        sa.Column("plant_key", sa.String(length=36), nullable=False),
        sa.Column("tag", sa.String(length=64), nullable=False),
        sa.ForeignKeyConstraint(
            ["plant_key"], ["plant.key"], name=op.f("fk_plant_tag_plant_key_plant"), ondelete="CASCADE"
        ),
        sa.PrimaryKeyConstraint("plant_key", "tag", name=op.f("pk_plant_tag")),
    )
    op.create_index("ix_plant_tag_tag_plant_key", "plant_tag", ["tag", "plant_key"], unique=False)
    op.create_table(
        "schedule",
        sa.Column("id", sa.String(length=36), nullable=False),
        sa.Column("owner", sa.String(length=64), nullable=False),
        sa.Column("plant_key", sa.String(length=36), nullable=False),
        sa.Column("every_hours", sa.Double(), nullable=True),
        sa.Column("cron", sa.String(length=120), nullable=True),
        sa.Column("time_zone", sa.String(length=64), nullable=False),
        sa.Column("spec", sa.JSON(none_as_null=True), nullable=False),
        sa.Column("grace_minutes", sa.Double(), nullable=False),
        sa.Column("enabled", sa.Boolean(), nullable=False),
        sa.Column("next_due_at", sa.Double(), nullable=False),
        sa.Column("created_at", sa.Double(), nullable=False),
        sa.ForeignKeyConstraint(
            ["plant_key"], ["plant.key"], name=op.f("fk_schedule_plant_key_plant"), ondelete="CASCADE"
        ),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_schedule")),
    )
    op.create_index("ix_schedule_enabled_next_due_at", "schedule", ["enabled", "next_due_at"], unique=False)
    op.create_index("ix_schedule_owner_id", "schedule", ["owner", "id"], unique=False)
    op.create_index("ix_schedule_plant_key", "schedule", ["plant_key"], unique=False)
    op.create_table(
        "track",
        sa.Column("id", sa.String(length=36), nullable=False),
        sa.Column("plant_key", sa.String(length=36), nullable=False),
        sa.Column("number", sa.Integer(), nullable=False),
        sa.Column("name", sa.String(length=64), nullable=True),
        sa.Column("organ", sa.String(length=64), nullable=False),
        sa.Column("active", sa.Boolean(), nullable=False),
        sa.Column("by_hand", sa.Boolean(), server_default=sa.false(), nullable=False),
        sa.Column("born_at", sa.Double(), nullable=False),
        sa.Column("last_seen_at", sa.Double(), nullable=False),
        sa.Column("scans", sa.Integer(), nullable=False),
        sa.Column("missed", sa.Integer(), nullable=False),
        sa.Column("doubtful_links", sa.Integer(), nullable=False),
        sa.Column("frequency_hz", sa.Double(), nullable=False),
        sa.Column("frequency_std_hz", sa.Double(), nullable=True),
        sa.Column("damping_ratio", sa.Double(), nullable=True),
        sa.Column("reference_hz", sa.Double(), nullable=True),
        sa.Column("reference_std_hz", sa.Double(), nullable=True),
        sa.ForeignKeyConstraint(
            ["plant_key"], ["plant.key"], name=op.f("fk_track_plant_key_plant"), ondelete="CASCADE"
        ),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_track")),
    )
    op.create_index("ix_track_plant_key", "track", ["plant_key"], unique=False)
    op.create_table(
        "track_pin",
        sa.Column("scan_id", sa.String(length=36), nullable=False),
        sa.Column("organ", sa.String(length=64), nullable=False),
        sa.Column("mode", sa.Integer(), nullable=False),
        sa.Column("plant_key", sa.String(length=36), nullable=False),
        sa.Column("track_id", sa.String(length=36), nullable=True),
        sa.Column("created_at", sa.Double(), nullable=False),
        sa.ForeignKeyConstraint(
            ["plant_key"], ["plant.key"], name=op.f("fk_track_pin_plant_key_plant"), ondelete="CASCADE"
        ),
        sa.ForeignKeyConstraint(["scan_id"], ["scan.id"], name=op.f("fk_track_pin_scan_id_scan"), ondelete="CASCADE"),
        sa.PrimaryKeyConstraint("scan_id", "organ", "mode", name=op.f("pk_track_pin")),
    )
    op.create_index("ix_track_pin_plant_key", "track_pin", ["plant_key"], unique=False)
    op.create_table(
        "schedule_run",
        sa.Column("schedule_id", sa.String(length=36), nullable=False),
        sa.Column("due_at", sa.Double(), nullable=False),
        sa.Column("state", sa.String(length=32), nullable=False),
        sa.Column("scan_id", sa.String(length=36), nullable=True),
        sa.Column("reason", sa.String(length=255), nullable=False),
        sa.ForeignKeyConstraint(
            ["schedule_id"], ["schedule.id"], name=op.f("fk_schedule_run_schedule_id_schedule"), ondelete="CASCADE"
        ),
        sa.PrimaryKeyConstraint("schedule_id", "due_at", name=op.f("pk_schedule_run")),
    )


def downgrade() -> None:
    op.drop_table("schedule_run")
    op.drop_table("track_pin")
    op.drop_table("track")
    op.drop_table("schedule")
    op.drop_table("plant_tag")
    op.drop_table("plant_scan")
    op.drop_table("plant_event")
    op.drop_table("observation")
    op.drop_table("environment")
    op.drop_table("alarm")
    op.drop_table("plant")
