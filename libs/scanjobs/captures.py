"""Captures made of uploads: a folder that is put together aside, looked at, and then there at once or not at all.

A specification names one as `capture:ID` in `source.path`; only its owner can. Files are linked, not copied.
"""

import hashlib
import os
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final
from uuid import UUID

from nerfmodal.errors import InvalidCapture
from nerfmodal.spec import ScanSpec, SimulationSource
from sqlalchemy import delete, insert, select, update
from sqlalchemy.orm import Session

from scanjobs.account_tables import Capture, Upload
from scanjobs.archives import Limits, safe_name, unpack
from scanjobs.artifacts import STAGING, place_input
from scanjobs.clock import now_s
from scanjobs.errors import IllegalTransition, NotFound
from scanjobs.inspection import inspect_folder
from scanjobs.repository import new_id
from scanjobs.settings import Settings
from scanjobs.sources import confine_source
from scanjobs.states import ENDED_SCAN_STATES
from scanjobs.tables import Scan
from scanjobs.uploads import COMPLETE, MEGABYTE, file_of, get_upload

SCHEME: Final = "capture:"


@dataclass(frozen=True, slots=True, kw_only=True)
class Member:
    """A finished upload under the name that it has in the capture."""

    upload_id: str
    name: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Assembled:
    """A capture's folder that was looked at and found good."""

    id: str
    files: int
    size: int
    digest: str
    facts: dict[str, Any]


def members_of(session: Session, wanted: Sequence[tuple[str, str | None]], *, owner: str) -> tuple[Member, ...]:
    """The uploads of a request (id, name or None for the upload's own), each complete and with a name of its own.

    Raises
    ------
    InvalidCapture
        An upload is not there, not complete, or has a name that cannot be.
    """
    members: dict[str, Member] = {}
    for place, (upload_id, name) in enumerate(wanted):
        where = f"/files/{place}"
        upload = _complete_upload(session, upload_id, where, owner=owner)
        safe = safe_name(name or upload.name, f"{where}/name")
        if safe.casefold() in members:
            raise InvalidCapture(f"the name '{safe}' is given twice.", where=f"{where}/name", hint="Name each once.")
        members[safe.casefold()] = Member(upload_id=upload.id, name=safe)
    for place, member in enumerate(members.values()):
        if any(str(folder).casefold() in members for folder in Path(member.name).parents):
            where = f"/files/{place}/name"
            raise InvalidCapture(f"'{member.name}' lies in a folder that is a file.", where=where, hint="Rename it.")
    return tuple(members.values())


def assemble(settings: Settings, members: Sequence[Member], kind: str) -> Assembled:
    """A folder of the uploads' files. Raises `InvalidCapture`; nothing is left then."""
    with _staged(settings) as folder:
        for member in members:
            place_input(file_of(settings, member.upload_id), folder / member.name)
        return _publish(settings, folder, kind)


def assemble_archive(settings: Settings, archive: Path, kind: str) -> Assembled:
    """A folder of an archive's files. Raises `InvalidCapture`; nothing is left then."""
    with _staged(settings) as folder:
        unpack(archive, folder, Limits(members=settings.archive_members, bytes=settings.archive_limit_mb * MEGABYTE))
        return _publish(settings, _without_wrapper(folder), kind)


def insert_capture(
    session: Session, assembled: Assembled, *, owner: str, name: str, kind: str, uploads: Sequence[str] = ()
) -> Capture:
    """Make the capture known, and its uploads part of it."""
    values = {
        "id": assembled.id,
        "owner": owner,
        "name": name,
        "kind": kind,
        "files": assembled.files,
        "size": assembled.size,
        "digest": assembled.digest,
        "facts": assembled.facts,
        "created_at": now_s(),
    }
    session.execute(insert(Capture).values(values))
    for start in range(0, len(uploads), 500):
        some = uploads[start : start + 500]
        session.execute(
            update(Upload).where(Upload.id.in_(some), Upload.owner == owner).values(capture_id=assembled.id)
        )
    return get_capture(session, assembled.id, owner=owner)


def get_capture(session: Session, capture_id: str, *, owner: str) -> Capture:
    """An owner's capture. Raises `NotFound`."""
    capture = session.scalars(select(Capture).where(Capture.id == capture_id, Capture.owner == owner)).one_or_none()
    if capture is None:
        raise NotFound(f"there is no capture {capture_id}.", hint="List yours with GET /v1/captures.")
    return capture


