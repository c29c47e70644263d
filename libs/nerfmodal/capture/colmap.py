"""COLMAP models, text and binary: cameras.* and images.* (colmap.github.io/format.html); points are not read.

COLMAP's camera looks along +z with y down and its poses lead from world to camera; pixel centres lie at half integers
as here. Its world has neither metres nor an up: see `CaptureSource.scale`.
"""

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from nerfmodal.errors import InvalidCapture
from nerfmodal.types import Camera, DistortionModel

MODELS = ("SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "OPENCV_FISHEYE")
"""In COLMAP's order: the number of a model in a binary file is its place here."""
COUNTS = {"SIMPLE_PINHOLE": 3, "PINHOLE": 4, "SIMPLE_RADIAL": 4, "RADIAL": 5, "OPENCV": 8, "OPENCV_FISHEYE": 8}
FOLDERS = ("sparse/0", "sparse", "colmap/sparse/0", "")
"""Where a model lies in a capture; the first that exists is read."""
FLIP = np.diag([1.0, -1.0, -1.0])
"""COLMAP's camera axes to OpenGL's."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Lens:
    """The intrinsics of a COLMAP camera."""

    width: int
    height: int
    focal: tuple[float, float]
    center: tuple[float, float]
    model: DistortionModel
    distortion: tuple[float, float, float, float, float, float]


def model_folder(capture: Path) -> Path | None:
    """The folder with cameras.bin or cameras.txt; None where there is none."""
    folders = [capture / name for name in FOLDERS]
    return next(
        (one for one in folders if any((one / f"cameras.{suffix}").is_file() for suffix in ("bin", "txt"))), None
    )


def read_model(folder: Path) -> tuple[Camera, ...]:
    """A camera for every registered image, named after the image (its file_path).

    Raises
    ------
    InvalidCapture
        When a file is broken, or a camera has a model that is not read.
    """
    suffix = "bin" if (folder / "cameras.bin").is_file() else "txt"
    cameras, images = folder / f"cameras.{suffix}", folder / f"images.{suffix}"
    try:
        lenses = dict(_binary_lenses(cameras) if suffix == "bin" else _text_lenses(cameras))
        poses = list(_binary_poses(images) if suffix == "bin" else _text_poses(images))
        return tuple(_camera(name, lenses[lens], pose, str(images)) for name, lens, pose in poses)
    except FileNotFoundError as error:
        raise InvalidCapture("is missing.", where=str(error.filename), hint="Copy the whole model.") from error
    except (OSError, ValueError, KeyError, IndexError, struct.error) as error:
        raise InvalidCapture(
            f"is no COLMAP model ({error!r}).", where=str(folder), hint="Export it again with COLMAP's model_converter."
        ) from error


def _camera(name: str, lens: Lens, pose: np.ndarray, where: str) -> Camera:
    if not np.isfinite(pose).all():
        raise InvalidCapture(f"the pose of {name!r} is not finite.", where=where, hint="Solve the cameras again.")
    world_to_camera = np.eye(4)
    world_to_camera[:3, :3], world_to_camera[:3, 3] = rotation_of(pose[:4]), pose[4:]
    camera_to_world = np.linalg.inv(world_to_camera)
    camera_to_world[:3, :3] = camera_to_world[:3, :3] @ FLIP
    return Camera(
        name=name,
        width=lens.width,
        height=lens.height,
        focal_x=lens.focal[0],
        focal_y=lens.focal[1],
        center_x=lens.center[0],
        center_y=lens.center[1],
        camera_to_world=camera_to_world,
        model=lens.model,
        distortion=lens.distortion,
    )


def rotation_of(quaternion: np.ndarray) -> np.ndarray:
    """Rotation matrix (3, 3) of a quaternion (w, x, y, z), of any length but zero."""
    w, x, y, z = quaternion / np.linalg.norm(quaternion)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def lens_of(model: str, width: int, height: int, numbers: tuple[float, ...], where: str) -> Lens:
    """The lens that COLMAP's parameters describe. Raises `InvalidCapture` for a model that is not read."""
    if model not in MODELS:
        raise InvalidCapture(
            f"has the camera model {model}.",
            where=where,
            hint=f"Use one of {', '.join(MODELS)}, or undistort the pictures with COLMAP's image_undistorter.",
        )
    shared = model in ("SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL")
    fx, fy, cx, cy, *bends = (numbers[0], *numbers) if shared else numbers
    kind: DistortionModel = (
        "fisheye" if model == "OPENCV_FISHEYE" else "pinhole" if model.endswith("PINHOLE") else "opencv"
    )
    k1, k2, third, fourth = (*bends, 0.0, 0.0, 0.0, 0.0)[:4]
    tangential = model == "OPENCV"
    distortion = (k1, k2, 0.0, 0.0, third, fourth) if tangential else (k1, k2, third, fourth, 0.0, 0.0)
    return Lens(width=width, height=height, focal=(fx, fy), center=(cx, cy), model=kind, distortion=distortion)


def _text_lenses(path: Path) -> Iterator[tuple[int, Lens]]:
    for line in path.read_text().splitlines():
        if line.strip() and not line.startswith("#"):
            number, model, width, height, *values = line.split()
            yield int(number), lens_of(model, int(width), int(height), tuple(map(float, values)), str(path))


def _text_poses(path: Path) -> Iterator[tuple[str, int, np.ndarray]]:
    """Two lines an image; the second, its points, may be empty."""
    lines = [line for line in path.read_text().splitlines() if not line.startswith("#")]
    for line in lines[::2]:
        if line.strip():
            _, *pose, lens, name = line.split(maxsplit=9)
            yield name, int(lens), np.array(pose, dtype=float)


def _binary_lenses(path: Path) -> Iterator[tuple[int, Lens]]:
    data = path.read_bytes()
    (count,), place = struct.unpack_from("<Q", data), 8
    for _ in range(count):
        number, kind, width, height = struct.unpack_from("<iiQQ", data, place)
        model = MODELS[kind] if 0 <= kind < len(MODELS) else f"number {kind}"
        size = COUNTS.get(model, 0)
        values = struct.unpack_from(f"<{size}d", data, place + 24)
        yield number, lens_of(model, width, height, values, str(path))
        place += 24 + 8 * size


def _binary_poses(path: Path) -> Iterator[tuple[str, int, np.ndarray]]:
    data = path.read_bytes()
    (count,), place = struct.unpack_from("<Q", data), 8
    for _ in range(count):
        _, *pose, lens = struct.unpack_from("<i7di", data, place)
        end = data.index(b"\0", place + 64)
        name = data[place + 64 : end].decode()
        (points,) = struct.unpack_from("<Q", data, end + 1)
        place = end + 9 + 24 * points
        yield name, lens, np.array(pose)
