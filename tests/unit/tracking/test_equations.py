"""The kernels of following against slow loops and closed forms."""

import numpy as np
import pytest
from nerfmodal.tracking.equations import accumulate
from nerfmodal.tracking.pyramid import levels_of, read, smoothed, splines_of
from scipy.ndimage import gaussian_filter


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(0)


def test_normal_equations_are_those_of_a_dense_jacobian(rng: np.random.Generator) -> None:
    count, terms, lights, cameras = 60, 5, 2, 4
    rises = rng.normal(size=(count, 3, 2)).astype(np.float32)
    sight = rng.normal(size=(count, 2, 3))
    difference, part = (rng.normal(size=(count, 3)).astype(np.float32) for _ in range(2))
    weights = rng.random((count, 3))
    basis, light = rng.normal(size=(count, terms)), rng.normal(size=(count, lights))
    camera = rng.integers(0, cameras, count)
    normal, slopes = accumulate(rises, sight, difference, weights, part, basis, light, camera, cameras)
    jacobian = np.zeros((count, 3, 3 * terms + 3 * lights))
    for p in range(count):
        for c in range(3):
            pull = rises[p, c] @ sight[p]
            jacobian[p, c, : 3 * terms] = np.outer(pull, basis[p]).ravel()
            first = 3 * terms + c * lights
            jacobian[p, c, first : first + lights] = -part[p, c] * light[p]
    flat, w = jacobian.reshape(3 * count, -1), weights.reshape(-1)
    np.testing.assert_allclose(normal, flat.T @ (flat * w[:, None]), rtol=1e-5, atol=1e-5)
    for number in range(cameras):
        mine = np.repeat(camera == number, 3)
        expected = flat[mine].T @ (w * difference.reshape(-1))[mine]
        np.testing.assert_allclose(slopes[number], expected, rtol=1e-5, atol=1e-5)


def test_smoothing_is_that_of_scipy(rng: np.random.Generator) -> None:
    images = rng.random((2, 20, 30, 3)).astype(np.float32)
    expected = gaussian_filter(images, (0, 1.7, 1.7, 0), mode="nearest", truncate=3.0)
    np.testing.assert_allclose(smoothed(images, 1.7), expected, atol=2e-3)


@pytest.mark.parametrize("level", range(4))
def test_no_level_shifts_the_picture(level: int) -> None:
    """A slope stays what it is under smoothing and thinning, read at any place that is not near the edge."""
    columns, rows = np.meshgrid(np.arange(160) + 0.5, np.arange(120) + 0.5)
    image = np.round(0.9 * columns + 0.5 * rows + 20).astype(np.uint8)
    one = splines_of(levels_of(image[None, :, :, None], 4))[level]
    places = np.array([[70.3, 61.2], [88.9, 50.0], [64.5, 70.5]])
    values, slopes = read(one, np.zeros(3, dtype=int), places)
    np.testing.assert_allclose(255 * values[:, 0], 0.9 * places[:, 0] + 0.5 * places[:, 1] + 20, atol=0.6)
    np.testing.assert_allclose(255 * slopes.mean(axis=(0, 1)), [0.9, 0.5], atol=0.25 if level == 0 else 0.1)


def test_slopes_are_the_derivatives_of_what_is_read(rng: np.random.Generator) -> None:
    one = splines_of(levels_of(rng.integers(0, 255, (1, 24, 24, 2)).astype(np.uint8), 1))[0]
    places, camera = rng.uniform(4, 20, (50, 2)), np.zeros(50, dtype=int)
    _, slopes = read(one, camera, places)
    for axis in range(2):
        step = np.zeros(2)
        step[axis] = 1e-3
        change = read(one, camera, places + step)[0] - read(one, camera, places - step)[0]
        np.testing.assert_allclose(change / 2e-3, slopes[..., axis], atol=5e-3)


def test_what_is_read_at_a_pixel_is_the_pixel(rng: np.random.Generator) -> None:
    levels = levels_of(rng.integers(0, 255, (1, 24, 24, 2)).astype(np.uint8), 1)
    rows, columns = rng.integers(0, 24, (2, 30))
    values, _ = read(splines_of(levels)[0], np.zeros(30, dtype=int), np.stack([columns, rows], axis=1) + 0.5)
    np.testing.assert_allclose(values, levels[0].images[0, rows, columns], atol=1e-4)
