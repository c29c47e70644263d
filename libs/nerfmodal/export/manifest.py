"""`manifest.json`: what a result consists of, so that a download can be checked file by file."""

import hashlib
import mimetypes
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from nerfmodal.export.modes import write_json

MEDIA_TYPES = {
    ".npz": "application/x-npz",
    ".ply": "application/x-ply",
    ".glb": "model/gltf-binary",
    ".uff": "application/x-uff",
    ".parquet": "application/vnd.apache.parquet",
    ".csv": "text/csv",
    ".vtp": "application/vnd.vtk.polydata+xml",
    ".zip": "application/zip",
    ".mp4": "video/mp4",
}
UNITS = {
    ".npz": "m, s, Hz",
    ".json": "in the keys (_hz, _s, _m)",
    ".csv": "in the columns (_hz, _m)",
    ".parquet": "in the columns (_hz, _m)",
    ".uff": "m, s, Hz",
    ".ply": "m",
    ".glb": "m",
    ".vtp": "m, Hz",
    ".zip": "m, s, Hz (attribute `unit` of every array)",
}
BLOCK = 1 << 20


def manifest(files: Sequence[Path], folder: Path) -> dict[str, Any]:
    """Path relative to `folder`, SHA-256, size, media type and units of each file, sorted by path."""
    return {"files": [_entry(path, folder) for path in sorted(files)]}


def write_manifest(files: Sequence[Path], folder: Path) -> Path:
    """Write `manifest.json` of `files` into `folder`."""
    return write_json(manifest(files, folder), folder / "manifest.json")


def media_type(path: Path) -> str:
    """The media type of a result file by its suffix."""
    return MEDIA_TYPES.get(path.suffix) or mimetypes.guess_type(path.name)[0] or "application/octet-stream"


def _entry(path: Path, folder: Path) -> dict[str, Any]:
    return {
        "path": path.relative_to(folder).as_posix(),
        "sha256": _digest(path),
        "bytes": path.stat().st_size,
        "media_type": media_type(path),
        "units": UNITS.get(path.suffix),
    }


def _digest(path: Path) -> str:
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while block := file.read(BLOCK):
            digest.update(block)
    return digest.hexdigest()
