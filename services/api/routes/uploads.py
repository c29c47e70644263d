"""Resumable uploads: tus 1.0 with the extensions creation, creation-with-upload, checksum, expiration, termination.

https://tus.io/protocols/resumable-upload
"""

import base64
import binascii
from collections.abc import Mapping
from email.utils import formatdate
from functools import partial
from typing import Annotated, Final

from fastapi import APIRouter, Header, Path, Query, Request, Response
from scanjobs.account_tables import Upload
from scanjobs.media import media_type_of
from scanjobs.uploads import create_upload, list_uploads, remove_expired, remove_upload
from starlette.concurrency import run_in_threadpool

from services.api.arrivals import ALGORITHMS, checksum_of, look_up, receive_into, refuse_gap
from services.api.dependencies import Owner, Submitter, TheParts, uuid_of
from services.api.errors import RequestRefused
from services.api.schemas_uploads import UploadDetail, UploadPage

VERSION: Final = "1.0.0"
EXTENSIONS: Final = "creation,creation-with-upload,checksum,expiration,termination"
BYTES: Final = "application/offset+octet-stream"
LIST: Final = "uploads"
HIGHEST_BYTES: Final = 1 << 53
router = APIRouter(prefix="/v1/uploads", tags=["uploads"])
UploadId = Annotated[str, Path(description="Id of an upload.")]
Resumable = Annotated[str | None, Header(alias="Tus-Resumable", description="1.0.0")]
Length = Annotated[int, Header(alias="Upload-Length", ge=0, le=HIGHEST_BYTES, description="Bytes of the file.")]
Offset = Annotated[int, Header(alias="Upload-Offset", ge=0, le=HIGHEST_BYTES, description="Where these bytes go on.")]
Checksum = Annotated[str | None, Header(alias="Upload-Checksum", max_length=200, description="sha256 BASE64")]
Metadata = Annotated[
    str, Header(alias="Upload-Metadata", max_length=2000, description="filename BASE64,filetype BASE64")
]


@router.options("", status_code=204)
async def offer(parts: TheParts, _: Owner) -> Response:
    """What of tus is spoken here."""
    headers = {
        "Tus-Version": VERSION,
        "Tus-Extension": EXTENSIONS,
        "Tus-Checksum-Algorithm": ",".join(ALGORITHMS),
        "Tus-Max-Size": str(parts.settings.upload_limit_mb * 10**6),
    }
    return _answer(204, headers)


@router.post("", status_code=201, response_class=Response)
async def create(
    request: Request,
    parts: TheParts,
    owner: Submitter,
    length: Length,
    metadata: Metadata = "",
    version: Resumable = None,
    checksum: Checksum = None,
) -> Response:
    """Begin an upload; a body of `application/offset+octet-stream` is its first bytes already."""
    refuse_version(version)
    wanted = checksum_of(checksum)
    said = metadata_of(metadata)
    name = said.get("filename") or "file"
    make = partial(
        create_upload,
        settings=parts.settings,
        owner=owner,
        name=name,
        media_type=said.get("filetype") or media_type_of(name),
        length=length,
        metadata=metadata,
    )
    await run_in_threadpool(parts.store.write, partial(remove_expired, settings=parts.settings))
    upload = await run_in_threadpool(parts.store.write, make)
    if request.headers.get("content-type") == BYTES or length == 0:
        upload = await receive_into(request, parts, upload, wanted)
    return _answer(201, {"Location": f"/v1/uploads/{upload.id}", **_standing(upload)})


@router.get("")
def list_(
    parts: TheParts,
    owner: Owner,
    cursor: Annotated[str | None, Query(max_length=512)] = None,
    limit: Annotated[int, Query(ge=1, le=200)] = 50,
) -> UploadPage:
    """Uploads that have not become a capture, the newest first: what a page that was reloaded goes on with."""
    before = cursor and parts.cursors.read(cursor, owner=owner, list_name=LIST)
    with parts.store.read() as session:
        found = list_uploads(session, owner=owner, before=before, limit=limit + 1)
    more = parts.cursors.write(found[limit - 1].id, owner=owner, list_name=LIST) if len(found) > limit else None
    return UploadPage(items=[UploadDetail.of(row) for row in found[:limit]], next_cursor=more)


