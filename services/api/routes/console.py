"""The web page at `/` and its files; a service without it is the same service."""

from typing import Annotated, Final

from fastapi import APIRouter, Header, Response
from scanjobs.errors import NotFound

from services.api.console.assets import Asset, accepts_gzip, library

POLICY: Final = "; ".join(
    (
        "default-src 'none'",
        "script-src 'self'",
        "style-src 'self'",
        "img-src 'self' blob: data:",
        "connect-src 'self'",
        "base-uri 'none'",
        "form-action 'none'",
        "frame-ancestors 'none'",
    )
)
"""Own files only, and pictures that came with an API key (blob:)."""
FOR_GOOD: Final = "public, max-age=31536000, immutable"
ASK_FIRST: Final = "no-cache"
IfNoneMatch = Annotated[str, Header(alias="If-None-Match", max_length=1024)]
AcceptEncoding = Annotated[str, Header(alias="Accept-Encoding", max_length=1024)]
router = APIRouter(include_in_schema=False)


@router.api_route("/", methods=["GET", "HEAD"])
async def page(known: IfNoneMatch = "", encodings: AcceptEncoding = "") -> Response:
    """The page; it names its files by their version, so it is asked for anew each time."""
    return _answer(library().page, known, encodings, ASK_FIRST)


@router.api_route("/console/{version}/{name:path}", methods=["GET", "HEAD"])
async def file(version: str, name: str, known: IfNoneMatch = "", encodings: AcceptEncoding = "") -> Response:
    """A file of the page. A page of another version gets the present file, which it must not keep."""
    found = library().files.get(name)
    if found is None:
        raise NotFound("the console has no such file.", hint="Load the page again.")
    return _answer(found, known, encodings, FOR_GOOD if version == library().version else ASK_FIRST)


def _answer(asset: Asset, known: str, encodings: str, keep: str) -> Response:
    packed = asset.packed if accepts_gzip(encodings) else None
    etag = f'"{asset.etag}-gzip"' if packed else f'"{asset.etag}"'
    headers = {"ETag": etag, "Cache-Control": keep, "Vary": "Accept-Encoding", "Content-Security-Policy": POLICY}
    if etag in (one.strip().removeprefix("W/") for one in known.split(",")):
        return Response(status_code=304, headers=headers)
    if packed:
        headers["Content-Encoding"] = "gzip"
    return Response(packed or asset.content, media_type=asset.media_type, headers=headers)
