"""The ground is found where it is, level or tilted, behind what stands on it; and nowhere when no plane is there."""

from dataclasses import replace

import numpy as np
import pytest
from nerfmodal.field import find_ground
from nerfmodal.geometry.cameras import semi_spherical_rig
from nerfmodal.geometry.rays import rig_directions
from nerfmodal.spec import RigSpec
from nerfmodal.types import Frame, Rig

SIDE = 64
TARGET = np.array([0.4, -0.3, 0.8])
RIG = semi_spherical_rig(RigSpec(cameras=12, width_px=SIDE, height_px=SIDE, radius_m=2.2, target_m=(0.4, -0.3, 0.8)))


def tones(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """A carpet whose pattern does not come again: waves of 60 cm to 2 m."""
    return np.asarray(
        128 + 40 * (np.sin(3 * x + 1.5 * y) + np.sin(5.5 * y - 2.5 * x + 1) + np.sin(8 * x + 6 * y + 2)), dtype=float
    )


def filmed(plane: tuple[float, float, float], rig: Rig = RIG) -> Frame:
    """A black ball over the plane z = h + a x + b y, under a plain sky."""
    height, along_x, along_y = plane
    normal = np.array([-along_x, -along_y, 1.0])
    pictures = []
    for camera, directions in zip(rig.cameras, rig_directions(rig), strict=True):
        origin = camera.camera_to_world[:3, 3]
        slant = directions @ normal
        t = (height - origin @ normal) / np.where(slant < -1e-3, slant, -1e-3)
        points = origin + t[:, None] * directions
        floor = np.where(slant < -1e-3, tones(points[:, 0], points[:, 1]), 220)
        missed = np.linalg.norm(np.cross(directions, TARGET - origin), axis=1)
        pictures.append(np.where(missed < 0.4, 0, floor))
    grey = np.clip(np.stack(pictures), 0, 255).round().astype(np.uint8).reshape(-1, SIDE, SIDE, 1)
    return Frame(index=0, time=0.0, images=np.repeat(grey, 3, axis=-1), rig=rig)


@pytest.mark.parametrize("plane", [(0.0, 0.0, 0.0), (-0.35, 0.0, 0.0), (0.1, 0.06, -0.09)])
def test_it_is_found_behind_what_stands_on_it(plane: tuple[float, float, float]) -> None:
    found = find_ground(filmed(plane))
    assert found is not None
    x, y = np.meshgrid([-1.0, 0.0, 1.0], [-1.0, 0.0, 1.0])
    off = found[0] - plane[0] + (found[1] - plane[1]) * x + (found[2] - plane[2]) * y
    assert np.abs(off).max() < 0.016  # half of a pixel's footprint


def test_cameras_that_count_for_nothing_say_nothing() -> None:
    """Masked pixels show noise: the ground is found in the others."""
    frame = filmed((0.0, 0.0, 0.0))
    counts = np.ones(frame.images.shape[:3], dtype=bool)
    counts[:, : SIDE // 3] = False
    noise = np.random.default_rng(0).integers(0, 256, frame.images.shape, dtype=np.uint8)
    masked = replace(frame, images=np.where(counts[..., None], frame.images, noise), counts=counts)
    found = find_ground(masked)
    assert found is not None
    assert abs(found[0]) < 0.016


@pytest.mark.parametrize("what", ["noise", "plain", "a wall of pictures"])
def test_where_no_plane_explains_the_pictures_there_is_none(what: str) -> None:
    frame = filmed((0.0, 0.0, 0.0))
    rng = np.random.default_rng(1)
    if what == "noise":
        images = rng.integers(0, 256, frame.images.shape, dtype=np.uint8)
    elif what == "plain":
        images = np.full_like(frame.images, 128)
    else:  # every camera sees another place
        images = frame.images[rng.permutation(len(frame.images))]
    assert find_ground(replace(frame, images=images)) is None


def test_two_cameras_cannot_tell() -> None:
    frame = filmed((0.0, 0.0, 0.0))
    pair = Rig(cameras=frame.rig.cameras[:2])
    assert find_ground(replace(frame, images=frame.images[:2], rig=pair)) is None