@router.get("/{upload_id}")
def show(upload_id: UploadId, parts: TheParts, owner: Owner) -> UploadDetail:
    """How far an upload is, as JSON."""
    return UploadDetail.of(look_up(parts, uuid_of(upload_id, "upload", "GET /v1/uploads"), owner))


@router.head("/{upload_id}", response_class=Response)
def head(upload_id: UploadId, parts: TheParts, owner: Owner, version: Resumable = None) -> Response:
    """How far an upload is, as tus asks for it."""
    refuse_version(version)
    upload = look_up(parts, uuid_of(upload_id, "upload", "GET /v1/uploads"), owner)
    said = {"Upload-Metadata": upload.upload_metadata} if upload.upload_metadata else {}
    return _answer(200, {"Upload-Length": str(upload.length), "Cache-Control": "no-store", **_standing(upload), **said})


@router.patch("/{upload_id}", status_code=204, response_class=Response)
async def append(
    upload_id: UploadId,
    request: Request,
    parts: TheParts,
    owner: Submitter,
    offset: Offset,
    version: Resumable = None,
    checksum: Checksum = None,
) -> Response:
    """Send the next bytes. 409 unless `Upload-Offset` is where the upload stands; 460 where the checksum differs."""
    refuse_version(version)
    if request.headers.get("content-type") != BYTES:
        raise RequestRefused(415, "UNSUPPORTED_MEDIA_TYPE", "The body is no upload.", hint=f"Content-Type: {BYTES}")
    wanted = checksum_of(checksum)
    which = uuid_of(upload_id, "upload", "GET /v1/uploads")
    upload = await run_in_threadpool(look_up, parts, which, owner)
    refuse_gap(upload, offset)
    return _answer(204, _standing(await receive_into(request, parts, upload, wanted)))


@router.delete("/{upload_id}", status_code=204, response_class=Response)
def terminate(upload_id: UploadId, parts: TheParts, owner: Submitter, version: Resumable = None) -> Response:
    """Forget an upload and its bytes; a capture made of it stays."""
    refuse_version(version)
    which = uuid_of(upload_id, "upload", "GET /v1/uploads")
    parts.store.write(lambda session: remove_upload(session, parts.settings, which, owner=owner))
    return _answer(204, {})


def refuse_version(version: str | None) -> None:
    """Raise `RequestRefused` (412) unless the client speaks this version of tus."""
    if version != VERSION:
        headers = {"Tus-Version": VERSION}
        hint = f"Send `Tus-Resumable: {VERSION}`."
        raise RequestRefused(412, "TUS_VERSION", "The client speaks another tus.", hint=hint, headers=headers)


def metadata_of(header: str) -> Mapping[str, str]:
    """`key BASE64,key BASE64` as words. Raises `RequestRefused` for what cannot be read."""
    words: dict[str, str] = {}
    for pair in filter(None, (part.strip() for part in header.split(","))):
        key, _, text = pair.partition(" ")
        try:
            words[key] = base64.b64decode(text, validate=True).decode()
        except (ValueError, binascii.Error) as error:
            hint = "Write `key BASE64,key BASE64`."
            raise RequestRefused(400, "INVALID_METADATA", "The Upload-Metadata cannot be read.", hint=hint) from error
        if (len(words[key]) > 127 and key == "filetype") or len(words[key]) > 255 or "\x00" in words[key]:
            raise RequestRefused(400, "INVALID_METADATA", f"The {key} is too long.", hint="At most 255 characters.")
    return words


def _standing(upload: Upload) -> dict[str, str]:
    return {"Upload-Offset": str(upload.received), "Upload-Expires": formatdate(upload.expires_at, usegmt=True)}


def _answer(status: int, headers: Mapping[str, str]) -> Response:
    return Response(status_code=status, headers={"Tus-Resumable": VERSION, **headers})
