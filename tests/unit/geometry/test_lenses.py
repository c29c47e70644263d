"""Lenses by closed form: OpenCV's published formulae, COLMAP's models, and what bends must unbend."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from nerfmodal.geometry.cameras import downscale, look_at, project, unproject
from nerfmodal.geometry.lenses import distort, fold, straighten, undistort
from nerfmodal.geometry.rays import pixel_centers
from nerfmodal.types import Camera, DistortionModel

PINHOLE = Camera(
    name="a",
    width=64,
    height=48,
    focal_x=50.0,
    focal_y=52.0,
    center_x=31.0,
    center_y=25.0,
    camera_to_world=look_at(np.array([2.0, -1.0, 1.5]), np.zeros(3)),
)
FOX = replace(PINHOLE, model="opencv", distortion=(0.0578, -0.0805, 0.0, 0.0, -0.00098, 0.00016))
BARREL = replace(PINHOLE, model="opencv", distortion=(-0.28, 0.07, -0.006, 0.0, 0.001, -0.002))
FISHEYE = replace(PINHOLE, model="fisheye", distortion=(0.03, -0.012, 0.004, -0.001, 0.0, 0.0))
LENSES = [PINHOLE, FOX, BARREL, FISHEYE]


def opencv_pixel(camera: Camera, point: np.ndarray) -> np.ndarray:
    """OpenCV's documented projection of a point of the camera's frame (x right, y down, z ahead), by scalars."""
    x, y = point[0] / point[2], point[1] / point[2]
    k1, k2, k3, k4, p1, p2 = camera.distortion
    r2 = x**2 + y**2
    if camera.model == "fisheye":
        theta = np.arctan(np.sqrt(r2))
        bent = theta * (1 + k1 * theta**2 + k2 * theta**4 + k3 * theta**6 + k4 * theta**8)
        x, y = bent / np.sqrt(r2) * x, bent / np.sqrt(r2) * y
    else:
        radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3 + k4 * r2**4
        x, y = (
            x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x**2),
            y * radial + p1 * (r2 + 2 * y**2) + 2 * p2 * x * y,
        )
    return np.array([camera.focal_x * x + camera.center_x, camera.focal_y * y + camera.center_y])


@pytest.mark.parametrize("camera", LENSES)
def test_points_fall_where_opencv_says(camera: Camera) -> None:
    rng = np.random.default_rng(0)
    seen = np.column_stack([rng.uniform(-0.6, 0.6, (20, 2)), np.ones(20)]) * rng.uniform(0.5, 3, (20, 1))
    world = seen @ np.diag([1.0, -1.0, -1.0]) @ camera.camera_to_world[:3, :3].T + camera.camera_to_world[:3, 3]
    pixels, depths = project(camera, world)
    np.testing.assert_allclose(pixels, [opencv_pixel(camera, one) for one in seen], atol=1e-9)
    np.testing.assert_allclose(depths, seen[:, 2])


@pytest.mark.parametrize("camera", LENSES)
def test_every_pixels_ray_comes_back_to_its_pixel(camera: Camera) -> None:
    pixels = pixel_centers(camera)
    points = camera.camera_to_world[:3, 3] + 2.5 * unproject(camera, pixels)
    np.testing.assert_allclose(project(camera, points)[0], pixels, atol=1e-8)


@settings(max_examples=60, deadline=None)
@given(
    k1=st.floats(-0.35, 0.35),
    k2=st.floats(-0.1, 0.1),
    p1=st.floats(-0.01, 0.01),
    p2=st.floats(-0.01, 0.01),
    radius=st.floats(0.0, 0.85),
    turn=st.floats(0, 2 * np.pi),
)
def test_what_a_lens_bends_unbends(k1: float, k2: float, p1: float, p2: float, radius: float, turn: float) -> None:
    camera = replace(PINHOLE, model="opencv", distortion=(k1, k2, 0.0, 0.0, p1, p2))
    r = radius * min(fold(camera), 1.2)
    ideal = r * np.array([[np.cos(turn), np.sin(turn)]])
    np.testing.assert_allclose(undistort(camera, distort(camera, ideal)), ideal, atol=1e-7)


def test_a_fold_lets_no_direction_into_the_picture_twice() -> None:
    """r (1 - 0.28 r^2 ...) turns back; without the fold a point far to the side falls into the picture."""
    camera = replace(PINHOLE, model="opencv", distortion=(-0.28, 0.0, 0.0, 0.0, 0.0, 0.0))
    assert fold(camera) == pytest.approx(np.sqrt(1 / (3 * 0.28)))
    side = np.array([[1.85, 0.0]])
    naive = side[0, 0] * (1 - 0.28 * side[0, 0] ** 2)
    assert abs(naive) * camera.focal_x < camera.width / 2
    assert abs(distort(camera, side)[0, 0]) > 1000


def test_pixels_beyond_the_fold_see_along_it() -> None:
    camera = replace(PINHOLE, focal_x=20.0, focal_y=20.0, model="opencv", distortion=(-0.5, 0.0, 0.0, 0.0, 0.0, 0.0))
    ideal = undistort(camera, np.array([[5.0, 0.0], [0.0, -9.0]]))
    np.testing.assert_allclose(np.hypot(*ideal.T), fold(camera))


def test_a_fisheye_sees_behind_itself() -> None:
    camera = replace(FISHEYE, camera_to_world=np.eye(4))
    behind = np.array([[0.9, 0.2, 0.15]])
    pixels, depths = project(camera, behind)
    assert depths[0] < 0
    ray = unproject(camera, pixels)
    np.testing.assert_allclose(ray, behind / np.linalg.norm(behind), atol=1e-9)


@pytest.mark.parametrize("model", ["pinhole", "opencv", "fisheye"])
def test_without_coefficients_the_axis_is_straight(model: DistortionModel) -> None:
    camera = replace(PINHOLE, model=model)
    np.testing.assert_allclose(straighten(camera, np.zeros((1, 2))), [[0.0, 0.0, -1.0]], atol=1e-12)
    assert fold(camera) == (np.pi if model == "fisheye" else np.inf)


@pytest.mark.parametrize("camera", LENSES)
def test_a_smaller_picture_sees_the_same(camera: Camera) -> None:
    small = downscale(camera, 2)
    pixels = pixel_centers(small)
    np.testing.assert_allclose(unproject(small, pixels), unproject(camera, 2 * pixels), atol=1e-9)


def test_opencv_itself_agrees() -> None:
    cv2 = pytest.importorskip("cv2", reason="opencv-python-headless is not installed: pip install 'nerfmodal[capture]'")
    rng = np.random.default_rng(1)
    seen = np.column_stack([rng.uniform(-0.6, 0.6, (30, 2)), np.ones(30)])
    matrix = np.array([[50.0, 0, 31], [0, 52, 25], [0, 0, 1]])
    k1, k2, k3, k4, p1, p2 = BARREL.distortion
    flat, _ = cv2.projectPoints(seen, np.zeros(3), np.zeros(3), matrix, np.array([k1, k2, p1, p2, k3]))
    assert k4 == 0
    world = seen @ np.diag([1.0, -1.0, -1.0]) @ BARREL.camera_to_world[:3, :3].T + BARREL.camera_to_world[:3, 3]
    np.testing.assert_allclose(project(BARREL, world)[0], flat[:, 0], atol=1e-9)
    wide, _ = cv2.fisheye.projectPoints(
        seen[:, None], np.zeros(3), np.zeros(3), matrix, np.array(FISHEYE.distortion[:4])
    )
    np.testing.assert_allclose(project(FISHEYE, world)[0], wide[:, 0], atol=1e-9)
