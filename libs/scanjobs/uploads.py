"""Files on their way in: a row for how far each is, and a file that is at least as far.

`received` is raised after the bytes are synced to disk, so what a client was told has arrived is there after a power
failure. Bytes behind `received` count for nothing and are cut off by the next writer. One writer at a time holds a
lock on the file, whichever process it is in.
"""

import fcntl
import hashlib
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO, Final

from sqlalchemy import delete, func, insert, select, update
from sqlalchemy.orm import Session

from scanjobs.account_tables import Capture, Owner, Upload
from scanjobs.clock import now_s
from scanjobs.disk import free_bytes
from scanjobs.errors import NotFound, QuotaExceeded, TooLarge, UploadBusy, UploadConflict
from scanjobs.repository import new_id
from scanjobs.settings import Settings

OPEN: Final = "open"
COMPLETE: Final = "complete"
MEGABYTE: Final = 10**6
REMEDY: Final = "Delete uploads or captures that are not needed, or ask the operator for more room."


def create_upload(
    session: Session, settings: Settings, *, owner: str, name: str, media_type: str, length: int, metadata: str = ""
) -> Upload:
    """Make room for a file of `length` bytes.

    Raises
    ------
    TooLarge
        It is longer than one file may be.
    QuotaExceeded
        The owner's uploads and captures, or the disk, leave no room for it.
    """
    if length > settings.upload_limit_mb * MEGABYTE:
        hint = f"Send files of at most {settings.upload_limit_mb} MB."
        raise TooLarge(f"the file has {length} bytes.", where="/Upload-Length", hint=hint)
    check_room(session, settings, owner=owner, more=length)
    upload_id = new_id()
    values = {
        "id": upload_id,
        "owner": owner,
        "name": name,
        "media_type": media_type,
        "length": length,
        "received": 0,
        "state": OPEN,
        "upload_metadata": metadata,
        "created_at": now_s(),
        "expires_at": now_s() + settings.upload_expires_s,
    }
    session.execute(insert(Upload).values(values))
    return get_upload(session, upload_id, owner=owner)


def check_room(session: Session, settings: Settings, *, owner: str, more: int) -> None:
    """Raise `QuotaExceeded` unless `more` bytes still fit the owner's quota and the disk."""
    row = session.get(Owner, owner)
    quota = settings.owner_quota_mb * MEGABYTE if row is None or row.quota_bytes is None else row.quota_bytes
    used = used_bytes(session, owner=owner)
    if used + more > quota:
        raise QuotaExceeded(f"{used} of {quota} bytes are used, {more} more do not fit.", hint=REMEDY)
    if free_bytes(settings) - more < settings.disk_low_mb * MEGABYTE:
        raise QuotaExceeded("the service's disk has no room for it.", hint="Tell the operator, and try again later.")


def used_bytes(session: Session, *, owner: str) -> int:
    """Bytes of an owner's captures, and of the uploads that have not become one."""
    sent = select(func.coalesce(func.sum(Upload.length), 0)).where(Upload.owner == owner, Upload.capture_id.is_(None))
    kept = select(func.coalesce(func.sum(Capture.size), 0)).where(Capture.owner == owner)
    return int(session.scalars(sent).one()) + int(session.scalars(kept).one())


def get_upload(session: Session, upload_id: str, *, owner: str) -> Upload:
    """An owner's upload that has not expired. Raises `NotFound`."""
    mine = (Upload.id == upload_id, Upload.owner == owner, Upload.expires_at > now_s())
    upload = session.scalars(select(Upload).where(*mine)).one_or_none()
    if upload is None:
        raise NotFound(f"there is no upload {upload_id}.", hint="It may have expired: begin again.")
    return upload


def list_uploads(session: Session, *, owner: str, before: str | None = None, limit: int = 50) -> tuple[Upload, ...]:
    """An owner's uploads that have not become a capture, the newest first, from before an id on."""
    query = select(Upload).where(Upload.owner == owner, Upload.expires_at > now_s(), Upload.capture_id.is_(None))
    if before is not None:
        query = query.where(Upload.id < before)
    return tuple(session.scalars(query.order_by(Upload.id.desc()).limit(limit)))


def advance(session: Session, upload_id: str, *, start: int, end: int, digest: str | None) -> None:
    """Say that the bytes up to `end` are on disk; `digest` is given with the last one. Raises `UploadConflict`."""
    values: dict[str, Any] = {"received": end}
    if digest is not None:
        values |= {"state": COMPLETE, "digest": digest}
    moved = update(Upload).where(Upload.id == upload_id, Upload.received == start, Upload.state == OPEN)
    if session.execute(moved.values(values).returning(Upload.id)).one_or_none() is None:
        raise UploadConflict("somebody else has continued the upload.", hint="Ask for its offset and go on from there.")


def remove_upload(session: Session, settings: Settings, upload_id: str, *, owner: str) -> None:
    """Forget an upload and its bytes. Raises `NotFound`."""
    upload = get_upload(session, upload_id, owner=owner)
    session.execute(delete(Upload).where(Upload.id == upload.id))
    file_of(settings, upload.id).unlink(missing_ok=True)


def remove_expired(session: Session, settings: Settings) -> int:
    """Forget the uploads whose time is over; returns how many."""
    ids = tuple(session.scalars(delete(Upload).where(Upload.expires_at <= now_s()).returning(Upload.id)))
    for upload_id in ids:
        file_of(settings, upload_id).unlink(missing_ok=True)
    return len(ids)


def file_of(settings: Settings, upload_id: str) -> Path:
    """Where an upload's bytes lie."""
    return settings.uploads / upload_id


@contextmanager
def held(path: Path) -> Iterator[BinaryIO]:
    """The file, for one writer alone; synced when the block ends.

    Whoever holds it asks again how far the upload is before changing a byte: another may have finished meanwhile.

    Raises
    ------
    UploadBusy
        Another writer has it.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    with os.fdopen(os.open(path, os.O_RDWR | os.O_CREAT, 0o600), "r+b") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            hint = "Wait until it has ended, then ask how far the upload is."
            raise UploadBusy("another request is sending to this upload.", hint=hint) from error
        try:
            yield file
        finally:
            sync(file)


def sync(file: BinaryIO) -> None:
    """Bring what was written to disk."""
    file.flush()
    os.fsync(file.fileno())


def digest_of_file(path: Path) -> str:
    """SHA-256, hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
