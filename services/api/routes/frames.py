"""What one frame of a scan looks like: the picture of every camera, and its point cloud small enough to be drawn.

A cloud's bytes, little-endian: x, y, z of every point as float32, metres; then red, green, blue of every point as
uint8. The points come in a shuffled order that never changes, so that any beginning of them is an even choice.
"""

import json
import re
import zipfile
from pathlib import Path as File
from typing import Annotated, Any, Final

import numpy as np
from fastapi import APIRouter, Header, Path, Query
from fastapi.responses import Response
from pydantic import BaseModel
from scanjobs.errors import ArtifactDamaged, NotFound
from scanjobs.messages import EXTRACT, READ, RENDER
from scanjobs.repository import StoredFile, find_artifact, get_scan

from services.api.dependencies import Owner, Parts, ScanId, TheParts

CLOUD: Final = "application/vnd.nerfmodal.points"
HEADER_BYTES: Final = 4000
VERTEX: Final = np.dtype([("xyz", "<f8", 3), ("rgb", "u1", 3)])
"""As `nerfmodal.io` writes it."""
SHUFFLED_BY: Final = 1
MOST_POINTS: Final = 2_000_000
Frame = Annotated[int, Path(ge=0, le=1_000_000, description="Which frame, from 0.")]
IfNoneMatch = Annotated[str, Header(alias="If-None-Match", max_length=1024)]
BINARY: Final[dict[str, Any]] = {"schema": {"type": "string", "format": "binary"}}
KNOWN: Final[dict[str, Any]] = {"description": "What was sent before is still right."}
router = APIRouter(prefix="/v1/scans/{scan_id}/frames/{frame}", tags=["frames"])


class Picture(BaseModel):
    """What one camera saw."""

    camera: str
    width: int
    height: int
    time_s: float


class PictureList(BaseModel):
    """What the cameras saw of a frame."""

    items: list[Picture]


@router.get("/pictures")
def pictures(scan_id: ScanId, frame: Frame, parts: TheParts, owner: Owner) -> PictureList:
    """The cameras that saw a frame."""
    with zipfile.ZipFile(parts.artifacts.path(_frame_file(parts, scan_id, owner, frame).digest)) as archive:
        return PictureList(items=[_described(entry) for entry in _entries(archive)])


@router.get(
    "/pictures/{camera:path}",  # a camera may be called after its file, folders and all
    response_class=Response,
    responses={200: {"content": {"image/png": BINARY}}, 304: KNOWN},
)
def picture(
    scan_id: ScanId,
    frame: Frame,
    camera: Annotated[str, Path(max_length=200)],
    parts: TheParts,
    owner: Owner,
    known: IfNoneMatch = "",
) -> Response:
    """What one camera saw."""
    file = _frame_file(parts, scan_id, owner, frame)
    headers = {"ETag": f'"{file.digest}"', "Cache-Control": "private, no-cache"}
    if headers["ETag"] in known:
        return Response(status_code=304, headers=headers)
    with zipfile.ZipFile(parts.artifacts.path(file.digest)) as archive:
        for entry in _entries(archive):
            if entry["camera_id"] == camera:
                return Response(archive.read(str(entry["file_path"])), media_type="image/png", headers=headers)
    raise NotFound(f"frame {frame} was not seen by a camera '{camera}'.", hint="List the frame's pictures.")


@router.get("/cloud", response_class=Response, responses={200: {"content": {CLOUD: BINARY}}, 304: KNOWN})
def cloud(
    scan_id: ScanId,
    frame: Frame,
    parts: TheParts,
    owner: Owner,
    max_points: Annotated[int, Query(ge=1, le=MOST_POINTS, description="At most so many, evenly chosen.")] = 100_000,
    known: IfNoneMatch = "",
) -> Response:
    """A frame's points; `X-Points` says how many come, `X-Points-Total` how many there are."""
    file = _file(parts, scan_id, owner, "cloud", EXTRACT, frame)
    headers = {"ETag": f'"{file.digest}-{max_points}"', "Cache-Control": "private, no-cache"}
    if headers["ETag"] in known:
        return Response(status_code=304, headers=headers)
    vertices = _vertices(parts.artifacts.path(file.digest), file.digest)
    chosen = vertices[np.random.default_rng(SHUFFLED_BY).permutation(len(vertices))[:max_points]]
    headers |= {"X-Points": str(len(chosen)), "X-Points-Total": str(len(vertices))}
    content = chosen["xyz"].astype("<f4").tobytes() + chosen["rgb"].tobytes()
    return Response(content, media_type=CLOUD, headers=headers)


def _vertices(path: File, digest: str) -> np.ndarray:
    """The points of a cloud that this service wrote; the layout of others is not known here."""
    with path.open("rb") as file:
        header, end, _ = file.read(HEADER_BYTES).partition(b"end_header\n")
    count = re.search(rb"element vertex (\d+)", header)
    if not end or count is None:
        raise ArtifactDamaged(digest, "is no cloud of this service")
    return np.fromfile(path, dtype=VERTEX, count=int(count[1]), offset=len(header) + len(end))


def _entries(archive: zipfile.ZipFile) -> list[dict[str, Any]]:
    entries: list[dict[str, Any]] = json.loads(archive.read("transforms.json"))["frames"]
    return entries


def _described(entry: dict[str, Any]) -> Picture:
    return Picture(
        camera=str(entry["camera_id"]), width=int(entry["w"]), height=int(entry["h"]), time_s=float(entry["time_s"])
    )


def _frame_file(parts: Parts, scan_id: str, owner: str, frame: int) -> StoredFile:
    """The frame's pictures, which one of two kinds of steps has made."""
    try:
        return _file(parts, scan_id, owner, "frame", RENDER, frame)
    except NotFound:
        return _file(parts, scan_id, owner, "frame", READ, frame)


def _file(parts: Parts, scan_id: str, owner: str, role: str, kind: str, frame: int) -> StoredFile:
    with parts.store.read() as session:
        return find_artifact(session, get_scan(session, scan_id, owner=owner), role, kind=kind, frame=frame)
