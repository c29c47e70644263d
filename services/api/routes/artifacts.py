"""A scan's files: listed with size and digest, served verified, whole or in ranges."""

import re
from typing import Annotated

from fastapi import APIRouter, Header
from fastapi.responses import FileResponse
from scanjobs.errors import NotFound
from scanjobs.messages import IDENTIFY
from scanjobs.repository import StoredFile, find_artifact, get_scan, list_artifacts

from services.api.dependencies import Owner, Parts, ScanId, TheParts
from services.api.errors import RequestRefused
from services.api.names import public_name
from services.api.schemas import ArtifactDetail, ArtifactList

SANDBOX = "sandbox allow-scripts allow-downloads"
"""A served page (report.html) runs its own scripts, but not in the name of the API's address."""
Range = Annotated[str | None, Header(alias="Range", max_length=512, description="bytes=FIRST-LAST")]
router = APIRouter(prefix="/v1/scans/{scan_id}/artifacts", tags=["artifacts"])


@router.get("")
def list_(scan_id: ScanId, parts: TheParts, owner: Owner) -> ArtifactList:
    """Every file of the present generation, the results first."""
    with parts.store.read() as session:
        files = list_artifacts(session, get_scan(session, scan_id, owner=owner))
    ordered = sorted(files, key=lambda file: file.kind != IDENTIFY)
    return ArtifactList(items=[ArtifactDetail.of(public_name(file), file) for file in ordered])


@router.get("/{name:path}", response_class=FileResponse)
def fetch(scan_id: ScanId, name: str, parts: TheParts, owner: Owner, range_: Range = None) -> FileResponse:
    """The bytes of a file; `Range` and `If-Range` work, the ETag is the SHA-256."""
    file = find(parts, scan_id, owner, name)
    refuse_beyond_end(range_, file.size)
    return answer(parts, file)


def refuse_beyond_end(range_: str | None, size: int) -> None:
    """416 for one range that begins behind the end; other forms are the file response's to read."""
    asked = re.fullmatch(r"bytes=(\d{1,18})-\d*", range_ or "")
    if asked and int(asked[1]) >= size:
        detail = f"The file has {size} bytes."
        hint = "Begin before its end."
        raise RequestRefused(
            416, "RANGE_NOT_SATISFIABLE", detail, hint=hint, headers={"Content-Range": f"bytes */{size}"}
        )


def find(parts: Parts, scan: str, owner: str, name: str) -> StoredFile:
    """The file of a public name. Raises `NotFound`."""
    with parts.store.read() as session:
        row = get_scan(session, scan, owner=owner)
        try:
            return find_artifact(session, row, name, kind=IDENTIFY)
        except NotFound:
            files = list_artifacts(session, row)
    for file in files:
        if public_name(file) == name:
            return file
    raise NotFound(f"the scan has no file '{name}'.", hint=f"See GET /v1/scans/{scan}/artifacts.")


def answer(parts: Parts, file: StoredFile) -> FileResponse:
    """The file with its digest as ETag; it never changes under its digest."""
    headers = {
        "ETag": f'"{file.digest}"',
        "Cache-Control": "private, no-cache",
        "Content-Security-Policy": SANDBOX,
    }
    return FileResponse(parts.artifacts.path(file.digest), media_type=file.media_type, headers=headers)
