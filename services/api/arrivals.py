"""Bytes from a request's body into an upload's file, as they come: nothing is held but one block.

What has arrived when the connection breaks stays; the client asks how far the upload is and goes on from there.
"""

import base64
import binascii
import hashlib
from collections.abc import AsyncIterator
from dataclasses import dataclass
from functools import partial
from typing import BinaryIO, Final

from fastapi import Request
from scanjobs.account_tables import Upload
from scanjobs.errors import TooLarge, UploadConflict
from scanjobs.uploads import advance, digest_of_file, file_of, get_upload, held, sync
from starlette.concurrency import run_in_threadpool
from starlette.requests import ClientDisconnect

from services.api.dependencies import Parts
from services.api.errors import RequestRefused

BLOCK: Final = 1 << 20
CHECKSUM_MISMATCH: Final = 460
ALGORITHMS: Final = ("sha256", "sha1", "md5")


@dataclass(frozen=True, slots=True)
class Checksum:
    """What the bytes of one request must have (tus extension `checksum`)."""

    algorithm: str
    digest: bytes


def checksum_of(header: str | None) -> Checksum | None:
    """`Upload-Checksum: sha256 BASE64`. Raises `RequestRefused` for what cannot be read."""
    if header is None:
        return None
    algorithm, _, text = header.partition(" ")
    try:
        digest = base64.b64decode(text, validate=True)
    except (ValueError, binascii.Error):
        digest = b""
    if algorithm not in ALGORITHMS or not digest:
        hint = f"Use one of {', '.join(ALGORITHMS)} and base64."
        raise RequestRefused(400, "INVALID_CHECKSUM", "The Upload-Checksum cannot be read.", hint=hint)
    return Checksum(algorithm, digest)


async def receive_into(request: Request, parts: Parts, upload: Upload, checksum: Checksum | None) -> Upload:
    """Append the request's body to the upload; returns it as it is then.

    Raises
    ------
    UploadBusy, UploadConflict
        Somebody else is sending, or has sent.
    TooLarge
        There is more than the upload was announced with; nothing of this request is kept.
    RequestRefused
        The bytes do not have their checksum; nothing of this request is kept.
    """
    path = file_of(parts.settings, upload.id)
    holding = held(path)
    file = await run_in_threadpool(holding.__enter__)
    try:
        await run_in_threadpool(_begin, parts, upload, file)
        end = await _write_all(request, file, upload.received, upload.length, checksum)
        await run_in_threadpool(_settle, parts, upload, file, end)  # before the next writer may begin
    finally:
        await run_in_threadpool(holding.__exit__, None, None, None)
    return await run_in_threadpool(look_up, parts, upload.id, upload.owner)


def _begin(parts: Parts, upload: Upload, file: BinaryIO) -> None:
    """Stand where the upload stands. Raises `UploadConflict` where another has moved it since it was looked up."""
    if look_up(parts, upload.id, upload.owner).received != upload.received:
        raise UploadConflict("somebody else has continued the upload.", hint="Ask for its offset and go on from there.")
    file.truncate(upload.received)
    file.seek(upload.received)


def _settle(parts: Parts, upload: Upload, file: BinaryIO, end: int) -> None:
    """Say in the database what has come, once it is on disk."""
    sync(file)
    complete = end == upload.length and upload.state != "complete"
    digest = digest_of_file(file_of(parts.settings, upload.id)) if complete else None
    if end > upload.received or digest is not None:
        work = partial(advance, upload_id=upload.id, start=upload.received, end=end, digest=digest)
        parts.store.write(work)


def look_up(parts: Parts, upload_id: str, owner: str) -> Upload:
    """The upload as it is now. Raises `NotFound`."""
    with parts.store.read() as session:
        return get_upload(session, upload_id, owner=owner)


async def _write_all(request: Request, file: BinaryIO, start: int, length: int, checksum: Checksum | None) -> int:
    """Write the body; the offset behind its last byte that counts."""
    sha = hashlib.new(checksum.algorithm) if checksum else None
    end = start
    try:
        async for block in blocks_of(request):
            if end + len(block) > length:
                raise TooLarge("more bytes came than were announced.", hint="Announce the file's true length.")
            if sha is not None:
                sha.update(block)
            await run_in_threadpool(file.write, block)
            end += len(block)
    except ClientDisconnect:
        return start if checksum else end
    if sha is not None and checksum is not None and sha.digest() != checksum.digest:
        detail = "The bytes do not have their checksum."
        raise RequestRefused(CHECKSUM_MISMATCH, "CHECKSUM_MISMATCH", detail, hint="Send them again.")
    return end


async def blocks_of(request: Request) -> AsyncIterator[bytes]:
    """The body in blocks of about a megabyte."""
    pending = bytearray()
    try:
        async for chunk in request.stream():
            pending += chunk
            if len(pending) >= BLOCK:
                yield bytes(pending)
                pending.clear()
    except ClientDisconnect:
        if pending:
            yield bytes(pending)
        raise
    if pending:
        yield bytes(pending)


def refuse_gap(upload: Upload, offset: int) -> None:
    """Raise `UploadConflict` unless `offset` is where the upload stands."""
    if offset != upload.received:
        hint = f"Go on from byte {upload.received}."
        raise UploadConflict(f"the upload stands at byte {upload.received}.", hint=hint)
