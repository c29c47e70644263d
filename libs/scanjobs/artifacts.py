"""Files named by the SHA-256 of their bytes, in a folder: `ab/abcdef…`.

A file is staged beside the store, synced, renamed into place and its folder synced, so that a name is there with all
its bytes or not at all. Every way out compares the digest first. References to artifacts live in SQL.
"""

import hashlib
import os
import secrets
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from io import BufferedReader
from pathlib import Path
from typing import ClassVar

from scanjobs.errors import ArtifactDamaged, NotFound

STAGING = ".staging"


@dataclass(frozen=True, slots=True)
class Stored:
    """What the store knows of a file: hexadecimal SHA-256 and bytes."""

    digest: str
    size: int


def stored_as(source: Path) -> Stored:
    """What the store would know of a file."""
    with source.open("rb") as file:
        return Stored(hashlib.file_digest(file, "sha256").hexdigest(), os.fstat(file.fileno()).st_size)


class ArtifactStore:
    """A content-addressed folder; `object_store` has its sibling that keeps the files elsewhere."""

    is_near: ClassVar[bool] = True
    """Whether storing waits for this machine's disk alone: a transaction may wait for it, but never for a network."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._synced: set[Path] = set()
        (folder / STAGING).mkdir(parents=True, exist_ok=True)

    def put(self, source: Path) -> Stored:
        """Copy a file into the store; a second copy of the same bytes costs nothing but reading."""
        staged = self.folder / STAGING / secrets.token_hex(16)
        try:
            stored = _copy(source, staged)
            self._publish(staged, stored.digest)
        finally:
            staged.unlink(missing_ok=True)
        return stored

    def take(self, source: Path, stored: Stored) -> None:
        """Store a file that nobody else needs and `stored_as` knows; on the store's own file system it is moved."""
        if source.is_symlink() or source.stat().st_dev != self.folder.stat().st_dev:
            self.put(source)
            return
        with source.open("rb") as file:
            os.utime(file.fileno())  # its age in the store begins now
            os.fchmod(file.fileno(), 0o444)
            os.fsync(file.fileno())
        self._publish(source, stored.digest)

    def path(self, digest: str) -> Path:
        """The verified file of a digest. Raises `ArtifactDamaged`, or `NotFound` for what is no digest."""
        path = self.place(digest)
        if not path.is_file():
            raise ArtifactDamaged(digest, "is missing")
        with path.open("rb") as file:
            _verify(file, digest)
        return path

    @contextmanager
    def open(self, digest: str) -> Iterator[BufferedReader]:
        """The verified bytes of a digest, from their beginning."""
        with self.path(digest).open("rb") as file:
            yield file

    def holds(self, digest: str) -> bool:
        """Whether the digest is stored, without reading it."""
        return self.place(digest).is_file()

    def remove_older(self, digest: str, age_s: float) -> bool:
        """Remove a file that was stored longer ago than `age_s`, unless it is stored again meanwhile."""
        place, aside = self.place(digest), self.folder / STAGING / f"{digest}.garbage"
        try:
            os.replace(place, aside)
        except FileNotFoundError:
            return False
        is_old = time.time() - aside.stat().st_mtime > age_s
        if not is_old:
            with suppress(FileExistsError):  # stored again while it lay aside
                os.link(aside, place)
        aside.unlink()
        return is_old

    def digests(self) -> Iterator[str]:
        """Every digest stored, in no order."""
        for path in self.folder.glob("[0-9a-f][0-9a-f]/*"):
            yield path.name

    def place(self, digest: str) -> Path:
        """Where a digest lies or would lie."""
        if len(digest) != 64 or not set(digest) <= set("0123456789abcdef"):
            raise NotFound(f"{digest!r} is no digest.", hint="Use a digest from the scan's artifacts.")
        return self.folder / digest[:2] / digest

    def _publish(self, staged: Path, digest: str) -> None:
        target = self.place(digest)
        target.parent.mkdir(exist_ok=True)
        os.replace(staged, target)  # also over a copy that has rotted
        _sync_folder(target.parent)
        if target.parent not in self._synced:  # whoever made it may not have come so far
            _sync_folder(self.folder)
            self._synced.add(target.parent)


def _copy(source: Path, staged: Path) -> Stored:
    sha, size = hashlib.sha256(), 0
    with source.open("rb") as reader, staged.open("xb") as writer:
        while block := reader.read(1 << 20):
            sha.update(block)
            size += writer.write(block)
        writer.flush()
        os.fsync(writer.fileno())
    staged.chmod(0o444)
    return Stored(sha.hexdigest(), size)


def _verify(file: BufferedReader, digest: str) -> None:
    if hashlib.file_digest(file, "sha256").hexdigest() != digest:
        raise ArtifactDamaged(digest, "has other bytes")


def _sync_folder(folder: Path) -> None:
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def place_input(source: Path, target: Path) -> None:
    """Show a stored file under a readable name, as a link where the file systems allow it."""
    target.parent.mkdir(parents=True, exist_ok=True)
    try:
        os.link(source, target)
    except OSError:
        shutil.copyfile(source, target)
