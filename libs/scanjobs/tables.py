"""The tables. Times are seconds since 1970 UTC by the database's clock; relations are read by queries only.

Rows are plain: every query lives in `repository`, `leases` and `dispatch`, and the caller commits.
"""

from typing import Any

from sqlalchemy import (
    BigInteger,
    CheckConstraint,
    ForeignKey,
    Index,
    String,
    Text,
    UniqueConstraint,
    false,
    text,
)
from sqlalchemy.orm import Mapped, mapped_column, relationship

from scanjobs import account_tables as account_tables  # every table is in Base.metadata as soon as one is
from scanjobs import rigs as rigs  # likewise
from scanjobs.clock import transaction_number
from scanjobs.fleet import tables as fleet_tables  # noqa: F401 - likewise
from scanjobs.table_base import Base as Base
from scanjobs.table_base import Counter, Digest, Id, Word
from scanjobs.table_base import table_of as table_of

LIVE_SCAN = text("state IN ('uploading', 'queued', 'running', 'paused', 'canceling')")
UNPLANTED = text("unplanted_from IS NOT NULL")
PAUSED = text("paused_for IS NOT NULL")
LIVE = text("state IN ('pending', 'ready', 'sent', 'running')")


class Scan(Base):
    """One scan; `version` grows with every change, `generation` with every retry."""

    __tablename__ = "scan"
    __table_args__ = (
        Index("ix_scan_owner_id", "owner", "id"),
        Index("ix_scan_owner_state_id", "owner", "state", "id"),
        Index("ix_scan_owner_plant_id", "owner", "plant", "id"),
        Index("ix_scan_root_id", "root_id"),
        Index("ix_scan_live", "state", sqlite_where=LIVE_SCAN, postgresql_where=LIVE_SCAN),
        Index("ix_scan_unplanted_from", "unplanted_from", sqlite_where=UNPLANTED, postgresql_where=UNPLANTED),
        Index("ix_scan_paused_for", "paused_for", sqlite_where=PAUSED, postgresql_where=PAUSED),
    )

    id: Mapped[str] = mapped_column(Id, primary_key=True)
    owner: Mapped[str] = mapped_column(String(64))
    root_id: Mapped[str] = mapped_column(Id)
    """The scan that this one was forked from, over all forks; steps are only reused within one root."""
    name: Mapped[str] = mapped_column(String(64))
    source_kind: Mapped[str] = mapped_column(Word)
    spec: Mapped[dict[str, Any]]
    spec_digest: Mapped[str] = mapped_column(Digest)
    plant: Mapped[str | None] = mapped_column(String(64))
    state: Mapped[str] = mapped_column(Word)
    generation: Mapped[int] = mapped_column(default=0)
    priority: Mapped[int] = mapped_column(default=0)
    version: Mapped[int] = mapped_column(default=0)
    cancel_seq: Mapped[int] = mapped_column(default=0)
    max_failed_frames: Mapped[int] = mapped_column(default=0)
    frames: Mapped[int | None]
    """Number of frames; None until the source has been inspected."""
    unplanted_from: Mapped[int | None]
    """The first frame whose steps have no rows yet; None once the plan is whole."""
    paused_for: Mapped[str | None] = mapped_column(Word)
    """Of a paused scan: `asked`, `disk_low` or `quota`."""
    served: Mapped[int] = mapped_column(default=0, server_default=text("0"))
    """Steps that were claimed, over all generations: who has had little comes before who has had much."""
    served_at: Mapped[float | None]
    """When the last one was."""
    deadline_at: Mapped[float | None]
    error: Mapped[dict[str, Any] | None]
    """`{step, code, message, hint, retryable}` of what made it fail."""
    created_at: Mapped[float]
    started_at: Mapped[float | None]
    finished_at: Mapped[float | None]

    traceparent: Mapped[str | None] = mapped_column(String(64))
    """Of the request that submitted it; its steps go on with that trace."""

    tags: Mapped[list["ScanTag"]] = relationship(lazy="raise", order_by="ScanTag.tag", viewonly=True)


