"""The fused kernels against closed forms, a slow reference and numerical derivatives."""

import math
from dataclasses import replace

import numpy as np
import pytest
from nerfmodal.field import grid, kernels, marching
from nerfmodal.field.bricks import allocate, with_masks
from nerfmodal.field.views import CELL, Views, directions_of, views_of
from nerfmodal.geometry.cameras import semi_spherical_rig
from nerfmodal.spec import RigSpec
from nerfmodal.types import Frame

VOXEL = 0.1
LOW, HIGH = np.full(3, -0.7), np.full(3, 0.7)
TILTED = (-1.0, 0.1, -0.2)
"""A ground: its height and slopes."""


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(7)


@pytest.fixture
def views(rng: np.random.Generator) -> Views:
    rig = semi_spherical_rig(RigSpec(cameras=3, width_px=24, height_px=20, radius_m=2.5, target_m=(0, 0, 0)))
    images = rng.integers(0, 256, size=(3, 20, 24, 3), dtype=np.uint8)
    return views_of(Frame(index=0, time=0.0, images=images, rig=rig))


def a_field(rng: np.random.Generator, ground: tuple[float, float, float] | None = None) -> grid.GridField:
    field = grid.empty_field(LOW, HIGH, VOXEL, None if ground is None else np.array(ground))
    field.values[:, 0] = rng.normal(-2, 1, len(field.values))
    field.values[:, 1:] = rng.random((len(field.values), 3))
    return field


