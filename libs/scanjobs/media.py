"""Media types of the files that a scan makes, by their suffix."""

from pathlib import PurePath
from types import MappingProxyType
from typing import Final

DEFAULT: Final = "application/octet-stream"
BY_SUFFIX: Final = MappingProxyType(
    {
        ".npz": "application/x-npz",
        ".json": "application/json",
        ".html": "text/html",
        ".png": "image/png",
        ".svg": "image/svg+xml",
        ".jpg": "image/jpeg",
        ".ply": "model/ply",
        ".glb": "model/gltf-binary",
        ".vtp": "application/vnd.vtk.polydata+xml",
        ".mp4": "video/mp4",
        ".gif": "image/gif",
        ".zip": "application/zip",
        ".csv": "text/csv",
        ".txt": "text/plain",
        ".uff": "text/plain",
        ".parquet": "application/vnd.apache.parquet",
        ".pdf": "application/pdf",
    }
)


def media_type_of(name: str) -> str:
    """The media type of a file name."""
    return BY_SUFFIX.get(PurePath(name).suffix.lower(), DEFAULT)
