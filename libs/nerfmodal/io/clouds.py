"""One point cloud as PLY: any PLY is read, binary PLY is written."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from nerfmodal.errors import InvalidClouds
from nerfmodal.io.atomic import atomic_write
from nerfmodal.types import Outcome, PointCloud

HEADER_BYTES = 4000
COMMENT = re.compile(rb"comment nerfmodal time_s (\S+) outcome (\S+)")
DEVICE = re.compile(rb"^comment nerfmodal device (.*)$", re.MULTILINE)
STD = "displacement_std"
"""Vertex property (m) of clouds whose points are material."""
COUNT = re.compile(rb"element vertex (\d+)")


def write_cloud(path: Path, cloud: PointCloud) -> None:
    """Write a cloud as binary PLY: double positions, 8-bit colours, what is known of their precision.

    Time and outcome stand in a comment.
    """
    layout = [("xyz", "<f8", 3), ("rgb", "u1", 3), *([("std", "<f4")] if cloud.stds is not None else [])]
    vertices = np.empty(len(cloud.points), dtype=layout)  # packed, so that its bytes are the file's
    vertices["xyz"] = cloud.points
    vertices["rgb"] = np.round(np.clip(cloud.colors, 0, 1) * 255)
    properties = [f"property double {axis}" for axis in "xyz"]
    properties += [f"property uchar {color}" for color in ("red", "green", "blue")]
    if cloud.stds is not None:
        vertices["std"] = cloud.stds
        properties.append(f"property float {STD}")
    device = [f"comment nerfmodal device {cloud.device}"] if cloud.device else []
    header = [
        "ply",
        "format binary_little_endian 1.0",
        f"comment nerfmodal time_s {cloud.time!r} outcome {cloud.outcome.name}",
        *device,
        f"element vertex {len(vertices)}",
        *properties,
        "end_header",
    ]
    with atomic_write(path) as temporary:
        temporary.write_bytes("\n".join([*header, ""]).encode() + vertices.tobytes())


def read_cloud(path: Path, *, time: float | None = None, scale: float = 1.0) -> PointCloud:
    """Read any PLY with vertices: ASCII or binary, float or double, whatever else a vertex has.

    Parameters
    ----------
    time
        Its instant, seconds; by default what the file says of itself, or 0.
    scale
        Metres in the file's unit of length.

    Raises
    ------
    InvalidClouds
        When the file cannot be read or holds a coordinate that is no number.
    """
    try:
        header = _header(path)
        loaded = trimesh.load(path, file_type="ply", process=False)  # whatever the file is called
        empty = _count(header) == 0  # trimesh gives a scene without vertices for such a file
        points = np.empty((0, 3)) if empty else np.asarray(loaded.vertices, dtype=float) * scale
    except (OSError, ValueError, KeyError, IndexError, AttributeError) as error:
        raise InvalidClouds(
            f"cannot be read as PLY with vertices x, y, z ({error}).", where=str(path), hint="Export the cloud again."
        ) from error
    if len(points) != _count(header):
        raise InvalidClouds(
            f"ends early: {len(points)} of {_count(header)} points.", where=str(path), hint="Export the cloud again."
        )
    comment, device = COMMENT.search(header), DEVICE.search(header)
    return PointCloud(
        points=checked(points, str(path)),
        colors=_colors(loaded, len(points)),
        time=time if time is not None else float(comment[1]) if comment else 0.0,
        outcome=Outcome[comment[2].decode()] if comment else Outcome.OK,
        device=device[1].decode().strip() if device else "",
        stds=_stds(loaded, len(points), scale),
    )


def time_in(path: Path) -> float | None:
    """The instant (seconds) that a cloud written by `write_cloud` says of itself; None for any other file."""
    try:
        comment = COMMENT.search(_header(path))
        return float(comment[1]) if comment else None
    except (OSError, ValueError):
        return None


def checked(points: np.ndarray, where: str) -> np.ndarray:
    """The points (n, 3), or `InvalidClouds` when one is no number. An empty cloud passes: it is a lost frame."""
    if points.ndim != 2 or points.shape[1] != 3:
        raise InvalidClouds(f"has the shape {points.shape}.", where=where, hint="Points are rows of x, y, z.")
    if not np.isfinite(points).all():
        bad, axis = np.argwhere(~np.isfinite(points))[0]
        count = int((~np.isfinite(points).all(axis=1)).sum())
        raise InvalidClouds(
            f"holds NaN or infinity: {count} of {len(points)} points, the first at point {bad}, {'xyz'[axis]}.",
            where=where,
            hint="Leave out points that were not measured before writing the cloud.",
        )
    return points


def _header(path: Path) -> bytes:
    with path.open("rb") as file:
        return file.read(HEADER_BYTES).split(b"end_header")[0]


def _count(header: bytes) -> int:
    found = COUNT.search(header)
    return int(found[1]) if found else 0


def _stds(loaded: Any, count: int, scale: float) -> np.ndarray | None:
    raw = getattr(loaded, "metadata", {}).get("_ply_raw", {}).get("vertex", {}).get("data")
    names = raw if isinstance(raw, dict) else getattr(getattr(raw, "dtype", None), "names", None)  # ASCII or binary
    if raw is None or names is None or STD not in names or np.size(raw[STD]) != count:
        return None
    return np.asarray(raw[STD], dtype=float).reshape(count) * scale


def _colors(loaded: Any, count: int) -> np.ndarray:
    colors = getattr(loaded, "colors", None)
    if colors is None or np.shape(colors)[:1] != (count,):
        return np.full((count, 3), 0.5)
    return np.asarray(colors)[:, :3] / 255.0