class ScanTag(Base):
    """A word that its owner finds a scan by."""

    __tablename__ = "scan_tag"
    __table_args__ = (Index("ix_scan_tag_tag_scan_id", "tag", "scan_id"),)

    scan_id: Mapped[str] = mapped_column(ForeignKey("scan.id", ondelete="CASCADE"), primary_key=True)
    tag: Mapped[str] = mapped_column(String(64), primary_key=True)


class Step(Base):
    """One unit of work. `token` fences: it grows with every claim, and every write of a runner names it."""

    __tablename__ = "step"
    __table_args__ = (
        UniqueConstraint("scan_id", "kind", "frame", "generation"),
        CheckConstraint("deps_left >= 0", name="deps_left"),
        Index("ix_step_queue_state", "queue", "state", sqlite_where=LIVE, postgresql_where=LIVE),
        Index("ix_step_scan_id_generation_state", "scan_id", "generation", "state"),
        Index("ix_step_input_digest", "input_digest"),
    )

    id: Mapped[str] = mapped_column(Id, primary_key=True)
    scan_id: Mapped[str] = mapped_column(ForeignKey("scan.id", ondelete="CASCADE"))
    kind: Mapped[str] = mapped_column(Word)
    frame: Mapped[int]
    """-1 for a step of the whole scan."""
    generation: Mapped[int]
    queue: Mapped[str] = mapped_column(Word)
    depth: Mapped[int]
    state: Mapped[str] = mapped_column(Word)
    deps_left: Mapped[int]
    fresh: Mapped[bool] = mapped_column(default=False)
    """Computed even if a step with the same inputs has been: a retry asked for it."""
    attempt: Mapped[int] = mapped_column(default=0)
    """Attempts spent; a drain gives its attempt back."""
    token: Mapped[int] = mapped_column(default=0)
    worker_id: Mapped[str | None] = mapped_column(Id)
    """Who computes it; of a sent step, the worker in whose memory its message lies, if it lies there."""
    lease_until: Mapped[float | None]
    sent_at: Mapped[float | None]
    not_before: Mapped[float | None]
    """After a failed attempt: when the next may begin."""
    ready_at: Mapped[float | None]
    """Since when it could be computed; the wait until its claim is the dispatch lag."""
    progress_done: Mapped[int] = mapped_column(default=0)
    progress_total: Mapped[int] = mapped_column(default=0)
    progress_message: Mapped[str] = mapped_column(Text, default="")
    input_digest: Mapped[str | None] = mapped_column(Digest)
    resume_digest: Mapped[str | None] = mapped_column(Digest)
    """What an attempt has saved on its way; the next attempt goes on from there."""
    reused_from: Mapped[str | None] = mapped_column(Id)
    error: Mapped[dict[str, Any] | None]
    facts: Mapped[dict[str, Any] | None]
    """What the step would say of its result: PSNR, number of points, frames."""
    traceparent: Mapped[str | None] = mapped_column(String(64))
    created_at: Mapped[float]
    started_at: Mapped[float | None]
    finished_at: Mapped[float | None]


class StepDependency(Base):
    """`child_id` waits for `parent_id`."""

    __tablename__ = "step_dependency"
    __table_args__ = (Index("ix_step_dependency_child_id", "child_id"),)

    parent_id: Mapped[str] = mapped_column(ForeignKey("step.id", ondelete="CASCADE"), primary_key=True)
    child_id: Mapped[str] = mapped_column(ForeignKey("step.id", ondelete="CASCADE"), primary_key=True)


class Attempt(Base):
    """One claim of a step, and what became of it."""

    __tablename__ = "attempt"
    __table_args__ = (
        Index(
            "ix_attempt_uncounted",
            "ended_at",
            sqlite_where=text("counted = 0"),
            postgresql_where=text("NOT counted"),
        ),
    )

    step_id: Mapped[str] = mapped_column(ForeignKey("step.id", ondelete="CASCADE"), primary_key=True)
    token: Mapped[int] = mapped_column(primary_key=True)
    worker_id: Mapped[str] = mapped_column(Id)
    pid: Mapped[int | None]
    started_at: Mapped[float]
    ended_at: Mapped[float | None]
    outcome: Mapped[str | None] = mapped_column(Word)
    exit_code: Mapped[int | None]
    error: Mapped[dict[str, Any] | None]
    log_key: Mapped[str | None] = mapped_column(String(255))
    max_rss_bytes: Mapped[int | None] = mapped_column(BigInteger)
    counted: Mapped[bool] = mapped_column(default=False, server_default=false())
    """Whether `meters` has added it to the totals."""


