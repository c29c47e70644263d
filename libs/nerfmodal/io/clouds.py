"""Point clouds: binary PLY for one, a folder with clouds.json or an .npz for a sequence."""

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from nerfmodal.errors import InvalidClouds
from nerfmodal.io.atomic import atomic_write
from nerfmodal.types import Outcome, PointCloud

UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001}
COMMENT = re.compile(rb"comment nerfmodal time_s (\S+) outcome (\S+)")


def write_cloud(path: Path, cloud: PointCloud) -> None:
    """Write a cloud as binary PLY (double positions, 8-bit colours); time and outcome stand in a comment."""
    vertices = np.empty(
        len(cloud.points), dtype=[("xyz", "<f8", 3), ("rgb", "u1", 3)]
    )  # packed, so that its bytes are the file's
    vertices["xyz"] = cloud.points
    vertices["rgb"] = np.round(np.clip(cloud.colors, 0, 1) * 255)
    properties = [f"property double {axis}" for axis in "xyz"]
    properties += [f"property uchar {color}" for color in ("red", "green", "blue")]
    header = [
        "ply",
        "format binary_little_endian 1.0",
        f"comment nerfmodal time_s {cloud.time!r} outcome {cloud.outcome.name}",
        f"element vertex {len(vertices)}",
        *properties,
        "end_header",
    ]
    with atomic_write(path) as temporary:
        temporary.write_bytes("\n".join([*header, ""]).encode() + vertices.tobytes())


def read_cloud(path: Path, *, time: float = 0.0, scale: float = 1.0) -> PointCloud:
    """Read any PLY with vertices; `time` is used where the file does not tell its own.

    Raises
    ------
    InvalidClouds
        When the file cannot be read or holds a coordinate that is no number.
    """
    try:
        header = path.read_bytes()[:2000]
        loaded = trimesh.load(path, file_type="ply", process=False)  # whatever the file is called
        empty = b"element vertex 0\n" in header  # trimesh gives a scene without vertices for such a file
        points = np.empty((0, 3)) if empty else np.asarray(loaded.vertices, dtype=float) * scale
    except (OSError, ValueError, KeyError, IndexError, AttributeError) as error:
        raise InvalidClouds(
            f"cannot be read as PLY ({error}).", where=str(path), hint="Export the cloud again."
        ) from error
    comment = COMMENT.search(header)
    return PointCloud(
        points=checked(points, str(path)),
        colors=_colors(loaded, len(points)),
        time=float(comment[1]) if comment else time,
        outcome=Outcome[comment[2].decode()] if comment else Outcome.OK,
    )


def _colors(loaded: Any, count: int) -> np.ndarray:
    colors = getattr(loaded, "colors", None)
    if colors is None or np.shape(colors)[:1] != (count,):
        return np.full((count, 3), 0.5)
    return np.asarray(colors)[:, :3] / 255.0


def checked(points: np.ndarray, where: str) -> np.ndarray:
    """The points (n, 3), or `InvalidClouds` when one is no number. An empty cloud passes: it is a lost frame."""
    if points.ndim != 2 or points.shape[1] != 3:
        raise InvalidClouds(f"has the shape {points.shape}.", where=where, hint="Points are rows of x, y, z.")
    if not np.isfinite(points).all():
        bad = int(np.flatnonzero(~np.isfinite(points).all(axis=1))[0])
        raise InvalidClouds(f"holds NaN or infinity (point {bad}).", where=where, hint="Remove such points.")
    return points


def read_cloud_sequence(path: Path) -> tuple[float, Iterator[PointCloud]]:
    """Frame rate in Hz and the clouds, in order, of a folder (PLY + clouds.json) or of one .npz.

    Raises
    ------
    InvalidClouds
        At once for what concerns the whole; while iterating for a broken cloud.
    """
    if path.is_dir():
        return _read_folder(path)
    if path.suffix == ".npz" and path.is_file():
        return _read_npz(path)
    raise InvalidClouds(
        "is neither a folder of PLY files nor an .npz.",
        where=str(path),
        hint="Give a folder with frame_0000.ply … and clouds.json, or an .npz with frame_0000 … and frame_rate_hz.",
    )


def _read_folder(path: Path) -> tuple[float, Iterator[PointCloud]]:
    where = path / "clouds.json"
    try:
        header = json.loads(where.read_text())
    except (OSError, ValueError) as error:
        raise InvalidClouds(
            f"cannot be read ({error}).", where=str(where), hint='Write {"frame_rate_hz": …, "unit": "m"}.'
        ) from error
    files = sorted(path.glob("frame_*.ply"))
    unit = header.get("unit", "m")
    if unit not in UNITS:
        raise InvalidClouds(f"has the unit {unit!r}.", where=f"{where}#/unit", hint=f"Use one of {', '.join(UNITS)}.")
    rate = _rate(header.get("frame_rate_hz"), f"{where}#/frame_rate_hz")
    times = _times(header.get("times_s"), len(files), rate, f"{where}#/times_s")
    clouds = (read_cloud(file, time=float(time), scale=UNITS[unit]) for file, time in zip(files, times, strict=True))
    return rate, clouds


def _read_npz(path: Path) -> tuple[float, Iterator[PointCloud]]:
    try:
        archive = np.load(path, allow_pickle=False)
        names = sorted(name for name in archive.files if name.startswith("frame_") and name[6:].isdigit())
    except (OSError, ValueError) as error:
        raise InvalidClouds(f"cannot be read ({error}).", where=str(path), hint="Write it with numpy.savez.") from error
    rate = _rate(archive.get("frame_rate_hz"), f"{path}#/frame_rate_hz")
    times = _times(archive.get("times_s"), len(names), rate, f"{path}#/times_s")
    unit = UNITS.get(str(archive.get("unit", "m")), 1.0)

    def clouds() -> Iterator[PointCloud]:
        for name, time in zip(names, times, strict=True):
            points = checked(np.asarray(archive[name], dtype=float) * unit, f"{path}#/{name}")
            yield PointCloud(points=points, colors=np.full((len(points), 3), 0.5), time=float(time))

    return rate, clouds()


def _rate(value: Any, where: str) -> float:
    try:
        rate = float(value)
    except (TypeError, ValueError):
        rate = 0.0
    if not (np.isfinite(rate) and rate > 0):
        raise InvalidClouds(f"the frame rate is {value!r}.", where=where, hint="Give the frames per second, above 0.")
    return rate


def _times(value: Any, count: int, rate: float, where: str) -> np.ndarray:
    if count == 0:
        raise InvalidClouds("holds no clouds.", where=where.split("#")[0], hint="Name them frame_0000 and so on.")
    if value is None:
        return np.arange(count) / rate
    times = np.asarray(value, dtype=float)
    if times.shape != (count,):
        raise InvalidClouds(f"{times.size} times for {count} clouds.", where=where, hint="Give one time a cloud.")
    if not np.isfinite(times).all() or (np.diff(times) <= 0).any():
        raise InvalidClouds("the times do not increase.", where=where, hint="Put the clouds in the order of time.")
    return times
