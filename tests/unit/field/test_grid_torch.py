"""The field on a GPU's library is the field of the kernels: values, gradients, the optimiser's steps."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from nerfmodal.field import grid, grid_gpu, kernels
from nerfmodal.field.bricks import with_masks
from nerfmodal.field.course import Course
from nerfmodal.field.grid_torch import Place
from nerfmodal.field.views import CELL, Views, pixels_at, views_of
from nerfmodal.geometry.cameras import semi_spherical_rig
from nerfmodal.spec import RigSpec
from nerfmodal.types import Frame

CPU = torch.device("cpu")
LOW, HIGH = np.full(3, -0.7), np.full(3, 0.7)
RNG = np.random.default_rng(3)
IMAGES = RNG.integers(0, 256, size=(3, 20, 24, 3), dtype=np.uint8)
STILL = RNG.integers(0, 256, size=(3, 20, 24, 3), dtype=np.uint8)
Plane = tuple[float, float, float] | None
TILTED = (-1.0, 0.1, -0.2)
"""A ground: its height and slopes."""


@pytest.fixture(scope="module")
def views() -> Views:
    rig = semi_spherical_rig(RigSpec(cameras=3, width_px=24, height_px=20, radius_m=2.5, target_m=(0, 0, 0)))
    return views_of(Frame(index=0, time=0.0, images=IMAGES, rig=rig))


def a_field(ground: Plane) -> grid.GridField:
    """Random values, in two thirds of the blocks."""
    rng = np.random.default_rng(5)
    field = grid.empty_field(LOW, HIGH, 0.1, None if ground is None else np.array(ground))
    field.values[:, 0] = rng.normal(-2, 1, len(field.values))
    field.values[:, 1:] = rng.random((len(field.values), 3))
    shape = tuple(4 * n for n in field.bricks.slots.shape)
    return replace(field, bricks=with_masks(field.bricks, rng.random(shape) < 0.67))


@pytest.mark.parametrize("ground", [None, TILTED])
def test_both_show_the_same(views: Views, ground: Plane) -> None:
    field = a_field(ground)
    pixels = pixels_at(np.arange(views.pixels), views.images.shape)
    by_kernel = grid.render(field, views, pixels, behind=True)
    by_torch = grid_gpu.look(field, views, pixels, behind=True, device=CPU)
    for one, other in zip(by_kernel, by_torch, strict=True):
        close = np.isclose(one, other, atol=2e-4)
        assert close.mean() > 0.995  # a ray along a block's edge may take or leave a sample by rounding


@pytest.mark.parametrize(("ground", "behind"), [(None, True), (TILTED, True), (TILTED, False)])
def test_both_have_the_same_gradients(views: Views, ground: Plane, behind: bool) -> None:
    field = a_field(ground)
    pixels = pixels_at(np.arange(0, views.pixels, 7), views.images.shape)
    jitters = np.random.default_rng(1).random(len(pixels))
    decay, distortion, limit = 1e-3, 1e-2, 0.2
    optimiser = grid.Optimiser(len(field.values), 64 * len(field.bricks.masks))
    loss = kernels.train_batch(
        field.bricks.slots, field.bricks.masks, field.outer, field.values, field.bricks.low, field.bricks.voxel,
        field.half, field.ground, field.sides, views.table, CELL, views.poses, views.nears, views.images, STILL, behind,
        pixels, jitters, grid.STEP, decay, distortion, limit, optimiser.gradients, optimiser.touched, optimiser.seen,
    )  # fmt: skip
    expected = optimiser.gradients.sum(axis=0)
    learner = grid_gpu.Learner(Place(field, CPU), field.bricks.masks)
    found_loss, found = learner.gradient(
        views, None if behind else STILL, pixels, jitters, decay=decay, distortion=distortion, limit=limit
    )
    assert found_loss == pytest.approx(loss, rel=2e-3)
    error = np.linalg.norm(found.numpy() - expected) / np.linalg.norm(expected)
    assert error < 0.02
    np.testing.assert_allclose(learner.seen.numpy(), optimiser.seen.max(axis=0), atol=2e-3)


def test_both_learn_alike(views: Views) -> None:
    start = a_field(TILTED)

    def trained(by_gpu: bool) -> tuple[np.ndarray, float]:
        rng, field = np.random.default_rng(2), replace(start, values=start.values.copy())
        course = Course(12, lambda *_: None)

        def draw() -> np.ndarray:
            return rng.integers(0, views.pixels, 256)

        settings = {"rates": grid.Rates(), "decay": 1e-3, "distortion": 1e-3, "limit": 10.0}
        if by_gpu:
            masks = field.bricks.masks
            grid_gpu.train(field, views, STILL, draw, 12, rng, course, trainable=masks, device=CPU, **settings)
        else:
            grid.train(field, views, STILL, draw, 12, rng, course, **settings)
        return field.values - start.values, course.loss

    (one, loss), (other, other_loss) = trained(False), trained(True)
    assert other_loss == pytest.approx(loss, rel=0.02)
    moved = np.abs(one) > 1e-3
    assert moved.any()
    assert np.corrcoef(one[moved], other[moved])[0, 1] > 0.98


def test_without_a_driver_torch_is_not_asked(monkeypatch: pytest.MonkeyPatch, tmp_path: object) -> None:
    from nerfmodal.field import device

    monkeypatch.setattr(device, "DRIVER", tmp_path / "none")  # type: ignore[operator]
    device.gpu.cache_clear()
    assert device.gpu() is None
    assert device.described() == ("cpu", "float32")
    device.gpu.cache_clear()
