"""The tables of the fleet. Times are seconds since 1970 UTC; rows are plain, as in `scanjobs.tables`.

A plant has a `key` of the database's and an `id`, the owner's own word. What lists need of a plant is kept in its row
(`last_*`, `ratio`, `spark`, `open_alarms`), written by whoever changes it, so that no list looks at scans.
"""

from typing import Any

from sqlalchemy import JSON, ForeignKey, Index, LargeBinary, String, Text, UniqueConstraint, false, text
from sqlalchemy.orm import Mapped, mapped_column

from scanjobs.table_base import Base, Id, Word

TOUCHED = text("touched > joined")
JsonList = JSON(none_as_null=True)


class Plant(Base):
    """A plant, tower or other structure that is scanned again and again."""

    __tablename__ = "plant"
    __table_args__ = (
        UniqueConstraint("owner", "id"),
        Index("ix_plant_owner_treatment", "owner", "treatment"),
        Index("ix_plant_owner_ratio", "owner", "ratio"),
        Index("ix_plant_owner_open_alarms", "owner", "open_alarms"),
        Index("ix_plant_touched", "touched", sqlite_where=TOUCHED, postgresql_where=TOUCHED),
    )

    key: Mapped[str] = mapped_column(Id, primary_key=True)
    owner: Mapped[str] = mapped_column(String(64))
    id: Mapped[str] = mapped_column(String(64))
    """The word that a specification's `plant.id` says."""
    name: Mapped[str] = mapped_column(String(120))
    treatment: Mapped[str | None] = mapped_column(String(64))
    position: Mapped[str | None] = mapped_column(String(64))
    study: Mapped[str | None] = mapped_column(String(64))
    species: Mapped[str | None] = mapped_column(String(120))
    genotype: Mapped[str | None] = mapped_column(String(120))
    replicate: Mapped[str | None] = mapped_column(String(64))
    block: Mapped[str | None] = mapped_column(String(64))
    notes: Mapped[str] = mapped_column(Text, default="")
    tags: Mapped[list[str]] = mapped_column(JsonList)
    demo: Mapped[bool] = mapped_column(default=False, server_default=false())
    """Made by `demo-fleet`, and removed by it."""
    reference_from: Mapped[float | None]
    reference_until: Mapped[float | None]
    reference_scans: Mapped[int] = mapped_column(default=12)
    """So many scans, from `reference_from` on, say what is normal for the plant."""
    false_alarms_per_year: Mapped[float] = mapped_column(default=0.1)
    covariates: Mapped[list[str] | None] = mapped_column(JsonList)
    """None is every environment column that has enough values."""
    growth: Mapped[bool] = mapped_column(default=False, server_default=false())
    """Whether a steady change with time is normal."""
    charts_from: Mapped[float | None]
    """Scans before this moment are in no chart: an alarm was closed then."""
    created_at: Mapped[float]
    scans: Mapped[int] = mapped_column(default=0)
    last_scan_id: Mapped[str | None] = mapped_column(Id)
    last_scan_state: Mapped[str | None] = mapped_column(Word)
    last_scan_at: Mapped[float | None]
    frequency_hz: Mapped[float | None]
    ratio: Mapped[float | None]
    """f/f0 of all tracks together at the last scan that shows one."""
    latest: Mapped[list[dict[str, Any]]] = mapped_column(JsonList)
    spark: Mapped[list[list[float]]] = mapped_column(JsonList)
    open_alarms: Mapped[int] = mapped_column(default=0)
    worst: Mapped[str | None] = mapped_column(Word)
    missed_scans: Mapped[int] = mapped_column(default=0)
    touched: Mapped[int] = mapped_column(default=0)
    """Grows whenever the plant's tracks may be others; `joined` is the value they were last computed at."""
    joined: Mapped[int] = mapped_column(default=0)
    drift: Mapped[dict[str, Any] | None] = mapped_column(JSON(none_as_null=True), deferred=True)
    """Charts, effects, change points and trends as they were computed last."""


class PlantTag(Base):
    """A word that its owner finds a plant by; the plant's own row has them too."""

    __tablename__ = "plant_tag"
    __table_args__ = (Index("ix_plant_tag_tag_plant_key", "tag", "plant_key"),)

    plant_key: Mapped[str] = mapped_column(ForeignKey("plant.key", ondelete="CASCADE"), primary_key=True)
    tag: Mapped[str] = mapped_column(String(64), primary_key=True)


