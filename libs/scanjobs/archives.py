"""Zip archives of strangers: everything is looked at before a byte is written.

Refused are names that lead out of the folder, links and devices, encryption, too many members, too many bytes
unpacked, and archives that unpack to a hundred times their size (a file of 195 kB held 200 MB). The directory at the
archive's end is counted before it is parsed, because parsing costs memory for each entry; and members are counted
while they are written, because a directory may lie.
"""

import stat
import struct
import zipfile
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import BinaryIO, Final

from nerfmodal.errors import InvalidCapture

WHERE: Final = "/archive"
HIGHEST_RATIO: Final = 100
HARMLESS_BYTES: Final = 10 << 20
"""An archive that unpacks to less than this may be packed as tightly as it likes: text is."""
LONGEST_NAME: Final = 200
DEEPEST: Final = 16
END: Final = struct.Struct("<4s4H2LH")
"""End of the central directory: signature, disks, entries, size and offset of the directory, length of a comment."""
ENTRY_BYTES: Final = 46
BLOCK: Final = 1 << 20
UNIX: Final = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """What an archive may hold."""

    members: int
    bytes: int


def unpack(archive: Path, folder: Path, limits: Limits) -> int:
    """Unpack into an empty folder; returns the bytes written.

    Raises
    ------
    InvalidCapture
        The archive is broken or may not be unpacked; nothing outside `folder` has been touched.
    """
    try:
        _count_entries(archive, limits)
        with zipfile.ZipFile(archive) as opened:
            members = _checked(opened.infolist(), archive.stat().st_size, limits)
            return sum(_write(opened, member, folder) for member in members)
    except (zipfile.BadZipFile, NotImplementedError, EOFError, struct.error, zlib.error) as error:
        raise refusal(f"the archive cannot be read: {error}.", "Make it again, as a zip file.") from error


def safe_name(name: str, where: str) -> str:
    """The relative path that a file may have in a capture. Raises `InvalidCapture`."""
    parts = name.split("/")
    climbs = any(part in ("", ".", "..") for part in parts) or name.startswith("/")
    odd = any(ord(char) < 32 or ord(char) == 127 or char in '\\:*?"<>|' for char in name)
    if not name or climbs or odd or not _encodable(name):
        hint = "Use relative names of letters, digits, '_', '-', '.' and '/'."
        raise InvalidCapture(f"the name {name!r} leads out of the capture or cannot be one.", where=where, hint=hint)
    if len(name.encode()) > LONGEST_NAME or len(parts) > DEEPEST:
        hint = f"At most {LONGEST_NAME} bytes and {DEEPEST} levels."
        raise InvalidCapture(f"the name {name[:40]!r}… is too long.", where=where, hint=hint)
    return name


def refusal(message: str, hint: str) -> InvalidCapture:
    """Why an archive is not taken."""
    return InvalidCapture(message, where=WHERE, hint=hint)


def _encodable(name: str) -> bool:
    try:
        name.encode()
    except UnicodeEncodeError:
        return False
    return True


def _count_entries(archive: Path, limits: Limits) -> None:
    """Refuse a directory of too many entries before anything is made of them."""
    most = limits.members * (ENTRY_BYTES + LONGEST_NAME)
    with archive.open("rb") as file:
        end, size = _directory(file)
        file.seek(max(0, end - size))
        entries = _entries_in(file.read(size)) if size <= most else limits.members + 1
    if entries > limits.members:
        raise refusal(f"the archive has more than {limits.members} files.", "Send fewer files at once.")


def _entries_in(directory: bytes) -> int:
    at = count = 0
    while directory[at : at + 4] == b"PK\x01\x02":
        at += ENTRY_BYTES + sum(struct.unpack_from("<3H", directory, at + 28))
        count += 1
    return count


def _directory(file: BinaryIO) -> tuple[int, int]:
    """Where the directory ends and how many bytes it has, as the archive's last record says."""
    length = file.seek(0, 2)
    start = max(0, length - END.size - (1 << 16))
    file.seek(start)
    tail = file.read()
    at = tail.rfind(b"PK\x05\x06")
    if at < 0 or at + END.size > len(tail):
        raise zipfile.BadZipFile("it has no directory")
    size = int(END.unpack_from(tail, at)[5])
    if at >= 20 and tail[at - 20 : at - 16] == b"PK\x06\x07":
        return _directory_64(file, tail[at - 20 : at])
    return start + at, size


def _directory_64(file: BinaryIO, locator: bytes) -> tuple[int, int]:
    """The same of an archive above 4 GB: a locator in front of the last record says where a longer one is."""
    offset = int(struct.unpack_from("<4sLQL", locator)[2])
    file.seek(offset)
    return offset, int(struct.unpack_from("<Q", file.read(56), 40)[0])


def _checked(found: Sequence[zipfile.ZipInfo], packed: int, limits: Limits) -> list[zipfile.ZipInfo]:
    members = [member for member in found if not member.is_dir()]
    if not members:
        raise refusal("the archive is empty.", "Put the capture's files into it.")
    if len(members) > limits.members:
        raise refusal(f"the archive has {len(members)} files, {limits.members} are the most.", "Send fewer at once.")
    for member in members:
        _check_member(member)
    _check_names([member.filename for member in members])
    unpacked = sum(member.file_size for member in members)
    if unpacked > limits.bytes:
        raise refusal(f"the archive unpacks to {unpacked} bytes, {limits.bytes} are the most.", "Send less at once.")
    if unpacked > HARMLESS_BYTES and unpacked > HIGHEST_RATIO * packed:
        raise refusal(f"the archive unpacks to {unpacked // packed} times its size.", "Send the files as they are.")
    return members


def _check_member(member: zipfile.ZipInfo) -> None:
    safe_name(member.filename, WHERE)
    mode = member.external_attr >> 16 if member.create_system == UNIX else 0
    if mode and stat.S_IFMT(mode) not in (0, stat.S_IFREG):
        raise refusal(f"'{member.filename}' is a link or a device.", "Put the file itself into the archive.")
    if member.flag_bits & 0x1:
        raise refusal(f"'{member.filename}' is encrypted.", "Make the archive without a password.")


def _check_names(names: Sequence[str]) -> None:
    """No two files of one name, and no file where another one needs a folder; capitals make no difference."""
    seen = {name.casefold() for name in names}
    if len(seen) < len(names):
        raise refusal("two files of the archive have the same name.", "Give each file its own name.")
    for name in names:
        if any(str(folder).casefold() in seen for folder in PurePosixPath(name).parents):
            raise refusal(f"'{name}' lies in a folder that is a file.", "Give each file its own name.")


def _write(opened: zipfile.ZipFile, member: zipfile.ZipInfo, folder: Path) -> int:
    target = folder / member.filename
    target.parent.mkdir(parents=True, exist_ok=True)
    written = 0
    with opened.open(member) as source, target.open("xb") as file:
        while block := source.read(BLOCK):
            written += file.write(block)
            if written > member.file_size:
                raise refusal(f"'{member.filename}' is longer than the archive says.", "Make the archive again.")
    if written != member.file_size:
        raise refusal(f"'{member.filename}' is shorter than the archive says.", "Make the archive again.")
    return written