def list_captures(session: Session, *, owner: str, before: str | None = None, limit: int = 50) -> tuple[Capture, ...]:
    """An owner's captures, the newest first, from before an id on."""
    query = select(Capture).where(Capture.owner == owner)
    if before is not None:
        query = query.where(Capture.id < before)
    return tuple(session.scalars(query.order_by(Capture.id.desc()).limit(limit)))


def remove_capture(session: Session, capture_id: str, *, owner: str, folder: Path) -> None:
    """Forget a capture that no running scan reads. Raises `NotFound` or `IllegalTransition`."""
    capture = get_capture(session, capture_id, owner=owner)
    reading = select(Scan.id).where(
        Scan.owner == owner,
        Scan.state.not_in([state.value for state in ENDED_SCAN_STATES]),
        Scan.spec["source"]["path"].as_string() == str(folder),
    )
    if session.scalars(reading.limit(1)).first() is not None:
        raise IllegalTransition("a scan is still reading the capture.", hint="Wait until it has ended, or cancel it.")
    session.execute(delete(Upload).where(Upload.capture_id == capture.id))
    session.execute(delete(Capture).where(Capture.id == capture.id))


def named_capture(settings: Settings, path: str) -> str | None:
    """The id of the capture that `source.path` means: `capture:ID`, or the folder that this became in a stored scan."""
    if path.startswith(SCHEME):
        return _uuid(path.removeprefix(SCHEME))
    inside = path.removeprefix(f"{settings.captures}{os.sep}")
    return _uuid(inside) if inside != path else None


def locate_source(session: Session, settings: Settings, spec: ScanSpec, *, owner: str) -> ScanSpec:
    """The same specification with `source.path` as every worker can open it.

    Raises
    ------
    SourceOutsideRoots
        The path is in no folder that captures are read from.
    InvalidCapture
        It names a capture that is not this owner's, or is of another kind.
    """
    if isinstance(spec.source, SimulationSource):
        return spec
    capture_id = named_capture(settings, spec.source.path)
    if capture_id is None:
        return confine_source(settings, spec, owner=owner)
    try:
        capture = get_capture(session, capture_id, owner=owner)
    except NotFound as error:
        raise InvalidCapture(error.message, where="/source/path", hint=error.hint) from error
    if capture.kind != spec.source.kind:
        hint = f"Write 'kind': '{capture.kind}'."
        raise InvalidCapture(f"it was sent in as {capture.kind}.", where="/source/kind", hint=hint)
    source = spec.source.model_copy(update={"path": str(folder_of(settings, capture_id))})
    return spec.model_copy(update={"source": source})


def folder_of(settings: Settings, capture_id: str) -> Path:
    """Where a capture lies."""
    return settings.captures / capture_id


def _uuid(text: str) -> str:
    try:
        return str(UUID(text))
    except ValueError as error:
        hint = "Write capture:ID with an id of GET /v1/captures."
        raise InvalidCapture(f"'{text}' is no capture.", where="/source/path", hint=hint) from error


def _complete_upload(session: Session, upload_id: str, where: str, *, owner: str) -> Upload:
    try:
        upload = get_upload(session, str(UUID(upload_id)), owner=owner)
    except (NotFound, ValueError) as error:
        raise InvalidCapture(
            "there is no such upload.", where=f"{where}/upload", hint="Send the file again."
        ) from error
    if upload.state != COMPLETE or upload.capture_id is not None:
        what = "is part of a capture already" if upload.capture_id else "has not arrived completely"
        raise InvalidCapture(f"the upload {what}.", where=f"{where}/upload", hint="Send the rest of the file first.")
    return upload


@contextmanager
def _staged(settings: Settings) -> Iterator[Path]:
    """An empty folder beside the captures; gone after the block, whatever became of it."""
    folder = settings.captures / STAGING / new_id()
    folder.mkdir(parents=True)
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _without_wrapper(folder: Path) -> Path:
    """The folder itself, or the one folder that everything in it lies in."""
    entries = list(folder.iterdir())
    return entries[0] if len(entries) == 1 and entries[0].is_dir() else folder


def _publish(settings: Settings, folder: Path, kind: str) -> Assembled:
    facts = inspect_folder(folder, kind)
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    sha = hashlib.sha256()
    for path in files:
        with path.open("rb") as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
        sha.update(f"{digest}  {path.relative_to(folder).as_posix()}\n".encode())
        path.chmod(0o444)
    size = sum(path.stat().st_size for path in files)
    assembled = Assembled(id=new_id(), files=len(files), size=size, digest=sha.hexdigest(), facts=facts)
    os.replace(folder, folder_of(settings, assembled.id))
    return assembled