class PlantScan(Base):
    """A scan of a plant whose result has been read, and of which generation."""

    __tablename__ = "plant_scan"
    __table_args__ = (Index("ix_plant_scan_plant_key_at", "plant_key", "at"),)

    scan_id: Mapped[str] = mapped_column(ForeignKey("scan.id", ondelete="CASCADE"), primary_key=True)
    plant_key: Mapped[str] = mapped_column(ForeignKey("plant.key", ondelete="CASCADE"))
    generation: Mapped[int]
    at: Mapped[float]
    problem: Mapped[str | None] = mapped_column(String(255))
    """Why nothing could be read."""


class Track(Base):
    """One mode of a plant through its scans. What was found by hand stays when tracks are computed again."""

    __tablename__ = "track"
    __table_args__ = (Index("ix_track_plant_key", "plant_key"),)

    id: Mapped[str] = mapped_column(Id, primary_key=True)
    plant_key: Mapped[str] = mapped_column(ForeignKey("plant.key", ondelete="CASCADE"))
    number: Mapped[int]
    name: Mapped[str | None] = mapped_column(String(64))
    """Given by a person; else it is organ and number."""
    organ: Mapped[str] = mapped_column(String(64))
    active: Mapped[bool]
    by_hand: Mapped[bool] = mapped_column(default=False, server_default=false())
    born_at: Mapped[float]
    last_seen_at: Mapped[float]
    scans: Mapped[int]
    missed: Mapped[int]
    doubtful_links: Mapped[int]
    frequency_hz: Mapped[float]
    frequency_std_hz: Mapped[float | None]
    damping_ratio: Mapped[float | None]
    reference_hz: Mapped[float | None]
    reference_std_hz: Mapped[float | None]


class Observation(Base):
    """A mode of a plant's scan, and the track it belongs to."""

    __tablename__ = "observation"
    __table_args__ = (
        Index("ix_observation_plant_key_at", "plant_key", "at"),
        Index("ix_observation_track_id_at", "track_id", "at"),
    )

    scan_id: Mapped[str] = mapped_column(ForeignKey("scan.id", ondelete="CASCADE"), primary_key=True)
    organ: Mapped[str] = mapped_column(String(64), primary_key=True)
    mode: Mapped[int] = mapped_column(primary_key=True)
    """Counted within the organ from 0, as in modes.json."""
    plant_key: Mapped[str] = mapped_column(ForeignKey("plant.key", ondelete="CASCADE"))
    at: Mapped[float]
    frequency_hz: Mapped[float]
    frequency_std_hz: Mapped[float | None]
    damping_ratio: Mapped[float | None]
    damping_ratio_std: Mapped[float | None]
    amplitude_m: Mapped[float | None]
    verdict: Mapped[str] = mapped_column(Word)
    shape: Mapped[bytes | None] = mapped_column(LargeBinary)
    """A few sensors of the shape, see `shapes.pack`."""
    track_id: Mapped[str | None] = mapped_column(Id)
    link: Mapped[str | None] = mapped_column(Word)
    """`born`, `sure`, `doubtful` or `manual`."""
    mac: Mapped[float | None]
    """Shape correlation with the track before this scan."""


class TrackPin(Base):
    """What a person decided: this mode belongs to this track, or (None) to none."""

    __tablename__ = "track_pin"
    __table_args__ = (Index("ix_track_pin_plant_key", "plant_key"),)

    scan_id: Mapped[str] = mapped_column(ForeignKey("scan.id", ondelete="CASCADE"), primary_key=True)
    organ: Mapped[str] = mapped_column(String(64), primary_key=True)
    mode: Mapped[int] = mapped_column(primary_key=True)
    plant_key: Mapped[str] = mapped_column(ForeignKey("plant.key", ondelete="CASCADE"))
    track_id: Mapped[str | None] = mapped_column(Id)
    created_at: Mapped[float]


