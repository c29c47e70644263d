"""What happens, as it happens: server-sent events, resumable with `Last-Event-ID` from the append-only event table.

::

    id: 0-17                      where to go on from
    event: step                   or: scan, progress, ping
    data: {"scan": …, "kind": "frame.train", "frame": 3, "from": "sent", "to": "running", …}
"""

import json
from collections.abc import AsyncIterator
from functools import partial
from typing import Annotated, Any, Final

from fastapi import APIRouter, Header, Query, Request
from fastapi.responses import StreamingResponse
from scanjobs.event_log import BEGINNING, Happening, Place, last_place, read_events
from scanjobs.owners import is_alive
from scanjobs.repository import get_scan
from scanjobs.scopes import Principal
from starlette.concurrency import run_in_threadpool

from services.api.dependencies import Owner, Parts, ScanId, TheParts, ThePrincipal
from services.api.errors import RequestRefused
from services.api.news import Listener, Progress
from services.api.schemas import StepProgress, instant

SILENCE_S: Final = 15.0
"""After so long without news a ping tells proxies that the line lives; the key is looked at again, too."""
RECONNECT_MS: Final = 1000
BATCH: Final = 200
Resume = Annotated[
    str | None, Header(alias="Last-Event-ID", max_length=64, description="Id of the last event that was seen.")
]
After = Annotated[
    str | None,
    Query(max_length=64, description="The same, for who cannot set headers; `now` leaves out what has happened."),
]
NOW: Final = "now"
STREAM: Final = "text/event-stream"
RESPONSES: Final[dict[int | str, dict[str, Any]]] = {200: {"content": {STREAM: {"schema": {"type": "string"}}}}}
router = APIRouter(prefix="/v1", tags=["events"])


@router.get("/scans/{scan_id}/events", response_class=StreamingResponse, responses=RESPONSES)
async def of_scan(
    request: Request,
    scan_id: ScanId,
    parts: TheParts,
    owner: Owner,
    principal: ThePrincipal,
    resume: Resume = None,
    after: After = None,
) -> StreamingResponse:
    """Every event of a scan and its steps from its beginning (or from behind the one named), then what comes."""
    await run_in_threadpool(_look_up, parts, scan_id, owner)
    place = await _place(parts, resume or after or str(BEGINNING))
    return _answer(request, parts, principal, owner, scan_id, place, steps=True)


@router.get("/events", response_class=StreamingResponse, responses=RESPONSES)
async def of_all(
    request: Request,
    parts: TheParts,
    owner: Owner,
    principal: ThePrincipal,
    resume: Resume = None,
    after: After = None,
    steps: Annotated[bool, Query(description="Those of steps too.")] = False,
) -> StreamingResponse:
    """Events of all scans from now on, or from behind the one named."""
    place = await _place(parts, resume or after or NOW)
    return _answer(request, parts, principal, owner, None, place, steps=steps)


async def _place(parts: Parts, given: str) -> Place:
    return await run_in_threadpool(_now, parts) if given == NOW else Place.parse(given)


def _answer(
    request: Request, parts: Parts, principal: Principal, owner: str, scan_id: str | None, place: Place, *, steps: bool
) -> StreamingResponse:
    if parts.news.is_full:
        detail = "Too many pages are listening already."
        raise RequestRefused(429, "TOO_MANY_REQUESTS", detail, hint="Close some.", headers={"Retry-After": "30"})
    stream = _Stream(parts, principal, owner, scan_id, place, steps)
    headers = {"Cache-Control": "no-store", "X-Accel-Buffering": "no"}
    return StreamingResponse(stream.lines(request), media_type=STREAM, headers=headers)


class _Stream:
    """One reader, and where it stands."""

    def __init__(
        self, parts: Parts, principal: Principal, owner: str, scan_id: str | None, place: Place, steps: bool
    ) -> None:
        self._parts = parts
        self._principal = principal
        self._owner = owner
        self._scan_id = scan_id
        self._place = place
        self._steps = steps
        self._progress: Progress = ()

    async def lines(self, request: Request) -> AsyncIterator[str]:
        """The text of the stream; it ends when the key does, or the reader goes."""
        async with self._parts.news.listening(self._owner, self._scan_id) as listener:
            yield f"retry: {RECONNECT_MS}\nid: {self._place}\nevent: ping\ndata: {{}}\n\n"
            while not await request.is_disconnected():
                async for text in self._news(listener):
                    yield text
                if not await listener.wait(SILENCE_S):
                    if not await run_in_threadpool(self._may_go_on):
                        return
                    yield f"id: {self._place}\nevent: ping\ndata: {{}}\n\n"

    async def _news(self, listener: Listener) -> AsyncIterator[str]:
        while True:
            found = await run_in_threadpool(self._read)
            for one in found:
                self._place = one.place
                yield text_of(one)
            if len(found) < BATCH:
                break
        if listener.progress != self._progress:
            self._progress = listener.progress
            rows = [StepProgress.of(row).model_dump() for row in self._progress]
            yield f"event: progress\ndata: {json.dumps({'scan': self._scan_id, 'progress': rows})}\n\n"

    def _read(self) -> tuple[Happening, ...]:
        asked = partial(read_events, owner=self._owner, scan_id=self._scan_id, steps=self._steps, limit=BATCH)
        with self._parts.store.read() as session:
            return asked(session, self._place)

    def _may_go_on(self) -> bool:
        key_id = self._principal.key_id
        if key_id is None:
            return True
        with self._parts.store.read() as session:
            return is_alive(session, key_id)


def text_of(one: Happening) -> str:
    """An event as the lines of the stream."""
    at = instant(one.at)
    document = {
        "scan": one.scan_id,
        "step": one.step_id,
        "kind": one.kind,
        "frame": one.frame,
        "generation": one.generation,
        "from": one.before,
        "to": one.after,
        "reason": one.reason,
        "at": at.isoformat() if at else None,
    }
    kind = "scan" if one.step_id is None else "step"
    return f"id: {one.place}\nevent: {kind}\ndata: {json.dumps(document)}\n\n"


def _look_up(parts: Parts, scan_id: str, owner: str) -> None:
    with parts.store.read() as session:
        get_scan(session, scan_id, owner=owner)


def _now(parts: Parts) -> Place:
    with parts.store.read() as session:
        return last_place(session)
