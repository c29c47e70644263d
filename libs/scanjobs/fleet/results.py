"""What a scan found, read from its files: the rows of its modes, each with its shape at a few sensors."""

import io
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from sqlalchemy import or_, select
from sqlalchemy.orm import Session

from scanjobs.artifacts import ArtifactStore
from scanjobs.errors import NotFound, ScanjobsError
from scanjobs.fleet.tables import PlantScan
from scanjobs.messages import IDENTIFY
from scanjobs.monitoring.shapes import pack
from scanjobs.repository import StoredFile, list_artifacts
from scanjobs.states import ScanState
from scanjobs.tables import Scan

DOCUMENT: Final = "modes.json"
REFUSED: Final = "rejected"
MOST: Final = 200
"""Scans read in one go; the next go takes the others."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Result:
    """The modes of one scan as rows of `observation`, or why there are none."""

    scan_id: str
    generation: int
    at: float
    rows: tuple[dict[str, Any], ...]
    problem: str | None = None


@dataclass(frozen=True, slots=True)
class Unread:
    """A scan that has succeeded and whose modes are not in the tables, with its files."""

    scan: Scan
    files: Mapping[str, StoredFile]


def unread_scans(session: Session, owner: str, plant_id: str) -> tuple[Unread, ...]:
    """Scans of a plant that have succeeded since they were looked at, the oldest first."""
    query = (
        select(Scan)
        .outerjoin(PlantScan, PlantScan.scan_id == Scan.id)
        .where(Scan.owner == owner, Scan.plant == plant_id, Scan.state == ScanState.SUCCEEDED)
        .where(or_(PlantScan.scan_id.is_(None), PlantScan.generation != Scan.generation))
        .order_by(Scan.id)
        .limit(MOST)
    )
    return tuple(Unread(scan, _files(session, scan)) for scan in session.scalars(query))


def read_result(artifacts: ArtifactStore, unread: Unread) -> Result:
    """The modes of a scan; files that cannot be read become its problem, not an exception."""
    scan = unread.scan
    try:
        rows = tuple(_rows(artifacts, unread.files))
    except (ScanjobsError, OSError, ValueError, KeyError, TypeError) as error:
        reason = f"{type(error).__name__}: {error}"[:255]
        return Result(scan_id=scan.id, generation=scan.generation, at=scan.created_at, rows=(), problem=reason)
    return Result(scan_id=scan.id, generation=scan.generation, at=scan.created_at, rows=rows)


def _files(session: Session, scan: Scan) -> dict[str, StoredFile]:
    return {file.role: file for file in list_artifacts(session, scan, kind=IDENTIFY)}


def _rows(artifacts: ArtifactStore, files: Mapping[str, StoredFile]) -> Iterator[dict[str, Any]]:
    if DOCUMENT not in files:
        raise NotFound("the scan has no modes.json.")
    document = json.loads(artifacts.path(files[DOCUMENT].digest).read_bytes())
    for organ in document["organs"]:
        for number, mode in enumerate(organ["modes"]):
            if not mode.get("natural_frequency_hz"):
                continue
            yield _row(str(organ["name"])[:64], number, mode) | {"shape": _shape(artifacts, files, mode)}


def _row(organ: str, number: int, mode: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "organ": organ,
        "mode": number,
        "frequency_hz": float(mode["natural_frequency_hz"]),
        "frequency_std_hz": mode.get("natural_frequency_hz_std"),
        "damping_ratio": mode.get("damping_ratio"),
        "damping_ratio_std": mode.get("damping_ratio_std"),
        "amplitude_m": mode.get("amplitude_m"),
        "verdict": str(mode.get("verdict", REFUSED)),
    }


def _shape(artifacts: ArtifactStore, files: Mapping[str, StoredFile], mode: Mapping[str, Any]) -> bytes | None:
    """A few sensors of the shape; a rejected mode is joined to nothing and needs none."""
    file = files.get(str(mode.get("shape")))
    if file is None or mode.get("verdict") == REFUSED:
        return None
    with np.load(io.BytesIO(artifacts.path(file.digest).read_bytes()), allow_pickle=False) as arrays:
        return pack(arrays["positions"], arrays["shape"], arrays["directions"])
