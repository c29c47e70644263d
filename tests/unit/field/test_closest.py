"""The camera that sees a place most closely is found as by asking all of them, through every lens."""

from dataclasses import replace

import numpy as np
import pytest
from nerfmodal.field.closest import MARGIN, closest_cameras
from nerfmodal.geometry.cameras import project, semi_spherical_rig
from nerfmodal.spec import RigSpec
from nerfmodal.types import DistortionModel, Rig

SIDE = 48
LENSES: dict[DistortionModel, tuple[float, ...]] = {
    "pinhole": (0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    "opencv": (-0.12, 0.03, 0.0, 0.0, 0.002, -0.003),
    "fisheye": (0.05, -0.01, 0.002, 0.0, 0.0, 0.0),
}


def rig_of(model: DistortionModel) -> Rig:
    rig = semi_spherical_rig(RigSpec(cameras=7, width_px=SIDE, height_px=SIDE, radius_m=2.0, target_m=(0, 0, 0)))
    return Rig(cameras=tuple(replace(one, model=model, distortion=LENSES[model]) for one in rig.cameras))


def asked_of_all(rig: Rig, points: np.ndarray, clear: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """By `project`, camera after camera."""
    closest, nearest, places = np.full(len(points), -1), np.zeros(len(points)), np.empty((len(points), 2))
    for number, camera in enumerate(rig.cameras):
        shown, depths = project(camera, points)
        seen = (depths > 0) & (shown > MARGIN).all(axis=1) & (shown < SIDE - MARGIN).all(axis=1)
        seen[seen] = clear[number][tuple(shown[seen].astype(int).T[::-1])]
        rays = points - camera.camera_to_world[:3, 3]
        nearness = -rays[:, 2] / (rays**2).sum(axis=1)
        better = seen & (nearness > nearest)
        closest[better], nearest[better], places[better] = number, nearness[better], shown[better]
    return closest, places


@pytest.mark.parametrize("model", LENSES)
def test_it_is_the_one_that_asking_all_finds(model: DistortionModel) -> None:
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(-3, 3, (4000, 2)), rng.uniform(-0.1, 1.5, 4000)])
    clear = rng.random((7, SIDE, SIDE)) < 0.5
    rig = rig_of(model)
    closest, places = closest_cameras(rig, points, clear)
    expected, pixels = asked_of_all(rig, points, clear)
    np.testing.assert_array_equal(closest, expected)
    assert len(np.unique(closest)) > 5
    np.testing.assert_allclose(places[closest >= 0], pixels[closest >= 0], atol=1e-9)


def test_nobody_sees_what_is_hidden_from_all() -> None:
    closest, _ = closest_cameras(rig_of("pinhole"), np.zeros((5, 3)), np.zeros((7, SIDE, SIDE), dtype=bool))
    np.testing.assert_array_equal(closest, -1)
