"""Scans on their way in: many submissions stored in one transaction, whose cost they share.

Only what plans itself comes this way: a simulation says how many frames it has, so the rows of its steps follow from
its own and are left to the next tick of any worker. What is promised by the commit is the same, at a twentieth of its
price; and a commit for thirty-two submissions costs little more than for one (group commit, DeWitt et al. 1984).
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from nerfmodal.spec import ScanSpec, SimulationSource
from sqlalchemy import insert, select, tuple_
from sqlalchemy.orm import Session, selectinload
from sqlalchemy.orm.attributes import set_committed_value

from scanjobs.clock import now_s
from scanjobs.errors import IdempotencyConflict, NotFound, ScanjobsError
from scanjobs.states import ScanState
from scanjobs.tables import IdempotencyKey, Scan, ScanTag, table_of
from scanjobs.transitions import born_queued
from scanjobs.uuids import new_id

Row = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Idempotency:
    """A client's Idempotency-Key and the digest of the body it came with."""

    key: str
    body_digest: str


@dataclass(frozen=True, slots=True)
class Submission:
    """The scan of a request; `created` is False when the same request had made it before."""

    scan: Scan
    created: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Asked:
    """A simulation that somebody submits; `document` is its specification as JSON, `digest` that of `spec`."""

    spec: ScanSpec
    document: Mapping[str, Any]
    digest: str
    owner: str
    idempotency: Idempotency | None = None
    traceparent: str | None = None

    @property
    def name(self) -> tuple[str, str] | None:
        """What no two submissions of one transaction may share."""
        return (self.owner, self.idempotency.key) if self.idempotency else None


Answer = Submission | ScanjobsError
"""A submission is refused for itself alone."""


def insert_asked(session: Session, asked: Sequence[Asked]) -> tuple[Answer, ...]:
    """Store simulations whose names differ; the answers in the same order.

    The error of an answer is `IdempotencyConflict` (the key came with another body before) or `NotFound` (what it made
    has been deleted). Raises SQLAlchemy's IntegrityError, with nothing stored, where another transaction took a key.
    """
    known = _known_keys(session, asked)
    new = [one for one in asked if one.name not in known]
    stored = iter(_insert(session, new))
    earlier = _scans_of(session, known.values())
    return tuple(_again(one, known[one.name], earlier) if one.name in known else next(stored) for one in asked)


def scan_values(spec: ScanSpec, scan_id: str, owner: str) -> Row:
    """The columns of a new scan that follow from its specification and its owner."""
    return _values_of(spec, spec.model_dump(mode="json"), spec.digest(), scan_id, owner)


def tag_values(spec: ScanSpec, scan_id: str) -> list[Row]:
    """The rows of a scan's tags."""
    return [{"scan_id": scan_id, "tag": tag} for tag in sorted(set(spec.tags))]


def key_values(owner: str, idempotency: Idempotency, scan_id: str) -> Row:
    """The row that remembers a key, but for its time."""
    return {"owner": owner, "key": idempotency.key, "body_digest": idempotency.body_digest, "scan_id": scan_id}


def another_body(key: str) -> IdempotencyConflict:
    """The refusal of a key that was used for something else."""
    message = f"the Idempotency-Key {key!r} came with another body before."
    return IdempotencyConflict(message, hint="Use a new key for a new request.")


def _values_of(spec: ScanSpec, document: Mapping[str, Any], digest: str, scan_id: str, owner: str) -> Row:
    return {
        "id": scan_id,
        "owner": owner,
        "root_id": scan_id,
        "name": spec.name,
        "source_kind": spec.source.kind,
        "spec": document,
        "spec_digest": digest,
        "plant": spec.plant.id if spec.plant else None,
        "state": ScanState.QUEUED.value,
        "priority": 0,
        "max_failed_frames": spec.max_failed_frames,
        "frames": spec.source.frames if isinstance(spec.source, SimulationSource) else None,
        "unplanted_from": None,
        "generation": 0,
        "version": 0,
        "cancel_seq": 0,
    }


def _insert(session: Session, asked: Sequence[Asked]) -> list[Submission]:
    """One statement a table, whatever the number of submissions."""
    if not asked:
        return []
    now = session.scalars(select(now_s())).one()
    rows = [_scan_row(one, new_id(), now) for one in asked]
    tags = [tag for one, row in zip(asked, rows, strict=True) for tag in tag_values(one.spec, row["id"])]
    keys = [
        key_values(one.owner, one.idempotency, row["id"]) | {"created_at": now}
        for one, row in zip(asked, rows, strict=True)
        if one.idempotency
    ]
    for entity, values in ((Scan, rows), (ScanTag, tags), (IdempotencyKey, keys)):
        if values:
            session.execute(insert(table_of(entity)), values)
    scans = [_scan_of(row, one) for row, one in zip(rows, asked, strict=True)]
    born_queued(session, scans, now)
    return [Submission(scan, created=True) for scan in scans]


def _scan_row(one: Asked, scan_id: str, now: float) -> Row:
    limit = one.spec.deadline_s
    return _values_of(one.spec, one.document, one.digest, scan_id, one.owner) | {
        "unplanted_from": 0,
        "deadline_at": None if limit is None else now + limit,
        "created_at": now,
        "traceparent": one.traceparent,
    }


def _scan_of(row: Row, one: Asked) -> Scan:
    """The scan as it was written, which saves looking at it again."""
    scan = Scan(**row)
    set_committed_value(scan, "tags", [ScanTag(**tag) for tag in tag_values(one.spec, row["id"])])
    return scan


def _known_keys(session: Session, asked: Sequence[Asked]) -> dict[tuple[str, str] | None, IdempotencyKey]:
    names = [one.name for one in asked if one.name is not None]
    if not names:
        return {}
    query = select(IdempotencyKey).where(tuple_(IdempotencyKey.owner, IdempotencyKey.key).in_(names))
    return {(row.owner, row.key): row for row in session.scalars(query)}


def _scans_of(session: Session, keys: Iterable[IdempotencyKey]) -> dict[str, Scan]:
    ids = [row.scan_id for row in keys]
    if not ids:
        return {}
    query = select(Scan).where(Scan.id.in_(ids), Scan.state != ScanState.DELETED).options(selectinload(Scan.tags))
    return {scan.id: scan for scan in session.scalars(query)}


def _again(one: Asked, known: IdempotencyKey, earlier: Mapping[str, Scan]) -> Answer:
    assert one.idempotency is not None
    if known.body_digest != one.idempotency.body_digest:
        return another_body(one.idempotency.key)
    scan = earlier.get(known.scan_id)
    if scan is None:
        return NotFound(f"there is no scan {known.scan_id}.", hint="List your scans with GET /v1/scans.")
    return Submission(scan, created=False)
