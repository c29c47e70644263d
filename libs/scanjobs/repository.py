"""What the API asks of the database: submit, look, list. Every function takes the caller's session; the caller commits.

Everything is asked in the name of an owner: what belongs to somebody else is `NotFound`.
"""

import base64
import binascii
import json
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from uuid import UUID

from nerfmodal.spec import ScanSpec
from sqlalchemy import Select, func, insert, or_, select
from sqlalchemy.orm import Session, selectinload

from scanjobs.clock import now_s
from scanjobs.errors import InvalidCursor, NotFound
from scanjobs.fanin import plant_rest, take_over_ready
from scanjobs.intake import Idempotency as Idempotency
from scanjobs.intake import Submission as Submission
from scanjobs.intake import another_body, key_values, scan_values, tag_values
from scanjobs.messages import EXTRACT, IDENTIFY, KINDS, READ, RENDER, TRAIN
from scanjobs.plan import WHOLE_SCAN, first_steps
from scanjobs.planting import plant
from scanjobs.settling import settle
from scanjobs.states import ScanState, StepState
from scanjobs.tables import Artifact, ArtifactRef, Event, IdempotencyKey, Scan, ScanTag, Step, Worker, table_of
from scanjobs.tracing import present
from scanjobs.transitions import born_scans
from scanjobs.uuids import new_id as new_id

LOCAL_OWNER = "local"
HIGHEST_LIMIT = 200


@dataclass(frozen=True, slots=True)
class Page:
    """Scans, newest first, and the cursor of the next page if there is one."""

    items: tuple[Scan, ...]
    next_cursor: str | None


@dataclass(frozen=True, slots=True, kw_only=True)
class KindSummary:
    """How far the steps of one kind are; `fraction` counts what running steps have reported."""

    kind: str
    total: int
    done: int
    running: int
    failed: int
    fraction: float


@dataclass(frozen=True, slots=True, kw_only=True)
class StoredFile:
    """An artifact in the role that a step gave it."""

    step_id: str
    kind: str
    frame: int
    role: str
    name: str
    digest: str
    size: int
    media_type: str


def insert_scan(
    session: Session,
    spec: ScanSpec,
    *,
    owner: str = LOCAL_OWNER,
    priority: int = 0,
    idempotency: Idempotency | None = None,
    fork_of: Scan | None = None,
    deadline_s: float | None = None,
) -> Submission:
    """Store a scan with its plan, all or nothing; `intake` stores many whose plan may wait.

    `fork_of` lets it reuse the steps of that scan that have the same inputs. `deadline_s` counts from now and goes
    before the specification's.

    Raises
    ------
    IdempotencyConflict
        The key came with another body before.
    """
    before = _earlier_submission(session, owner, idempotency) if idempotency else None
    if before is not None:
        return Submission(before, created=False)
    scan = _insert_scan_row(session, spec, owner, priority, fork_of, deadline_s)
    born_scans(session, [scan])
    if scan.frames is None:
        plant(session, scan, first_steps(spec))
        take_over_ready(session, scan)
    else:
        plant_rest(session, scan, scan.frames)
    settle(session, scan)
    if idempotency is not None:
        _remember(session, owner, idempotency, scan)
    return Submission(get_scan(session, scan.id, owner=owner), created=True)


def get_scan(session: Session, scan_id: str, *, owner: str = LOCAL_OWNER) -> Scan:
    """The scan with its tags. Raises `NotFound`."""
    query = select(Scan).where(Scan.id == scan_id, Scan.owner == owner, Scan.state != ScanState.DELETED)
    scan = session.scalars(query.options(selectinload(Scan.tags))).one_or_none()
    if scan is None:
        raise NotFound(f"there is no scan {scan_id}.", hint="List your scans with GET /v1/scans.")
    return scan


