"""Scans: submit, look, list, cancel, retry. Whatever is answered with 2xx has been committed before."""

import hashlib
import json
import math
import re
from collections.abc import Iterator
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Header, Query, Response
from nerfmodal.spec import ScanSpec, SimulationSource
from pydantic import Field
from scanjobs.captures import locate_source
from scanjobs.control import cancel_scan, retry_scan
from scanjobs.intake import Asked, Idempotency, Submission
from scanjobs.pausing import pause_scan, resume_scan
from scanjobs.repository import (
    HIGHEST_LIMIT,
    get_scan,
    insert_scan,
    list_scans,
    step_summaries,
    summaries_of,
    summaries_of_plan,
)
from scanjobs.store import Store
from scanjobs.tables import Scan
from scanjobs.tracing import present
from sqlalchemy.exc import IntegrityError
from sqlalchemy.orm import Session
from starlette.concurrency import run_in_threadpool

from services.api.complaints import json_pointer
from services.api.dependencies import Owner, Parts, ScanId, Submitter, TheParts
from services.api.errors import RequestRefused
from services.api.eta import measure_pace, seconds_left
from services.api.schemas import STATES_OF, ScanDetail, ScanPage, ScanSummary, Status

LOOK_AGAIN_S = "2"
LIST = "scans"
SURROGATE = re.compile("[\ud800-\udfff]")
Key = Annotated[
    str | None,
    Header(
        alias="Idempotency-Key",
        min_length=1,
        max_length=255,
        pattern=r"^[\x21-\x7e]+$",
        description="The same key with the same body answers with the same scan, however often it is sent.",
    ),
]
Word = Annotated[str | None, Query(min_length=1, max_length=64, pattern=r"^[A-Za-z0-9_.-]+$")]
Step = Literal["scan.inspect", "frame.render", "frame.read", "frame.train", "frame.extract", "scan.identify"]
From = Annotated[Step | None, Query(alias="from", description="Compute this kind and all after it afresh.")]
Frames = Annotated[
    list[Annotated[int, Field(ge=0, le=1_000_000)]] | None,
    Query(max_length=1000, description="Of these frames alone, and what depends on them; needs `from`."),
]
router = APIRouter(prefix="/v1/scans", tags=["scans"])


@router.post("", status_code=202)
async def submit(spec: ScanSpec, parts: TheParts, owner: Submitter, response: Response, key: Key = None) -> ScanDetail:
    """Start a scan. The answer names it at once; follow it at `Location`."""
    document, digest = storable(spec)
    idempotency = Idempotency(key, digest) if key else None
    if isinstance(spec.source, SimulationSource):
        asked = Asked(
            spec=spec, document=document, digest=digest, owner=owner, idempotency=idempotency, traceparent=present()
        )
        submission = await parts.intake.submit(asked)
    else:
        submission = await run_in_threadpool(_locate_and_store, parts, spec, owner, idempotency)
    response.headers["Location"] = f"/v1/scans/{submission.scan.id}"
    response.headers["Retry-After"] = LOOK_AGAIN_S
    if submission.created and submission.scan.unplanted_from == 0:
        return ScanDetail.of(submission.scan, summaries_of_plan(submission.scan))
    return await run_in_threadpool(look, parts.store, submission.scan.id, owner)


@router.get("")
def list_(
    parts: TheParts,
    owner: Owner,
    status: Annotated[list[Status] | None, Query()] = None,
    plant: Word = None,
    tag: Word = None,
    cursor: Annotated[str | None, Query(max_length=512)] = None,
    limit: Annotated[int, Query(ge=1, le=HIGHEST_LIMIT)] = 50,
) -> ScanPage:
    """Scans, the newest first; several `status` are joined by or, different filters by and."""
    states = [state for word in status or () for state in STATES_OF[word]]
    inner = cursor and parts.cursors.read(cursor, owner=owner, list_name=LIST)
    with parts.store.read() as session:
        page = list_scans(session, owner=owner, states=states, plant_id=plant, tag=tag, cursor=inner, limit=limit)
        progress = summaries_of(session, page.items)
    items = [ScanSummary.of(scan, progress[scan.id]) for scan in page.items]
    further = page.next_cursor and parts.cursors.write(page.next_cursor, owner=owner, list_name=LIST)
    return ScanPage(items=items, next_cursor=further)


@router.get("/{scan_id}")
def show(scan_id: ScanId, parts: TheParts, owner: Owner) -> ScanDetail:
    """A scan with its progress per kind of step and the seconds it may still take."""
    return look(parts.store, scan_id, owner)


