"""The console's files, read once: each with its digest and a gzip of it where that pays.

The page names its files under one version, the digest of them all, so that a browser may keep them for good; they
import one another by relative paths, which keeps them under that version.
"""

import gzip
import hashlib
import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Final

from nerfmodal.types import Outcome, Reason
from scanjobs.webhooks import MEANING

from services.api.console.imports import of_pages, of_shell

FOLDER: Final = Path(__file__).parent
PAGE: Final = "index.html"
VERSION_HERE: Final = b"{{version}}"
SHELL_HERE: Final = b"{{shell}}"
IMPORTS_HERE: Final = b"{{imports}}"
"""In the page: where the version stands, what every page preloads, and what each page imports beyond that."""
MEDIA_TYPES: Final[Mapping[str, str]] = {
    ".html": "text/html; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".svg": "image/svg+xml",
    ".json": "application/json",
    ".LICENSE": "text/plain; charset=utf-8",
}
WORTH: Final = 0.9
"""A gzip that is not smaller than this share of the file is not kept."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Asset:
    """A file as it is sent."""

    content: bytes
    packed: bytes | None
    media_type: str
    etag: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Library:
    """Every file by its path, the page apart from them."""

    version: str
    page: Asset
    files: Mapping[str, Asset]


@cache
def library() -> Library:
    """The files of this installation; they do not change while it runs."""
    contents = {path.relative_to(FOLDER).as_posix(): path.read_bytes() for path in _paths()}
    contents["words.json"] = json.dumps(words(), ensure_ascii=False).encode()
    page = contents.pop(PAGE)
    parts = (f"{name} {hashlib.sha256(content).hexdigest()}\n" for name, content in sorted(contents.items()))
    version = hashlib.sha256("".join(parts).encode() + page).hexdigest()[:16]
    return Library(
        version=version,
        page=_asset(PAGE, _filled(page, version, contents)),
        files={name: _asset(name, content) for name, content in contents.items()},
    )


def _filled(page: bytes, version: str, contents: Mapping[str, bytes]) -> bytes:
    links = (f'<link rel="modulepreload" href="/console/{version}/{name}" />' for name in of_shell(contents))
    page = page.replace(SHELL_HERE, "\n    ".join(links).encode())
    return page.replace(IMPORTS_HERE, json.dumps(of_pages(contents)).encode()).replace(VERSION_HERE, version.encode())


def words() -> Mapping[str, Mapping[str, str]]:
    """What codes of results and kinds of messages mean, from the one place where that is written."""
    return {
        "reasons": {reason.name: reason.value for reason in Reason},
        "outcomes": {outcome.name: outcome.value for outcome in Outcome},
        "messages": MEANING,
    }


def accepts_gzip(header: str) -> bool:
    """Whether an Accept-Encoding header allows gzip: named or `*`, and not with a weight of zero."""
    for part in header.lower().split(","):
        name, _, weight = part.strip().partition(";")
        if name.strip() in ("gzip", "*"):
            return re.fullmatch(r"\s*q=0(\.0*)?\s*", weight) is None
    return False


def _paths() -> list[Path]:
    return sorted(path for path in FOLDER.rglob("*") if path.is_file() and path.suffix in MEDIA_TYPES)


def _asset(name: str, content: bytes) -> Asset:
    packed = gzip.compress(content, mtime=0)
    return Asset(
        content=content,
        packed=packed if len(packed) < WORTH * len(content) else None,
        media_type=MEDIA_TYPES[Path(name).suffix],
        etag=hashlib.sha256(content).hexdigest()[:32],
    )