def list_scans(
    session: Session,
    *,
    owner: str = LOCAL_OWNER,
    states: Collection[ScanState] = (),
    plant_id: str | None = None,
    tag: str | None = None,
    cursor: str | None = None,
    limit: int = 50,
) -> Page:
    """A page of scans, newest first. Raises `InvalidCursor`."""
    query = select(Scan).where(Scan.owner == owner, Scan.state != ScanState.DELETED)
    if states:
        query = query.where(Scan.state.in_([state.value for state in states]))
    if plant_id is not None:
        query = query.where(Scan.plant == plant_id)
    if tag is not None:
        query = query.join(ScanTag, ScanTag.scan_id == Scan.id).where(ScanTag.tag == tag)
    if cursor is not None:
        query = query.where(Scan.id < _read_cursor(cursor))
    return _page(session, query, min(max(limit, 1), HIGHEST_LIMIT))


def step_summaries(session: Session, scan: Scan) -> tuple[KindSummary, ...]:
    """Done and total of every kind in the scan's present generation, in the order they run."""
    return summaries_of(session, [scan])[scan.id]


def summaries_of(session: Session, scans: Sequence[Scan]) -> dict[str, tuple[KindSummary, ...]]:
    """`step_summaries` of many scans with one query."""
    partial = func.sum(Step.progress_done * 1.0 / func.nullif(Step.progress_total, 0))
    query = (
        select(Step.scan_id, Step.kind, Step.state, func.count(), partial)
        .join(Scan, Scan.id == Step.scan_id)
        .where(Step.scan_id.in_([scan.id for scan in scans]), Step.generation == Scan.generation)
        .where(or_(Step.kind != IDENTIFY, Step.frame == WHOLE_SCAN))
        .group_by(Step.scan_id, Step.kind, Step.state)
    )
    counts: dict[str, dict[str, dict[str, tuple[int, float]]]] = {scan.id: {} for scan in scans}
    for scan_id, kind, state, count, share in session.execute(query):
        counts[scan_id].setdefault(kind, {})[state] = (count, float(share or 0.0))
    return {scan.id: _summarise(counts[scan.id], _unplanted(scan)) for scan in scans}


def summaries_of_plan(scan: Scan) -> tuple[KindSummary, ...]:
    """`step_summaries` of a scan that has no step yet."""
    return _summarise({}, _unplanted(scan))


def list_steps(session: Session, scan: Scan, *, generation: int | None = None) -> tuple[Step, ...]:
    """The steps of a generation (the present one by default), in the order they may run."""
    chosen = scan.generation if generation is None else generation
    query = select(Step).where(Step.scan_id == scan.id, Step.generation == chosen)
    return tuple(session.scalars(query.order_by(Step.depth, Step.frame)))


def list_artifacts(session: Session, scan: Scan, *, kind: str | None = None) -> tuple[StoredFile, ...]:
    """Every file that the scan's present generation has made."""
    query = _files_of(scan)
    if kind is not None:
        query = query.where(Step.kind == kind)
    return tuple(_stored_file(row) for row in session.execute(query))


def find_artifact(
    session: Session, scan: Scan, role: str, *, kind: str | None = None, frame: int | None = None
) -> StoredFile:
    """The file of a role, the last made if several steps have it. Raises `NotFound`."""
    query = _files_of(scan).where(ArtifactRef.role == role)
    if kind is not None:
        query = query.where(Step.kind == kind)
    if frame is not None:
        query = query.where(Step.frame == frame)
    rows = session.execute(query).all()
    if not rows:
        raise NotFound(f"the scan {scan.id} has no {role} yet.", hint="Wait until the scan has succeeded.")
    return _stored_file(rows[-1])


def list_events(session: Session, scan: Scan, *, after: int = 0, limit: int = 500) -> tuple[Event, ...]:
    """What happened to the scan and its steps after the event `after`, oldest first."""
    query = select(Event).where(Event.scan_id == scan.id, Event.id > after)
    return tuple(session.scalars(query.order_by(Event.id).limit(limit)))


def list_workers(session: Session) -> tuple[Worker, ...]:
    """The workers that are alive by the database's clock."""
    return tuple(session.scalars(select(Worker).where(Worker.lease_until > now_s()).order_by(Worker.id)))


