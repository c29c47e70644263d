"""Equation 10 on a field known in closed form, and extraction that always ends."""

import numpy as np
import pytest
from nerfmodal.cloud import extract
from nerfmodal.cloud.extract import stride
from nerfmodal.geometry.cameras import semi_spherical_rig, unproject
from nerfmodal.spec import RigSpec
from nerfmodal.types import Frame, Outcome, PointCloud

LOW, HIGH = np.full(3, -1.0), np.full(3, 1.0)
RIG = semi_spherical_rig(RigSpec(cameras=5, width_px=40, height_px=30, radius_m=3.0, target_m=(0, 0, 0)))
FRAME = Frame(index=0, time=0.5, images=np.zeros((5, 30, 40, 3), np.uint8), rig=RIG)


def ball(pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """An opaque red ball of radius 0.5 at the origin."""
    distance = np.zeros(len(pixels))
    for index, camera in enumerate(RIG.cameras):
        mine = pixels[:, 0] == index
        directions = unproject(camera, pixels[mine][:, [2, 1]] + 0.5)
        b = directions @ camera.camera_to_world[:3, 3]
        inside = b**2 - 9.0 + 0.25
        distance[mine] = np.where(inside > 0, -b - np.sqrt(np.maximum(inside, 0)), 0)
    return np.tile([1.0, 0.0, 0.0], (len(pixels), 1)), (distance > 0).astype(float), distance, np.zeros(len(pixels))


def nothing(pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    return np.zeros((len(pixels), 3)), np.full(len(pixels), 0.2), np.ones(len(pixels)), np.zeros(len(pixels))


def fog(pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The ball, of which every second pixel is not sure where it is."""
    colors, opacity, distance, _ = ball(pixels)
    return colors, opacity, distance, np.where(pixels[:, 2] % 2, 0.2, 0.01)


def cloud(look: object, count: int, low: np.ndarray = LOW) -> PointCloud:
    return extract(
        look,  # type: ignore[arg-type]
        FRAME,
        low,
        HIGH,
        threshold=0.5,
        spread=0.1,
        count=count,
        rng=np.random.default_rng(0),
        report=lambda *_: None,
    )


def test_every_point_lies_on_the_surface() -> None:
    points = cloud(ball, 200)
    assert points.outcome is Outcome.OK
    assert len(points.points) == 200
    assert points.time == 0.5
    np.testing.assert_allclose(np.linalg.norm(points.points, axis=1), 0.5, atol=1e-9)
    np.testing.assert_array_equal(points.colors, np.tile([1.0, 0.0, 0.0], (200, 1)))


def test_it_ends_when_no_more_rays_are_left() -> None:
    points = cloud(ball, 1_000_000)
    assert points.outcome is Outcome.FEW_POINTS
    assert 200 < len(points.points) < 5 * 30 * 40


def test_an_empty_field_is_an_outcome() -> None:
    points = cloud(nothing, 100)
    assert points.outcome is Outcome.EMPTY_FIELD
    assert points.points.shape == (0, 3)


def test_points_outside_the_box_are_discarded() -> None:
    assert (cloud(ball, 1_000_000, low=np.array([-1.0, -1.0, 0.1])).points[:, 2] >= 0.1).all()


def test_a_refusal_stops_it() -> None:
    def refuse(*_: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        extract(
            ball, FRAME, LOW, HIGH, threshold=0.5, spread=0.1, count=10, rng=np.random.default_rng(0), report=refuse
        )


def test_rays_that_end_in_fog_are_discarded() -> None:
    every, sure = cloud(ball, 100_000), cloud(fog, 100_000)
    assert len(sure.points) == pytest.approx(len(every.points) / 2, rel=0.1)


@pytest.mark.parametrize("total", [1, 2, 97, 6000, 65_536, 100_003])
def test_every_pixel_is_asked_once(total: int) -> None:
    order = (7 + stride(total) * np.arange(total)) % total
    np.testing.assert_array_equal(np.sort(order), np.arange(total))
