"""The nerfstudio / instant-ngp `transforms.json`: cameras out of its entries and back.

A key may stand in the frame's entry or at the top of the file; the entry wins. OpenGL cameras, camera-to-world.
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from nerfmodal.errors import InvalidCapture
from nerfmodal.types import Camera, DistortionModel

MODELS: dict[str, DistortionModel] = {
    "OPENCV": "opencv",
    "RADIAL": "opencv",
    "SIMPLE_RADIAL": "opencv",
    "PINHOLE": "pinhole",
    "SIMPLE_PINHOLE": "pinhole",
    "OPENCV_FISHEYE": "fisheye",
}
NAMES = {model: name for name, model in reversed(MODELS.items())}
COEFFICIENTS = ("k1", "k2", "k3", "k4", "p1", "p2")


def camera_entry(camera: Camera) -> dict[str, Any]:
    """The entry of a camera, with everything in it that `parse_camera` reads."""
    return {
        "camera_id": camera.name,
        "w": camera.width,
        "h": camera.height,
        "fl_x": camera.focal_x,
        "fl_y": camera.focal_y,
        "cx": camera.center_x,
        "cy": camera.center_y,
        "camera_model": NAMES[camera.model],
        **dict(zip(COEFFICIENTS, camera.distortion, strict=True)),
        "transform_matrix": camera.camera_to_world.tolist(),
    }


def parse_camera(entry: Mapping[str, Any], top: Mapping[str, Any], where: str) -> Camera:
    """The camera of one entry.

    Parameters
    ----------
    entry, top
        The frame's entry and the whole file; keys missing in the first are looked up in the second.
    where
        What an error names.

    Raises
    ------
    InvalidCapture
        When the pose or the focal length is missing, not finite or not rigid.
    """
    keys = {**top, **entry}
    name = str(keys.get("camera_id", entry.get("file_path", "camera")))
    width, height = _size(keys, where)
    focal_x = _focal(keys, "x", width, where)
    distortion = tuple(_number(keys.get(key, 0.0), key, where) for key in COEFFICIENTS)
    default = "OPENCV_FISHEYE" if keys.get("is_fisheye") else "OPENCV" if any(distortion) else "PINHOLE"
    model = _model(str(keys.get("camera_model", default)), where)
    return Camera(
        name=name.rsplit("/", 1)[-1],
        width=width,
        height=height,
        focal_x=focal_x,
        focal_y=_focal(keys, "y", height, where) if "fl_y" in keys or "camera_angle_y" in keys else focal_x,
        center_x=_number(keys.get("cx", width / 2), "cx", where),
        center_y=_number(keys.get("cy", height / 2), "cy", where),
        camera_to_world=rigid_pose(keys.get("transform_matrix"), where),
        model=model,
        distortion=(0.0,) * 6 if model == "pinhole" else distortion,  # type: ignore[arg-type]
    )


def _size(keys: Mapping[str, Any], where: str) -> tuple[int, int]:
    try:
        return int(_number(keys["w"], "w", where)), int(_number(keys["h"], "h", where))
    except KeyError as error:
        raise InvalidCapture(
            f"has no picture size ({error.args[0]!r} is missing).", where=where, hint="Add 'w' and 'h' in pixels."
        ) from error


def _focal(keys: Mapping[str, Any], axis: str, size: int, where: str) -> float:
    if f"fl_{axis}" in keys:
        focal = _number(keys[f"fl_{axis}"], f"fl_{axis}", where)
    elif f"camera_angle_{axis}" in keys:
        focal = 0.5 * size / math.tan(0.5 * _number(keys[f"camera_angle_{axis}"], f"camera_angle_{axis}", where))
    else:
        raise InvalidCapture("has no focal length.", where=where, hint="Add 'fl_x' in pixels or 'camera_angle_x'.")
    if focal <= 0:
        raise InvalidCapture(f"has the focal length {focal}.", where=where, hint="It must be positive, in pixels.")
    return focal


def _model(name: str, where: str) -> DistortionModel:
    if name not in MODELS:
        raise InvalidCapture(
            f"has the unknown camera_model {name!r}.", where=where, hint=f"Use one of {', '.join(MODELS)}."
        )
    return MODELS[name]


def _number(value: Any, key: str, where: str) -> float:
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = math.nan
    if not math.isfinite(number):
        raise InvalidCapture(f"has {key} = {value!r}.", where=where, hint="Give a finite number.")
    return number


def rigid_pose(value: Any, where: str) -> np.ndarray:
    """A camera-to-world matrix (4, 4), m. Raises `InvalidCapture` when it is missing, not finite or not rigid."""
    if value is None:
        raise InvalidCapture(
            "has no pose ('transform_matrix' is missing).",
            where=where,
            hint="Give every entry its pose, or no file of poses at all: then they are solved from the pictures.",
        )
    try:
        pose = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        pose = np.empty(0)
    if pose.shape == (3, 4):
        pose = np.vstack([pose, [0, 0, 0, 1]])
    if pose.shape != (4, 4) or not np.isfinite(pose).all():
        raise InvalidCapture(
            "has a pose that is not a finite 4x4 matrix.", where=where, hint="Solve the cameras again."
        )
    rotation = pose[:3, :3]
    if np.abs(rotation @ rotation.T - np.eye(3)).max() > 1e-3 or np.linalg.det(rotation) < 0:
        raise InvalidCapture(
            "has a pose that is not rigid (a scale, a shear or a mirror is in it).",
            where=where,
            hint="Give camera-to-world rotations without scale.",
        )
    return pose
