"""Captures: made of uploads, or of one zip file that is streamed in; a scan's source names one as `capture:ID`."""

import shutil
from functools import partial
from typing import Annotated

from fastapi import APIRouter, Header, Path, Query, Request, Response
from scanjobs.account_tables import Capture
from scanjobs.captures import (
    Assembled,
    assemble,
    assemble_archive,
    folder_of,
    get_capture,
    insert_capture,
    list_captures,
    members_of,
    remove_capture,
)
from scanjobs.uploads import check_room, create_upload, file_of, remove_upload
from sqlalchemy.orm import Session
from starlette.concurrency import run_in_threadpool

from services.api.arrivals import receive_into
from services.api.dependencies import Owner, Parts, Submitter, TheParts, uuid_of
from services.api.errors import RequestRefused
from services.api.schemas_uploads import CaptureDetail, CapturePage, CaptureRequest, Kind

LIST = "captures"
WHERE = "GET /v1/captures"
CaptureId = Annotated[str, Path(description="Id of a capture.")]
Name = Annotated[str, Query(min_length=1, max_length=64, pattern=r"^[^\x00-\x1f\x7f]+$")]
router = APIRouter(prefix="/v1/captures", tags=["captures"])


@router.post("", status_code=201)
def create(asked: CaptureRequest, parts: TheParts, owner: Submitter, response: Response) -> CaptureDetail:
    """Put a capture together of uploads, after looking at every file; 422 names the one that cannot be used."""
    wanted = [(asked.archive, None)] if asked.archive else [(file.upload, file.name) for file in asked.files or ()]
    with parts.store.read() as session:
        members = members_of(session, wanted, owner=owner)
    if asked.archive:
        assembled = assemble_archive(parts.settings, file_of(parts.settings, members[0].upload_id), asked.kind)
    else:
        assembled = assemble(parts.settings, members, asked.kind)
    ids = [member.upload_id for member in members]
    capture = _keep(parts, assembled, owner, asked.name, asked.kind, ids)
    response.headers["Location"] = f"/v1/captures/{capture.id}"
    return CaptureDetail.of(capture)


@router.post("/archive", status_code=201)
async def create_of_archive(
    request: Request,
    parts: TheParts,
    owner: Submitter,
    response: Response,
    length: Annotated[int, Header(alias="Content-Length", ge=1, include_in_schema=False)],
    name: Name = "capture",
    kind: Annotated[Kind, Query()] = "capture",
) -> CaptureDetail:
    """Stream a zip file in and make it a capture in one request; for one that survives broken lines use uploads."""
    if request.headers.get("content-type") not in ("application/zip", "application/x-zip-compressed"):
        hint = "Content-Type: application/zip"
        raise RequestRefused(415, "UNSUPPORTED_MEDIA_TYPE", "The body is no zip file.", hint=hint)
    make = partial(
        create_upload,
        settings=parts.settings,
        owner=owner,
        name="archive.zip",
        media_type="application/zip",
        length=length,
    )
    upload = await run_in_threadpool(parts.store.write, make)
    try:
        upload = await receive_into(request, parts, upload, None)
        if upload.received < length:
            raise RequestRefused(400, "INCOMPLETE_BODY", "The connection broke.", hint="Send it again, or use uploads.")
        capture = await run_in_threadpool(_unpack, parts, owner, upload.id, name, kind)
    finally:
        forget = partial(remove_upload, settings=parts.settings, upload_id=upload.id, owner=owner)
        await run_in_threadpool(parts.store.write, forget)
    response.headers["Location"] = f"/v1/captures/{capture.id}"
    return CaptureDetail.of(capture)


@router.get("")
def list_(
    parts: TheParts,
    owner: Owner,
    cursor: Annotated[str | None, Query(max_length=512)] = None,
    limit: Annotated[int, Query(ge=1, le=200)] = 50,
) -> CapturePage:
    """Captures, the newest first."""
    before = cursor and parts.cursors.read(cursor, owner=owner, list_name=LIST)
    with parts.store.read() as session:
        found = list_captures(session, owner=owner, before=before, limit=limit + 1)
    more = parts.cursors.write(found[limit - 1].id, owner=owner, list_name=LIST) if len(found) > limit else None
    return CapturePage(items=[CaptureDetail.of(row) for row in found[:limit]], next_cursor=more)


@router.get("/{capture_id}")
def show(capture_id: CaptureId, parts: TheParts, owner: Owner) -> CaptureDetail:
    """One capture."""
    with parts.store.read() as session:
        return CaptureDetail.of(get_capture(session, uuid_of(capture_id, "capture", WHERE), owner=owner))


@router.delete("/{capture_id}", status_code=204)
def delete(capture_id: CaptureId, parts: TheParts, owner: Submitter) -> None:
    """Forget a capture and its files. 409 while a scan reads it."""
    which = uuid_of(capture_id, "capture", WHERE)
    folder = folder_of(parts.settings, which)
    parts.store.write(lambda session: remove_capture(session, which, owner=owner, folder=folder))
    shutil.rmtree(folder, ignore_errors=True)


def _unpack(parts: Parts, owner: str, upload_id: str, name: str, kind: Kind) -> Capture:
    assembled = assemble_archive(parts.settings, file_of(parts.settings, upload_id), kind)
    return _keep(parts, assembled, owner, name, kind, ())


def _keep(
    parts: Parts, assembled: Assembled, owner: str, name: str, kind: Kind, uploads: list[str] | tuple[str, ...]
) -> Capture:
    """Commit the capture; where that fails its folder goes, else its uploads' files go."""

    def work(session: Session) -> Capture:
        check_room(session, parts.settings, owner=owner, more=0 if uploads else assembled.size)
        return insert_capture(session, assembled, owner=owner, name=name, kind=kind, uploads=uploads)

    try:
        capture = parts.store.write(work)
    except Exception:
        shutil.rmtree(folder_of(parts.settings, assembled.id), ignore_errors=True)
        raise
    for upload_id in uploads:
        file_of(parts.settings, upload_id).unlink(missing_ok=True)
    return capture
