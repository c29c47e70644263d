"""Cameras out of the pictures of one instant: structure from motion by COLMAP (pycolmap, on the CPU).

J. Schönberger and J.-M. Frahm, "Structure-from-motion revisited", CVPR 2016. The world that comes out has no unit, and
no up: it is turned so that +z is the mean of the pictures' up, with its origin where the optical axes meet.
"""

import importlib.util
import json
import subprocess
import sys
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
    if importlib.util.find_spec("pycolmap") is None:
        raise MissingExtra("pycolmap", "capture")
    with tempfile.TemporaryDirectory(prefix="nerfmodal-solve-") as folder:
        below = Path(folder)
        for name, picture in pictures.items():
            (below / "images").mkdir(exist_ok=True)
            (below / "images" / f"{name}.png").write_bytes(encode_png(picture))
        _run(below, one_lens=one_lens, told=told, where=where)
        if not (below / "solution.json").is_file():
            raise _refusal(tuple(pictures), pictures, where, "no two pictures show enough of the same")
        cameras = tuple(replace(one, name=one.name.removesuffix(".png")) for one in read_model(below))
        figures = json.loads((below / "solution.json").read_text())
    error, points = float(figures["error_px"]), int(figures["points"])
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


def _run(below: Path, *, one_lens: bool, told: Callable[[str], None], where: str) -> None:
    """Let COLMAP solve `below` in a process of its own; whatever `told` raises ends it."""
    command = [sys.executable, "-m", "nerfmodal.capture.structure", str(below), *(["--one-lens"] if one_lens else [])]
    log = below / "log.txt"
    with (
        log.open("w") as errors,
        subprocess.Popen(command, stdout=subprocess.PIPE, stderr=errors, text=True) as process,
    ):
        try:
            for line in process.stdout or ():
                told(line.strip())
        except BaseException:
            process.kill()
            raise
    if process.returncode:
        lines = log.read_text().strip().splitlines()
        raise InvalidCapture(
            f"COLMAP ended with code {process.returncode} ({lines[-1] if lines else 'no word'}).",
            where=where,
            hint="Try again with smaller pictures, or give the poses.",
        )


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