def slow_color(field: grid.GridField, views: Views, pixel: np.ndarray, background: np.ndarray) -> np.ndarray:
    """Equation 3 by a plain loop over the same samples, with the interpolation written out."""
    origin = (views.poses[pixel[0], :3, 3] - LOW) / VOXEL
    direction = directions_of(views, pixel[None])[0]
    size = (HIGH - LOW) / VOXEL
    first, second = -origin / direction, (size - origin) / direction
    t, far = np.minimum(first, second).max(), np.maximum(first, second).min()
    color, transmittance = np.zeros(3), 1.0
    t += 0.5 * grid.STEP
    while t < far and transmittance >= marching.OPAQUE:
        x = origin + t * direction
        cell = np.floor(x).astype(int)
        value = np.zeros(4)
        for corner in np.ndindex(2, 2, 2):
            weight = np.prod(np.where(corner, x - cell, 1 - x + cell))
            place = cell + corner
            slot = field.bricks.slots[tuple(place // 8)]
            local = place % 8
            value += weight * field.values[slot * 512 + local[0] * 64 + local[1] * 8 + local[2]]
        opacity = 1 - math.exp(-math.log1p(math.exp(value[0])) * grid.STEP)
        color += transmittance * opacity * value[1:]
        transmittance *= 1 - opacity
        t += grid.STEP
    return color + transmittance * background


def loss_of(field: grid.GridField, views: Views, pixels: np.ndarray, **options: object) -> tuple[float, np.ndarray]:
    optimiser = grid.Optimiser(len(field.values), 64 * len(field.bricks.masks))
    backgrounds = np.full_like(views.images, 80)
    loss = kernels.train_batch(
        field.bricks.slots,
        field.bricks.masks,
        field.outer,
        field.values,
        field.bricks.low,
        field.bricks.voxel,
        field.half,
        field.ground,
        field.sides,
        views.table,
        CELL,
        views.poses,
        views.nears,
        views.images,
        backgrounds,
        bool(options.get("beyond", False)),
        pixels,
        np.full(len(pixels), 0.5),
        grid.STEP,
        0.0,
        0.0,
        10.0,
        optimiser.gradients,
        optimiser.touched,
        optimiser.seen,
    )
    return loss, optimiser.gradients.sum(axis=0)


PIXELS = np.array([[0, 10, 12], [1, 9, 11], [2, 8, 14], [1, 12, 9]], dtype=np.int32)


def test_the_loss_is_that_of_a_slow_loop(rng: np.random.Generator, views: Views) -> None:
    field = a_field(rng)
    loss, _ = loss_of(field, views, PIXELS)
    slow = [slow_color(field, views, pixel, np.full(3, 80 / 255)) for pixel in PIXELS]
    truth = views.images[tuple(PIXELS.T)] / 255
    assert loss == pytest.approx(np.mean((np.array(slow) - truth) ** 2), rel=1e-4)


@pytest.mark.parametrize("beyond", [False, True])
@pytest.mark.parametrize("ground", [None, TILTED])
def test_gradients_are_the_numerical_ones(
    rng: np.random.Generator, views: Views, beyond: bool, ground: tuple[float, float, float] | None
) -> None:
    field = a_field(rng, ground)
    _, gradient = loss_of(field, views, PIXELS, beyond=beyond)
    strongest = np.argsort(-np.abs(gradient).max(axis=1))[:40:4]
    for row in strongest:
        for channel in range(4):
            step = 1e-2
            kept = field.values[row, channel]
            field.values[row, channel] = kept + step
            up, _ = loss_of(field, views, PIXELS, beyond=beyond)
            field.values[row, channel] = kept - step
            down, _ = loss_of(field, views, PIXELS, beyond=beyond)
            field.values[row, channel] = kept
            numerical = (up - down) / (2 * step) * 3 * len(PIXELS)  # the kernel's loss is a mean
            assert gradient[row, channel] == pytest.approx(numerical, rel=2e-2, abs=2e-4)


@pytest.mark.parametrize("fog", [-3.0, -30.0])
def test_a_ray_that_meets_the_structure_teaches_the_ground_nothing(
    rng: np.random.Generator, views: Views, fog: float
) -> None:
    """Guard: `lit < CLEAR` in `train_batch`; without it the ground learns what stands before it."""
    field = a_field(rng, TILTED)
    field.values[: field.bricks.rows, 0] = fog
    _, gradient = loss_of(field, views, PIXELS, beyond=True)
    assert np.any(gradient[field.bricks.rows :] != 0) == (fog < -20)


def distortion(weights: np.ndarray, places: np.ndarray, lengths: np.ndarray) -> float:
    """mip-NeRF 360, eq 15, over all pairs."""
    pairs = weights[:, None] * weights[None] * np.abs(places[:, None] - places[None])
    return float(pairs.sum() + (weights**2 * lengths).sum() / 3)


def test_pulls_are_the_derivative_of_the_distortion(rng: np.random.Generator) -> None:
    count, strength = 12, 0.3
    samples = np.zeros((count, 8), np.float32)
    samples[:, 0], samples[:, 1], samples[:, 7] = np.sort(rng.random(count) * 9), 0.6, rng.random(count) / count
    pulls = np.zeros(count, np.float32)
    kernels.gather_pulls(samples, count, strength, pulls)
    samples = samples.astype(float)
    for index in range(count):
        moved = np.array([samples[:, 7], samples[:, 7]])
        moved[:, index] += [1e-6, -1e-6]
        up, down = (distortion(weights, samples[:, 0], samples[:, 1]) for weights in moved)
        assert pulls[index] == pytest.approx(strength * (up - down) / 2e-6, rel=1e-4)


def test_a_pull_reaches_the_densities_through_the_weights(rng: np.random.Generator) -> None:
    """d/d sigma_i of sum_j w_j p_j by finite differences of w = T (1 - exp(-sigma delta))."""
    count, delta = 7, 0.6
    raw, pulls = rng.normal(-0.5, 1, count), rng.normal(size=count)

    def weights_of(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        thickness = np.log1p(np.exp(values)) * delta
        before = np.exp(-np.concatenate([[0], np.cumsum(thickness)[:-1]]))
        return before * -np.expm1(-thickness), before

    weights, before = weights_of(raw)
    samples = np.zeros((count, 8), np.float32)
    samples[:, 1], samples[:, 2], samples[:, 3], samples[:, 7] = delta, before, 1 / (1 + np.exp(-raw)), weights
    rows = np.full((count, 8), -1, np.int32)
    rows[:, 0] = np.arange(count)
    corner, gradient, touched = np.zeros((count, 3), np.float32), np.zeros((512, 4), np.float32), np.zeros(1, np.uint8)
    dark, strengths = np.zeros(3, np.float32), pulls.astype(np.float32)
    kernels.backward(rows, corner, samples, count, dark, dark, strengths, 0.0, gradient, touched)
    for index in range(count):
        step = np.zeros(count)
        step[index] = 1e-6
        numerical = (weights_of(raw + step)[0] - weights_of(raw - step)[0]) @ pulls / 2e-6
        assert gradient[index, 0] == pytest.approx(numerical, rel=1e-4, abs=1e-6)


def test_a_slab_of_constant_density_lets_exp_minus_sigma_l_through(views: Views) -> None:
    field = grid.empty_field(LOW, HIGH, VOXEL, None)
    density = 0.05  # per voxel
    field.values[:, 0] = math.log(math.expm1(density))
    pixels = np.array([[0, 10, 12]], dtype=np.int32)
    _, left, _, _, _ = grid.render(field, views, pixels, behind=False)
    origin, direction = views.poses[0, :3, 3], directions_of(views, pixels)[0]
    first, second = (LOW - origin) / direction, (HIGH - origin) / direction
    length = np.maximum(first, second).min() - np.minimum(first, second).max()
    assert left[0] == pytest.approx(math.exp(-density * length / VOXEL), rel=density * grid.STEP)


def test_an_opaque_wall_is_seen_at_its_distance(views: Views) -> None:
    field = grid.empty_field(LOW, HIGH, VOXEL / 4, None)
    blocks = np.arange(field.bricks.rows)
    x_of_brick = np.repeat(np.argwhere(field.bricks.slots >= 0)[:, 0], 512)
    x = (x_of_brick * 8 + (blocks % 512) // 64) * VOXEL / 4 + LOW[0]
    field.values[: field.bricks.rows, 0] = np.where(x < 0.0, 9.0, -12.0)
    pixels = np.array([[0, 10, 12]], dtype=np.int32)
    _, left, _, distance, spread = grid.render(field, views, pixels, behind=False)
    hit = views.poses[0, :3, 3] + distance[0] * directions_of(views, pixels)[0]
    assert left[0] < 0.01
    assert hit[0] == pytest.approx(0.0, abs=VOXEL / 4)
    assert spread[0] < VOXEL / 4


def test_rays_jump_over_blocks_that_are_not_set(rng: np.random.Generator, views: Views) -> None:
    field = a_field(rng)
    shape = tuple(4 * n for n in field.bricks.slots.shape)
    empty = replace(field, bricks=with_masks(field.bricks, np.zeros(shape, dtype=bool)))
    half = np.zeros(shape, dtype=bool)
    half[: shape[0] // 2] = True
    lower = replace(field, bricks=with_masks(field.bricks, half))
    left = [grid.render(one, views, PIXELS, behind=False)[1] for one in (empty, lower, field)]
    np.testing.assert_array_equal(left[0], 1.0)
    assert (left[1] >= left[2] - 1e-6).all()
    assert (left[1] < 1).any()


def test_rays_jump_as_far_as_bricks_are_empty_and_miss_nothing(rng: np.random.Generator, views: Views) -> None:
    field = empty_but_for_one_brick(rng)
    slots = field.bricks.slots
    assert slots.min() < -3
    near = replace(field, bricks=replace(field.bricks, slots=np.maximum(slots, -1)))
    pixels = np.concatenate([views.pixels_of(camera) for camera in range(len(views.images))])
    far, close = (grid.render(one, views, pixels, behind=False) for one in (field, near))
    assert (far[1] < 0.9).any()
    for one, other in zip(far, close, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-4)


def empty_but_for_one_brick(rng: np.random.Generator) -> grid.GridField:
    field = grid.empty_field(LOW, HIGH, VOXEL / 4, None)
    occupied = np.zeros(tuple(4 * n for n in field.bricks.slots.shape), dtype=bool)
    occupied[8:10, 12:14, 8:12] = True
    bricks = allocate(field.bricks.low, field.bricks.voxel, occupied)
    values = rng.normal(size=(bricks.rows, 4)).astype(np.float32)
    return replace(field, bricks=bricks, values=values, outer=np.empty((0, 0, 0), np.int32))


def test_opacities_are_those_of_the_closed_form() -> None:
    raw = np.linspace(-12, 40, 500, dtype=np.float32)
    lanes = np.stack([raw, raw, raw])
    marching.activate_all(lanes, np.float32(0.6))
    density = np.logaddexp(0.0, raw.astype(float))
    np.testing.assert_allclose(lanes[1], -np.expm1(-0.6 * density), rtol=1e-6, atol=1e-7)
    np.testing.assert_allclose(lanes[2], 1 / (1 + np.exp(-raw.astype(float))), rtol=1e-6)


@pytest.mark.parametrize("delta", [1.0, 1e4])
def test_a_sample_of_any_length_has_an_opacity(delta: float) -> None:
    opacity, _ = marching.activate(np.float32(2.0), np.float32(delta))
    assert opacity == pytest.approx(-math.expm1(-math.log1p(math.exp(2.0)) * delta), rel=1e-6)


def test_the_result_does_not_depend_on_threads(rng: np.random.Generator, views: Views) -> None:
    import numba

    field = a_field(rng)
    before = numba.get_num_threads()
    try:
        results = []
        for threads in (1, before):
            numba.set_num_threads(threads)
            results.append(loss_of(field, views, PIXELS))
    finally:
        numba.set_num_threads(before)
    assert results[0][0] == results[1][0]
    np.testing.assert_array_equal(results[0][1], results[1][1])


@pytest.mark.parametrize("height", [-0.5, np.nan])
def test_a_checkpoint_of_an_older_version_has_a_level_ground_or_none(rng: np.random.Generator, height: float) -> None:
    state = grid.grid_state(a_field(rng)) | {"voxel": np.array([VOXEL, height])}
    field = grid.grid_of(state)
    np.testing.assert_array_equal(field.ground, [height, 0.0, 0.0])
    assert field.has_ground == np.isfinite(height)
