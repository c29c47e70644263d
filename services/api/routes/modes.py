"""What was identified: the modes.json document, and each mode's shape as arrays or as JSON."""

import io
import json
from collections.abc import Mapping
from typing import Annotated, Any, Literal

import numpy as np
from fastapi import APIRouter, Path, Query
from fastapi.responses import JSONResponse, Response
from scanjobs.errors import NotFound
from scanjobs.messages import IDENTIFY
from scanjobs.repository import find_artifact, get_scan

from services.api.dependencies import Owner, Parts, ScanId, TheParts
from services.api.routes.artifacts import find
from services.api.schemas import ModeShape

NPZ = "application/vnd.numpy.npz"
Arrays = Mapping[str, np.ndarray]
SO_FAR = "so_far/modes.json"
"""The role of the modes of the first frames, told while the others are computed."""
PER_SENSOR = ("positions", "shape")
router = APIRouter(prefix="/v1/scans/{scan_id}/modes", tags=["modes"])


@router.get("", response_class=JSONResponse)
def modes(scan_id: ScanId, parts: TheParts, owner: Owner) -> Response:
    """The scan's modes.json, byte for byte: accepted, doubtful and rejected modes with their verdicts.

    Before the end: the newest modes so far, where the specification asks for them with `partial_every`; their key
    `partial` says of how many frames they are.
    """
    return Response(_document_bytes(parts, scan_id, owner), media_type="application/json")


@router.get(
    "/{k}/shape",
    response_model=ModeShape,
    responses={200: {"content": {NPZ: {"schema": {"type": "string", "format": "binary"}}}}},
)
def shape(
    scan_id: ScanId,
    k: Annotated[int, Path(ge=0, description="Which mode, from 0, in the order of modes.json.")],
    parts: TheParts,
    owner: Owner,
    organ: Annotated[str | None, Query(description="Count only the modes of this organ.")] = None,
    format: Literal["npz", "json"] = "json",  # noqa: A002
    max_points: Annotated[int | None, Query(ge=1, description="At most so many sensors, evenly chosen.")] = None,
) -> Response:
    """A mode's shape at its sensors; modes are counted through all organs unless one is named."""
    name, mode = pick(json.loads(_document_bytes(parts, scan_id, owner)), k, organ)
    file = find(parts, scan_id, owner, str(mode["shape"]))
    with np.load(parts.artifacts.path(file.digest), allow_pickle=False) as archive:
        arrays = thin({key: archive[key] for key in ("positions", "shape", "directions")}, max_points)
    if format == "npz":
        return Response(as_npz(arrays), media_type=NPZ)
    frequency = mode.get("natural_frequency_hz")
    return JSONResponse(as_json(arrays, name, frequency))


def pick(document: Mapping[str, Any], k: int, organ: str | None) -> tuple[str, Mapping[str, Any]]:
    """The organ's name and the entry of mode `k`. Raises `NotFound`."""
    entries = [
        (str(row["name"]), mode)
        for row in document["organs"]
        if organ is None or row["name"] == organ
        for mode in row["modes"]
    ]
    if k >= len(entries):
        where = f"of organ '{organ}' " if organ else ""
        raise NotFound(f"there is no mode {k} {where}among {len(entries)}.", hint="Count from 0 as in modes.json.")
    name, mode = entries[k]
    if not mode.get("shape"):
        raise NotFound(f"mode {k} has no shape.", hint="Choose one whose 'shape' in modes.json names a file.")
    return name, mode


def thin(arrays: Arrays, max_points: int | None) -> Arrays:
    """The same with at most `max_points` sensors, evenly chosen, the first and the last among them."""
    sensors = len(arrays["positions"])
    if max_points is None or sensors <= max_points:
        return arrays
    chosen = np.unique(np.linspace(0, sensors - 1, max_points).round().astype(int))
    return {key: value[chosen] if key in PER_SENSOR else value for key, value in arrays.items()}


def as_npz(arrays: Arrays) -> bytes:
    """The arrays as the bytes of an .npz."""
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays)
    return buffer.getvalue()


def as_json(arrays: Arrays, organ: str, frequency: float | None) -> dict[str, Any]:
    """The arrays as `ModeShape`; six digits are a micrometre of a metre."""
    return {
        "organ": organ,
        "natural_frequency_hz": frequency,
        "positions_m": np.round(arrays["positions"], 6).tolist(),
        "directions": np.round(arrays["directions"], 6).tolist(),
        "shape": np.round(arrays["shape"], 6).tolist(),
    }


def _document_bytes(parts: Parts, scan_id: str, owner: str) -> bytes:
    with parts.store.read() as session:
        scan = get_scan(session, scan_id, owner=owner)
        try:
            file = find_artifact(session, scan, "modes.json", kind=IDENTIFY)
        except NotFound as error:
            try:
                file = find_artifact(session, scan, SO_FAR, kind=IDENTIFY)
            except NotFound:
                raise error from None
    return parts.artifacts.path(file.digest).read_bytes()