def _insert_scan_row(
    session: Session, spec: ScanSpec, owner: str, priority: int, fork_of: Scan | None, deadline_s: float | None
) -> Scan:
    scan_id = new_id()
    limit = spec.deadline_s if deadline_s is None else deadline_s
    values = scan_values(spec, scan_id, owner) | {
        "root_id": fork_of.root_id if fork_of else scan_id,
        "priority": priority,
        "deadline_at": None if limit is None else now_s() + limit,
        "created_at": now_s(),
        "traceparent": present(),
    }
    session.execute(insert(table_of(Scan)).values(values))
    tags = tag_values(spec, scan_id)
    if tags:
        session.execute(insert(table_of(ScanTag)), tags)
    return get_scan(session, scan_id, owner=owner)


def _earlier_submission(session: Session, owner: str, idempotency: Idempotency) -> Scan | None:
    known = session.get(IdempotencyKey, (owner, idempotency.key))
    if known is None:
        return None
    if known.body_digest != idempotency.body_digest:
        raise another_body(idempotency.key)
    return get_scan(session, known.scan_id, owner=owner)


def _remember(session: Session, owner: str, idempotency: Idempotency, scan: Scan) -> None:
    values = key_values(owner, idempotency, scan.id) | {"created_at": now_s()}
    session.execute(insert(table_of(IdempotencyKey)).values(values))


def _page(session: Session, query: Select[Scan], limit: int) -> Page:
    query = query.options(selectinload(Scan.tags)).order_by(Scan.id.desc()).limit(limit + 1)
    rows = tuple(session.scalars(query))
    items = rows[:limit]
    return Page(items, _write_cursor(items[-1].id) if len(rows) > limit else None)


def _write_cursor(scan_id: str) -> str:
    return base64.urlsafe_b64encode(json.dumps({"before": scan_id}).encode()).decode().rstrip("=")


def _read_cursor(cursor: str) -> str:
    try:
        padded = cursor + "=" * (-len(cursor) % 4)
        return str(UUID(json.loads(base64.b64decode(padded, altchars=b"-_", validate=True))["before"]))
    except (ValueError, KeyError, TypeError, AttributeError, binascii.Error) as error:
        raise InvalidCursor(
            "the cursor was not made by this service.", where="cursor", hint="Start again without a cursor."
        ) from error


def _unplanted(scan: Scan) -> dict[str, int]:
    """Steps by kind that the rest of a plan will have."""
    if scan.unplanted_from is None or scan.frames is None:
        return {}
    make = RENDER if scan.source_kind == "simulation" else READ
    left = scan.frames - scan.unplanted_from
    first = 1 if scan.unplanted_from == 0 else 0
    return {make: left, TRAIN: first + left, EXTRACT: left, IDENTIFY: 1}


def _summarise(kinds: dict[str, dict[str, tuple[int, float]]], unplanted: Mapping[str, int]) -> tuple[KindSummary, ...]:
    known = kinds.keys() | unplanted.keys()
    return tuple(_summary(kind, kinds.get(kind, {}), unplanted.get(kind, 0)) for kind in KINDS if kind in known)


def _summary(kind: str, states: dict[str, tuple[int, float]], unplanted: int) -> KindSummary:
    none = (0, 0.0)
    total = unplanted + sum(count for count, _ in states.values())
    done = states.get(StepState.SUCCEEDED, none)[0]
    running, partial = states.get(StepState.RUNNING, none)
    return KindSummary(
        kind=kind,
        total=total,
        done=done,
        running=running,
        failed=states.get(StepState.FAILED, none)[0],
        fraction=(done + partial) / total if total else 0.0,
    )


def _files_of(scan: Scan) -> Select[Step, ArtifactRef, Artifact]:
    return (
        select(Step, ArtifactRef, Artifact)
        .join(ArtifactRef, ArtifactRef.step_id == Step.id)
        .join(Artifact, Artifact.digest == ArtifactRef.digest)
        .where(Step.scan_id == scan.id, Step.generation == scan.generation)
        .order_by(Step.depth, Step.frame, ArtifactRef.role)
    )


def _stored_file(row: Sequence[object]) -> StoredFile:
    step, ref, artifact = row
    assert isinstance(step, Step)
    assert isinstance(ref, ArtifactRef)
    assert isinstance(artifact, Artifact)
    return StoredFile(
        step_id=step.id,
        kind=step.kind,
        frame=step.frame,
        role=ref.role,
        name=ref.name,
        digest=ref.digest,
        size=artifact.size,
        media_type=artifact.media_type,
    )
