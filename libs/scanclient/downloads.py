"""Files on their way to disk: a part file per digest, resumed by Range, renamed only when the digest fits."""

import hashlib
import os
import shutil
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from scanclient.errors import BrokenDownload
from scanclient.values import Artifact


def target(folder: Path, artifact: Artifact) -> Path:
    """Where the file goes; refuses a name that would leave `folder`."""
    parts = PurePosixPath(artifact.name).parts
    if not parts or artifact.name.startswith("/") or ".." in parts or "\\" in artifact.name:
        raise BrokenDownload(f"the service names a file '{artifact.name}' that would leave {folder}")
    return folder.joinpath(*parts)


def part_path(path: Path, artifact: Artifact) -> Path:
    """The unfinished file; its name holds the digest, so that a newer file never continues an older one."""
    return path.with_name(f".{path.name}.{artifact.sha256[:12]}.part")


def is_complete(path: Path, artifact: Artifact) -> bool:
    """Whether the file is already there with the right size and digest."""
    return path.is_file() and path.stat().st_size == artifact.size and digest_of(path) == artifact.sha256


def bytes_present(part: Path, most: int) -> int:
    """How many bytes of the part file count; one that is too long is thrown away."""
    size = part.stat().st_size if part.exists() else 0
    if size <= most:
        return size
    part.unlink()
    return 0


@dataclass(frozen=True, slots=True)
class Piece:
    """Bytes `start` to `end` of a file, fetched on their own."""

    start: int
    end: int


def pieces_of(artifact: Artifact, piece_bytes: int) -> tuple[Piece, ...]:
    """The file cut into ranges that are fetched beside one another; a small one is one piece."""
    starts = range(0, artifact.size, piece_bytes) if artifact.size > piece_bytes else (0,)
    return tuple(Piece(start, min(start + piece_bytes, artifact.size)) for start in starts)


def piece_path(part: Path, piece: Piece) -> Path:
    """The unfinished file of one piece."""
    return part.with_name(f"{part.name}.{piece.start}")


def join(part: Path, pieces: Iterable[Piece]) -> None:
    """Put the pieces together and remove them."""
    with part.open("wb") as whole:
        for piece in pieces:
            with piece_path(part, piece).open("rb") as file:
                shutil.copyfileobj(file, whole, 1 << 20)
    for piece in pieces:
        piece_path(part, piece).unlink()


def append(part: Path, blocks: Iterable[bytes], *, start: int) -> None:
    """Write the blocks from byte `start` on, whatever stood behind it."""
    part.parent.mkdir(parents=True, exist_ok=True)
    with part.open("r+b" if part.exists() else "wb") as file:
        file.seek(start)
        file.truncate()
        for block in blocks:
            file.write(block)


def accept(part: Path, path: Path, artifact: Artifact) -> Path:
    """Give the finished file its name, or remove it where its digest differs."""
    if digest_of(part) != artifact.sha256:
        part.unlink()
        raise BrokenDownload(f"{artifact.name}: the bytes that arrived do not have the digest {artifact.sha256}")
    os.replace(part, path)
    return path


def digest_of(path: Path) -> str:
    """SHA-256 of a file, hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
