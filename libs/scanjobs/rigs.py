"""Certificates of rigs, kept for their owner: a rig may be certified again, and the newest one speaks for it."""

from collections.abc import Mapping
from typing import Any

from sqlalchemy import Index, String, select
from sqlalchemy.orm import Mapped, Session, mapped_column

from scanjobs.clock import now_s
from scanjobs.errors import NotFound
from scanjobs.table_base import Base, Digest

MOST_LISTED = 200


class RigCertificate(Base):
    """A certificate as `nerfmodal certify` wrote it; `id` and `rig` are digests."""

    __tablename__ = "rig_certificate"
    __table_args__ = (Index("ix_rig_certificate_owner_rig_created_at", "owner", "rig", "created_at"),)

    owner: Mapped[str] = mapped_column(String(64), primary_key=True)
    id: Mapped[str] = mapped_column(Digest, primary_key=True)
    rig: Mapped[str] = mapped_column(Digest)
    document: Mapped[dict[str, Any]]
    created_at: Mapped[float]


def add_certificate(session: Session, document: Mapping[str, Any], *, owner: str) -> RigCertificate:
    """Store a certificate; one that is there already is left as it is."""
    found = session.get(RigCertificate, (owner, document["id"]))
    if found is not None:
        return found
    now = session.scalar(select(now_s()))
    row = RigCertificate(
        owner=owner, id=document["id"], rig=document["rig_digest"], document=dict(document), created_at=now
    )
    session.add(row)
    session.flush()
    return row


def newest_certificate(session: Session, rig: str, *, owner: str) -> RigCertificate:
    """The newest certificate of a rig. Raises `NotFound`."""
    mine = select(RigCertificate).where(RigCertificate.owner == owner, RigCertificate.rig == rig)
    found = session.scalars(mine.order_by(RigCertificate.created_at.desc(), RigCertificate.id).limit(1)).first()
    if found is None:
        raise NotFound("there is no such rig.", hint="List yours with GET /v1/rigs.")
    return found


def find_certificate(session: Session, certificate: str, *, owner: str) -> RigCertificate | None:
    """The certificate of this id, if the owner has it."""
    return session.get(RigCertificate, (owner, certificate))


def list_certificates(session: Session, *, owner: str) -> tuple[RigCertificate, ...]:
    """The newest certificates of all rigs of an owner, at most 200."""
    mine = select(RigCertificate).where(RigCertificate.owner == owner)
    return tuple(session.scalars(mine.order_by(RigCertificate.created_at.desc(), RigCertificate.id).limit(MOST_LISTED)))