class Environment(Base):
    """What surrounded a plant at a moment; without a plant it is of the owner's whole house."""

    __tablename__ = "environment"
    __table_args__ = (UniqueConstraint("owner", "place", "at"),)

    id: Mapped[str] = mapped_column(Id, primary_key=True)
    owner: Mapped[str] = mapped_column(String(64))
    place: Mapped[str] = mapped_column(Id)
    """The plant's key; empty for the whole house."""
    plant_key: Mapped[str | None] = mapped_column(ForeignKey("plant.key", ondelete="CASCADE"))
    at: Mapped[float]
    temperature_c: Mapped[float | None]
    humidity_percent: Mapped[float | None]
    light_umol_m2_s: Mapped[float | None]
    soil_water_percent: Mapped[float | None]
    mass_g: Mapped[float | None]
    free: Mapped[dict[str, Any] | None]
    """Columns of the owner's own: name → number."""


class PlantEvent(Base):
    """Something that was done to a plant: watered, repotted, noted."""

    __tablename__ = "plant_event"
    __table_args__ = (Index("ix_plant_event_plant_key_at", "plant_key", "at"),)

    id: Mapped[str] = mapped_column(Id, primary_key=True)
    plant_key: Mapped[str] = mapped_column(ForeignKey("plant.key", ondelete="CASCADE"))
    at: Mapped[float]
    kind: Mapped[str] = mapped_column(Word)
    note: Mapped[str] = mapped_column(Text, default="")
    amount: Mapped[float | None]
    unit: Mapped[str | None] = mapped_column(Word)


class Alarm(Base):
    """What is not as it should be with a plant, from the scan that showed it until somebody closes it."""

    __tablename__ = "alarm"
    __table_args__ = (
        Index("ix_alarm_owner_id", "owner", "id"),
        Index("ix_alarm_owner_state_id", "owner", "state", "id"),
        Index("ix_alarm_plant_key_id", "plant_key", "id"),
    )

    id: Mapped[str] = mapped_column(Id, primary_key=True)
    owner: Mapped[str] = mapped_column(String(64))
    plant_key: Mapped[str] = mapped_column(ForeignKey("plant.key", ondelete="CASCADE"))
    kind: Mapped[str] = mapped_column(Word)
    subject: Mapped[str] = mapped_column(String(64), default="")
    """What of the plant: a lost mode's track; one alarm of a kind and subject is open at a time."""
    severity: Mapped[str] = mapped_column(Word)
    state: Mapped[str] = mapped_column(Word)
    evidence: Mapped[dict[str, Any]]
    """Onset, delay, change, confidence: see `monitoring.verdicts`."""
    opened_at: Mapped[float]
    acknowledged_at: Mapped[float | None]
    closed_at: Mapped[float | None]
    closed_by: Mapped[str | None] = mapped_column(Word)
    note: Mapped[str] = mapped_column(Text, default="")


class Schedule(Base):
    """When a plant is scanned again, and from what."""

    __tablename__ = "schedule"
    __table_args__ = (
        Index("ix_schedule_owner_id", "owner", "id"),
        Index("ix_schedule_enabled_next_due_at", "enabled", "next_due_at"),
        Index("ix_schedule_plant_key", "plant_key"),
    )

    id: Mapped[str] = mapped_column(Id, primary_key=True)
    owner: Mapped[str] = mapped_column(String(64))
    plant_key: Mapped[str] = mapped_column(ForeignKey("plant.key", ondelete="CASCADE"))
    every_hours: Mapped[float | None]
    cron: Mapped[str | None] = mapped_column(String(120))
    time_zone: Mapped[str] = mapped_column(String(64))
    spec: Mapped[dict[str, Any]]
    """A specification without a plant; `source.path` may hold {plant}, {date} and {time}."""
    grace_minutes: Mapped[float]
    enabled: Mapped[bool]
    next_due_at: Mapped[float]
    created_at: Mapped[float]


class ScheduleRun(Base):
    """What became of one time of a schedule."""

    __tablename__ = "schedule_run"

    schedule_id: Mapped[str] = mapped_column(ForeignKey("schedule.id", ondelete="CASCADE"), primary_key=True)
    due_at: Mapped[float] = mapped_column(primary_key=True)
    state: Mapped[str] = mapped_column(Word)
    """`submitted` or `missed`."""
    scan_id: Mapped[str | None] = mapped_column(Id)
    reason: Mapped[str] = mapped_column(String(255), default="")
