"""Cameras out of the pictures of one instant: structure from motion by COLMAP (pycolmap, on the CPU).

J. Schönberger and J.-M. Frahm, "Structure-from-motion revisited", CVPR 2016. The world that comes out has no unit, and
no up: it is turned so that +z is the mean of the pictures' up, with its origin where the optical axes meet.
"""

import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import UInt8

from nerfmodal.capture.colmap import read_model
from nerfmodal.capture.record import FEWEST_CAMERAS
from nerfmodal.errors import InvalidCapture, MissingExtra
from nerfmodal.geometry.cameras import focus_of
from nerfmodal.io.frames import encode_png
from nerfmodal.types import Camera, Rig

LEAST_REGISTERED = 0.8
"""Share of the cameras that must be solved: a rig with holes measures with holes."""
WORST_ERROR_PX = 2.0
"""Mean reprojection error above which poses are not believed."""
LARGEST_SIDE = 2000
FEWEST_MATCHES = 15
SEED = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class Solution:
    """Solved cameras, in an unknown unit, and what COLMAP says of them (counts; `error_px`, the mean reprojection)."""

    cameras: tuple[Camera, ...]
    unsolved: tuple[str, ...]
    error_px: float
    points: int


def solve(
    pictures: Mapping[str, UInt8[np.ndarray, "height width 3"]],
    *,
    one_lens: bool,
    where: str,
    told: Callable[[str], None],
) -> Solution:
    """Solve the cameras whose pictures of one instant these are.

    Raises
    ------
    InvalidCapture
        When too few cameras register, naming those and the remedy.
    MissingExtra
        Without pycolmap.
    """
    colmap = _import_pycolmap()
    with tempfile.TemporaryDirectory(prefix="nerfmodal-solve-") as folder:
        below = Path(folder)
        for name, picture in pictures.items():
            (below / "images").mkdir(exist_ok=True)
            (below / "images" / f"{name}.png").write_bytes(encode_png(picture))
        model = _largest_model(colmap, below, one_lens=one_lens, told=told)
        if model is None:
            raise _refusal(tuple(pictures), pictures, where, "no two pictures show enough of the same")
        model.write_text(str(below))
        cameras = tuple(replace(one, name=one.name.removesuffix(".png")) for one in read_model(below))
        error, points = float(model.compute_mean_reprojection_error()), int(model.num_points3D())
    solved = {one.name for one in cameras}
    unsolved = tuple(name for name in pictures if name not in solved)
    if len(cameras) < max(FEWEST_CAMERAS, LEAST_REGISTERED * len(pictures)):
        raise _refusal(unsolved, pictures, where, f"only {len(cameras)} of {len(pictures)} register")
    if error > WORST_ERROR_PX:
        raise _refusal((), pictures, where, f"the solution misses its own points by {error:.1f} pixels")
    told(f"{len(cameras)} cameras solved, {points} points, {error:.2f} px")
    upright = _upright(tuple(sorted(cameras, key=lambda one: one.name)))
    return Solution(cameras=upright, unsolved=unsolved, error_px=error, points=points)


def moved(cameras: Sequence[Camera], scale: float, rotation: np.ndarray, shift: np.ndarray) -> tuple[Camera, ...]:
    """The cameras after the similarity x -> scale rotation x + shift of their world."""
    poses = []
    for camera in cameras:
        pose = camera.camera_to_world.copy()
        pose[:3, :3] = rotation @ pose[:3, :3]
        pose[:3, 3] = scale * rotation @ pose[:3, 3] + shift
        poses.append(replace(camera, camera_to_world=pose))
    return tuple(poses)


def _largest_model(colmap: Any, below: Path, *, one_lens: bool, told: Callable[[str], None]) -> Any:
    database = below / "database.db"
    colmap.logging.minloglevel = int(colmap.logging.ERROR.value)
    colmap.set_random_seed(SEED)
    told("finding features")
    reader = colmap.ImageReaderOptions()
    reader.camera_model = "OPENCV" if one_lens else "SIMPLE_RADIAL"
    extraction = colmap.FeatureExtractionOptions()
    extraction.max_image_size = LARGEST_SIDE
    extraction.use_gpu = False
    colmap.extract_features(
        database,
        below / "images",
        camera_mode=colmap.CameraMode.SINGLE if one_lens else colmap.CameraMode.PER_IMAGE,
        reader_options=reader,
        extraction_options=extraction,
        device=colmap.Device.cpu,
    )
    told("matching every pair")
    matching = colmap.FeatureMatchingOptions()
    matching.use_gpu = False
    colmap.match_exhaustive(database, matching_options=matching, device=colmap.Device.cpu)
    told("solving")
    (below / "models").mkdir()
    options = colmap.IncrementalPipelineOptions()
    options.min_num_matches = FEWEST_MATCHES
    options.random_seed = SEED
    models = colmap.incremental_mapping(database, below / "images", below / "models", options)
    return max(models.values(), key=lambda one: one.num_reg_images(), default=None)


def _upright(cameras: tuple[Camera, ...]) -> tuple[Camera, ...]:
    ups = np.stack([camera.camera_to_world[:3, 1] for camera in cameras])
    up = ups.mean(axis=0) / np.linalg.norm(ups.mean(axis=0))
    rotation = turn_to_z(up)
    center, _ = focus_of(Rig(cameras=cameras))
    return moved(cameras, 1.0, rotation, -rotation @ center)


def turn_to_z(up: np.ndarray) -> np.ndarray:
    """The shortest rotation (3, 3) that brings the unit vector `up` to +z (Rodrigues)."""
    axis = np.cross(up, [0.0, 0.0, 1.0])
    cosine = float(up[2])
    if cosine < -1 + 1e-9:
        return np.diag([1.0, -1.0, -1.0])
    skew = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    return np.asarray(np.eye(3) + skew + skew @ skew / (1 + cosine))


def _refusal(unsolved: Sequence[str], pictures: Mapping[str, Any], where: str, reason: str) -> InvalidCapture:
    left = f"; without a pose: {', '.join(unsolved)}" if unsolved else ""
    return InvalidCapture(
        f"the {len(pictures)} cameras cannot be solved from their first pictures: {reason}{left}.",
        where=where,
        hint="Neighbours must see the same textured things from less than about 25 degrees apart: add cameras between, "
        "put patterned cloth or newspaper into the scene, or give the poses (transforms.json, rig.json, COLMAP).",
    )


def _import_pycolmap() -> Any:
    try:
        import pycolmap
    except ImportError as missing:
        raise MissingExtra("pycolmap", "capture") from missing
    return pycolmap
