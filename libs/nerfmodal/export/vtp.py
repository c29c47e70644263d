"""Modes for ParaView (`shapes/<organ>_<k>.vtp`): VTK XML PolyData, little-endian, arrays inline as base64.

Points are the sensors at rest (world, metres); the point array `displacement` is the world displacement of a unit modal
coordinate (metres per metre), which "Warp By Vector" bends the surface with. A sheet's sensors are joined by triangles,
a rod's by one line. Source of the format: VTK File Formats, "XML File Formats", version 1.0 with UInt64 headers.
"""

import base64
import struct
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np

from nerfmodal.geometry.skins import rod_order, sheet_triangles
from nerfmodal.io import atomic_write
from nerfmodal.types import OrganResult


def write_vtp(organ: OrganResult, k: int, path: Path) -> Path:
    """Write mode `k` (counted from 0) of the organ as a .vtp."""
    with atomic_write(path) as temporary:
        temporary.write_text(vtp(organ, k), encoding="utf-8")
    return path


def vtp(organ: OrganResult, k: int) -> str:
    """The mode as the text of a .vtp."""
    positions = organ.displacement.sensors.positions
    motion = organ.model.mode_shapes[:, :, k] @ organ.displacement.directions
    lines, polygons = _cells(organ)
    fields = "".join(_array(name, np.array([number]), tuples=True) for name, number in _numbers(organ, k).items())
    return (
        '<?xml version="1.0"?>\n'
        '<VTKFile type="PolyData" version="1.0" byte_order="LittleEndian" header_type="UInt64">\n<PolyData>\n'
        f"<FieldData>\n{fields}</FieldData>\n"
        f'<Piece NumberOfPoints="{len(positions)}" NumberOfVerts="0" NumberOfLines="{len(lines)}" '
        f'NumberOfStrips="0" NumberOfPolys="{len(polygons)}">\n'
        f'<PointData Vectors="displacement">\n{_array("displacement", motion)}</PointData>\n'
        f"<Points>\n{_array('positions', positions)}</Points>\n"
        f"<Lines>\n{_connections(lines)}</Lines>\n<Polys>\n{_connections(polygons)}</Polys>\n"
        "</Piece>\n</PolyData>\n</VTKFile>\n"
    )


def _numbers(organ: OrganResult, k: int) -> dict[str, float]:
    """Of the mode, stored with the file; NaN where not known."""
    model = organ.model
    return {
        "natural_frequency_hz": float(model.frequencies[k]),
        "natural_frequency_hz_std": float(model.frequency_stds[k]),
        "damping_ratio": float(model.damping_ratios[k]),
        "damping_ratio_std": float(model.damping_stds[k]),
    }


def _cells(organ: OrganResult) -> tuple[np.ndarray, np.ndarray]:
    """Lines (lines, points) and polygons (polygons, corners) between sensors."""
    positions = organ.displacement.sensors.positions
    if organ.surface == "cylinder":
        return rod_order(positions)[None, :], np.empty((0, 3), dtype=int)
    return np.empty((0, 2), dtype=int), sheet_triangles(positions)


def _connections(cells: np.ndarray) -> str:
    ends = cells.shape[1] * np.arange(1, len(cells) + 1)
    return _array("connectivity", cells.ravel().astype("<i8")) + _array("offsets", ends.astype("<i8"))


def _array(name: str, values: np.ndarray, *, tuples: bool = False) -> str:
    """One DataArray: the number of bytes as UInt64 and the bytes, as base64."""
    whole = values.dtype.kind == "i"
    content = np.ascontiguousarray(values, dtype="<i8" if whole else "<f8").tobytes()
    text = base64.b64encode(struct.pack("<Q", len(content)) + content).decode("ascii")
    parts = f' NumberOfComponents="{values.shape[1]}"' if values.ndim == 2 else ""
    count = f' NumberOfTuples="{len(values)}"' if tuples else ""
    kind = "Int64" if whole else "Float64"
    return f'<DataArray type="{kind}" Name={quoteattr(name)}{parts}{count} format="binary">{text}</DataArray>\n'