@router.post("/{scan_id}/cancel", status_code=202)
def cancel(scan_id: ScanId, parts: TheParts, owner: Submitter) -> ScanDetail:
    """Stop a scan: what waits is canceled at once, what computes within seconds. 409 when it has ended."""
    parts.store.write(lambda session: cancel_scan(session, scan_id, owner=owner))
    return look(parts.store, scan_id, owner)


@router.post("/{scan_id}/pause", status_code=202)
def pause(scan_id: ScanId, parts: TheParts, owner: Submitter) -> ScanDetail:
    """Begin no more steps of a scan until it is resumed; what computes goes on and counts. 409 when it has ended."""
    parts.store.write(lambda session: pause_scan(session, scan_id, owner=owner))
    return look(parts.store, scan_id, owner)


@router.post("/{scan_id}/resume", status_code=202)
def resume(scan_id: ScanId, parts: TheParts, owner: Submitter) -> ScanDetail:
    """Go on with a paused scan, whatever the cause; while that holds it is paused again. 409 when it has ended."""
    parts.store.write(lambda session: resume_scan(session, scan_id, owner=owner))
    return look(parts.store, scan_id, owner)


@router.post("/{scan_id}/retry", status_code=202)
def retry(
    scan_id: ScanId,
    parts: TheParts,
    owner: Submitter,
    from_step: From = None,
    frames: Frames = None,
) -> ScanDetail:
    """Run an ended scan again: what had not succeeded, or everything from a step on. 409 while it runs."""
    parts.store.write(lambda session: retry_scan(session, scan_id, owner=owner, from_kind=from_step, frames=frames))
    return look(parts.store, scan_id, owner)


def storable(spec: ScanSpec) -> tuple[dict[str, Any], str]:
    """The specification as JSON, and its digest.

    Refuses what Python's JSON reader takes and JSON and UTF-8 cannot hold: NaN, infinity (1e999), half a surrogate.
    """
    try:
        document = spec.model_dump(mode="json")
        text = json.dumps(document, sort_keys=True, separators=(",", ":"), allow_nan=False, ensure_ascii=False)
        data = text.encode()
    except ValueError:
        _refuse_leaf(spec)
        raise
    # canonical JSON escapes what is not ASCII; where there is none the text at hand is that of `ScanSpec.digest`
    return document, hashlib.sha256(data).hexdigest() if text.isascii() else spec.digest()


def refuse_unstorable(spec: ScanSpec) -> None:
    """`storable`, where nothing is stored yet."""
    storable(spec)


def _refuse_leaf(spec: ScanSpec) -> None:
    """Name the field; the quick look above does not."""
    for path, value in _leaves(spec.model_dump(), ()):
        if isinstance(value, float) and not math.isfinite(value):
            raise _unstorable(path, "is not a finite number.")
        if isinstance(value, str) and SURROGATE.search(value):
            raise _unstorable(path, "holds half a surrogate pair.")


def _unstorable(path: tuple[str | int, ...], what: str) -> RequestRefused:
    return RequestRefused(
        422, "INVALID_SPEC", what, pointer=json_pointer(path), hint="Give a value that JSON can hold."
    )


def _leaves(value: Any, path: tuple[str | int, ...]) -> Iterator[tuple[tuple[str | int, ...], Any]]:
    below = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list | tuple) else None
    if below is None:
        yield path, value
        return
    for key, item in below:
        yield from _leaves(item, (*path, key))


def located(parts: Parts, spec: ScanSpec, owner: str) -> ScanSpec:
    """The specification with its source as every worker can open it."""
    if isinstance(spec.source, SimulationSource):
        return spec
    with parts.store.read() as session:
        return locate_source(session, parts.settings, spec, owner=owner)


def _locate_and_store(parts: Parts, spec: ScanSpec, owner: str, idempotency: Idempotency | None) -> Submission:
    return store_scan(parts, located(parts, spec, owner), owner, idempotency)


def store_scan(
    parts: Parts, spec: ScanSpec, owner: str, idempotency: Idempotency | None, fork_of: Scan | None = None
) -> Submission:
    """Commit a scan with its plan. Where another request has just used the key, the second try finds that scan."""

    def work(session: Session) -> Submission:
        return insert_scan(session, spec, owner=owner, idempotency=idempotency, fork_of=fork_of)

    try:
        return parts.store.write(work)
    except IntegrityError:
        return parts.store.write(work)


def look(store: Store, scan_id: str, owner: str) -> ScanDetail:
    """The scan as it is now. Raises `NotFound`."""
    with store.read() as session:
        scan = get_scan(session, scan_id, owner=owner)
        progress = step_summaries(session, scan)
        eta_s = seconds_left(progress, measure_pace(session, scan)) if scan.finished_at is None else None
    return ScanDetail.of(scan, progress, eta_s)