class Artifact(Base):
    """Stored bytes, named by their digest."""

    __tablename__ = "artifact"

    digest: Mapped[str] = mapped_column(Digest, primary_key=True)
    size: Mapped[int] = mapped_column(BigInteger)
    media_type: Mapped[str] = mapped_column(String(127))
    state: Mapped[str] = mapped_column(Word)
    created_at: Mapped[float]


class ArtifactRef(Base):
    """A step made this artifact in this role; the name is what a user saves it as."""

    __tablename__ = "artifact_ref"
    __table_args__ = (Index("ix_artifact_ref_digest", "digest"),)

    step_id: Mapped[str] = mapped_column(ForeignKey("step.id", ondelete="CASCADE"), primary_key=True)
    role: Mapped[str] = mapped_column(String(255), primary_key=True)
    name: Mapped[str] = mapped_column(String(255))
    digest: Mapped[str] = mapped_column(ForeignKey("artifact.digest"))


class Event(Base):
    """What happened, append-only: replayed, the events give the present states."""

    __tablename__ = "event"
    __table_args__ = (
        Index("ix_event_scan_id_id", "scan_id", "id"),
        Index("ix_event_transaction_number_id", "transaction_number", "id"),
    )

    id: Mapped[int] = mapped_column(Counter, primary_key=True, autoincrement=True)
    scan_id: Mapped[str] = mapped_column(ForeignKey("scan.id", ondelete="CASCADE"))
    step_id: Mapped[str | None] = mapped_column(Id)
    generation: Mapped[int]
    from_state: Mapped[str | None] = mapped_column(Word)
    to_state: Mapped[str] = mapped_column(Word)
    reason: Mapped[str] = mapped_column(String(64), default="")
    at: Mapped[float]
    transaction_number: Mapped[int] = mapped_column(BigInteger, default=transaction_number(), server_default="0")
    """PostgreSQL's number of the transaction that wrote it: ids alone are not in the order of the commits."""


class Worker(Base):
    """A worker process: which queues it serves, with how many slots, and until when it counts as alive."""

    __tablename__ = "worker"

    id: Mapped[str] = mapped_column(Id, primary_key=True)
    host: Mapped[str] = mapped_column(String(255))
    pid: Mapped[int]
    queues: Mapped[str] = mapped_column(String(255))
    """Separated by commas, sorted."""
    slots: Mapped[int]
    state: Mapped[str] = mapped_column(Word)
    lease_until: Mapped[float]
    started_at: Mapped[float]


class ResourceSlot(Base):
    """A device of a host that computes one step at a time; it is free when that claim has ended."""

    __tablename__ = "resource_slot"

    host: Mapped[str] = mapped_column(String(255), primary_key=True)
    name: Mapped[str] = mapped_column(Word, primary_key=True)
    """`gpu:0`, `gpu:1` …"""
    step_id: Mapped[str | None] = mapped_column(Id)
    token: Mapped[int] = mapped_column(default=0)


class Chore(Base):
    """When something that one worker does for all was last begun."""

    __tablename__ = "chore"

    name: Mapped[str] = mapped_column(Word, primary_key=True)
    begun_at: Mapped[float]


class Meter(Base):
    """A total that only grows, whatever is deleted: what Prometheus calls a counter. See `meters`."""

    __tablename__ = "meter"

    name: Mapped[str] = mapped_column(String(64), primary_key=True)
    labels: Mapped[str] = mapped_column(String(255), primary_key=True)
    """`label=value` joined by commas, in the order of the counter's labels."""
    value: Mapped[float]


class IdempotencyKey(Base):
    """The scan that an Idempotency-Key made, and the digest of the body it came with."""

    __tablename__ = "idempotency_key"

    owner: Mapped[str] = mapped_column(String(64), primary_key=True)
    key: Mapped[str] = mapped_column(String(255), primary_key=True)
    body_digest: Mapped[str] = mapped_column(Digest)
    scan_id: Mapped[str] = mapped_column(ForeignKey("scan.id", ondelete="CASCADE"))
    created_at: Mapped[float]
