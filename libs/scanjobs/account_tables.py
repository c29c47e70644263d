"""The tables of who may do what, what was sent in, and whom to tell. Rows are plain, as in `tables`."""

from typing import Any

from sqlalchemy import JSON, BigInteger, ForeignKey, Index, String, Text, UniqueConstraint
from sqlalchemy.orm import Mapped, mapped_column

from scanjobs.table_base import Base, Counter, Digest, Id, Word


class Owner(Base):
    """Whose scans they are; `weight` is the share of the slots when several wait."""

    __tablename__ = "owner"

    id: Mapped[str] = mapped_column(String(64), primary_key=True)
    weight: Mapped[float] = mapped_column(default=1.0)
    quota_bytes: Mapped[int | None] = mapped_column(BigInteger)
    """Most bytes of uploads and captures; None is the service's own limit."""
    created_at: Mapped[float]


class ApiKey(Base):
    """A key that lets its bearer act for its owner. Only the digest of its secret is stored."""

    __tablename__ = "api_key"
    __table_args__ = (UniqueConstraint("secret_sha256"), Index("ix_api_key_owner_id", "owner", "id"))

    id: Mapped[str] = mapped_column(Id, primary_key=True)
    owner: Mapped[str] = mapped_column(ForeignKey("owner.id", ondelete="CASCADE"))
    name: Mapped[str] = mapped_column(String(64))
    secret_sha256: Mapped[str] = mapped_column(Digest)
    scopes: Mapped[str] = mapped_column(String(64))
    """Separated by commas, sorted."""
    requests_per_minute: Mapped[int | None]
    """None is the service's own limit."""
    created_at: Mapped[float]
    expires_at: Mapped[float | None]
    revoked_at: Mapped[float | None]
    last_used_at: Mapped[float | None]
    rotated_to: Mapped[str | None] = mapped_column(Id)


class ServiceSecret(Base):
    """A random secret that all processes of a service share; cursors are signed with one."""

    __tablename__ = "service_secret"

    name: Mapped[str] = mapped_column(Word, primary_key=True)
    value: Mapped[str] = mapped_column(String(128))
    created_at: Mapped[float]


class Capture(Base):
    """Pictures or clouds that were sent in; a scan's source names it as `capture:ID`."""

    __tablename__ = "capture"
    __table_args__ = (Index("ix_capture_owner_id", "owner", "id"),)

    id: Mapped[str] = mapped_column(Id, primary_key=True)
    owner: Mapped[str] = mapped_column(String(64))
    name: Mapped[str] = mapped_column(String(64))
    kind: Mapped[str] = mapped_column(Word)
    files: Mapped[int]
    size: Mapped[int] = mapped_column(BigInteger)
    digest: Mapped[str] = mapped_column(Digest)
    """Of the sorted list of names and digests of its files."""
    facts: Mapped[dict[str, Any] | None]
    created_at: Mapped[float]


class Upload(Base):
    """A file on its way in; `received` never runs ahead of what is safely on disk."""

    __tablename__ = "upload"
    __table_args__ = (Index("ix_upload_owner_id", "owner", "id"), Index("ix_upload_expires_at", "expires_at"))

    id: Mapped[str] = mapped_column(Id, primary_key=True)
    owner: Mapped[str] = mapped_column(String(64))
    name: Mapped[str] = mapped_column(String(255))
    media_type: Mapped[str] = mapped_column(String(127))
    length: Mapped[int] = mapped_column(BigInteger)
    received: Mapped[int] = mapped_column(BigInteger, default=0)
    state: Mapped[str] = mapped_column(Word)
    digest: Mapped[str | None] = mapped_column(Digest)
    upload_metadata: Mapped[str] = mapped_column(Text, default="")
    """As the client sent it, for it to read again."""
    capture_id: Mapped[str | None] = mapped_column(ForeignKey("capture.id", ondelete="SET NULL"))
    created_at: Mapped[float]
    expires_at: Mapped[float]


class WebhookEndpoint(Base):
    """An address that is told what happens to an owner's scans."""

    __tablename__ = "webhook_endpoint"
    __table_args__ = (Index("ix_webhook_endpoint_owner_id", "owner", "id"),)

    id: Mapped[str] = mapped_column(Id, primary_key=True)
    owner: Mapped[str] = mapped_column(String(64))
    url: Mapped[str] = mapped_column(Text)
    description: Mapped[str] = mapped_column(String(255), default="")
    types: Mapped[list[str]] = mapped_column(JSON(none_as_null=True))
    """Types of message it wants; empty is every type."""
    secret: Mapped[str] = mapped_column(String(128))
    old_secret: Mapped[str | None] = mapped_column(String(128))
    old_secret_until: Mapped[float | None]
    enabled: Mapped[bool] = mapped_column(default=True)
    created_at: Mapped[float]


class WebhookDelivery(Base):
    """A message for one endpoint: written with what it tells of, sent until it arrives or its day is over."""

    __tablename__ = "webhook_delivery"
    __table_args__ = (
        Index("ix_webhook_delivery_endpoint_id_id", "endpoint_id", "id"),
        Index("ix_webhook_delivery_state_next_at", "state", "next_at"),
    )

    id: Mapped[str] = mapped_column(Id, primary_key=True)
    endpoint_id: Mapped[str] = mapped_column(ForeignKey("webhook_endpoint.id", ondelete="CASCADE"))
    type: Mapped[str] = mapped_column(String(64))
    payload: Mapped[dict[str, Any]]
    state: Mapped[str] = mapped_column(Word)
    attempts: Mapped[int] = mapped_column(default=0)
    token: Mapped[int] = mapped_column(default=0)
    """Fences: grows with every claim."""
    next_at: Mapped[float]
    """When it is sent next; of one being sent, when somebody else may take it."""
    give_up_at: Mapped[float]
    created_at: Mapped[float]
    delivered_at: Mapped[float | None]


class WebhookAttempt(Base):
    """One try to deliver, and what came back."""

    __tablename__ = "webhook_attempt"

    delivery_id: Mapped[str] = mapped_column(ForeignKey("webhook_delivery.id", ondelete="CASCADE"), primary_key=True)
    number: Mapped[int] = mapped_column(primary_key=True)
    at: Mapped[float]
    took_s: Mapped[float]
    status: Mapped[int | None]
    error: Mapped[str | None] = mapped_column(String(255))
    answer: Mapped[str] = mapped_column(String(500), default="")
    """The beginning of what the endpoint said."""


class LogLine(Base):
    """A line that a step wrote while it was computed."""

    __tablename__ = "log_line"
    __table_args__ = (Index("ix_log_line_scan_id_id", "scan_id", "id"),)

    id: Mapped[int] = mapped_column(Counter, primary_key=True, autoincrement=True)
    scan_id: Mapped[str] = mapped_column(ForeignKey("scan.id", ondelete="CASCADE"))
    step_id: Mapped[str | None] = mapped_column(Id)
    token: Mapped[int]
    level: Mapped[str] = mapped_column(Word)
    text: Mapped[str] = mapped_column(Text)
    at: Mapped[float]
