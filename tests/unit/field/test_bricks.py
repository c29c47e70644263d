"""Bricks and blocks: what is packed is unpacked, and a finer grid is the same field."""

import numpy as np
import pytest
from nerfmodal.field.bricks import (
    allocate,
    brick_counts,
    grown,
    halved,
    pack,
    refine,
    sample_vertices,
    unpack,
    with_masks,
)
from nerfmodal.field.corners import ROWS_PER_BRICK


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(3)


def test_masks_are_unpacked_as_they_were_packed(rng: np.random.Generator) -> None:
    occupied = rng.random((8, 4, 12)) < 0.02
    bricks = allocate(np.zeros(3), 0.1, occupied)
    np.testing.assert_array_equal(unpack(bricks.masks, bricks.slots), occupied)


def test_memory_grows_with_what_is_occupied() -> None:
    thin = np.zeros((40, 40, 40), dtype=bool)
    thin[:, :, 20] = True
    bricks = allocate(np.zeros(3), 0.1, thin)
    assert bricks.rows == 100 * ROWS_PER_BRICK  # one layer of 10 x 10 bricks


def test_every_bit_has_its_own_power() -> None:
    assert sorted(int(mask) for mask in pack(np.eye(64, dtype=bool))) == [1 << bit for bit in range(64)]


def test_restricting_masks_keeps_the_bricks(rng: np.random.Generator) -> None:
    occupied = rng.random((8, 8, 8)) < 0.5
    bricks = allocate(np.zeros(3), 0.1, occupied)
    part = occupied & (rng.random((8, 8, 8)) < 0.5)
    narrowed = with_masks(bricks, part)
    np.testing.assert_array_equal(narrowed.slots, bricks.slots)
    np.testing.assert_array_equal(unpack(narrowed.masks, narrowed.slots), part)


def linear_values(low: np.ndarray, voxel: float, slots: np.ndarray) -> np.ndarray:
    """A field that is linear in space, which trilinear interpolation must keep exactly."""
    local = np.stack(np.unravel_index(np.arange(ROWS_PER_BRICK), (8, 8, 8)), axis=1)
    values = np.empty((int((slots >= 0).sum()) * ROWS_PER_BRICK, 4), np.float32)
    for brick in np.argwhere(slots >= 0):
        x = low + voxel * (brick * 8 + local)
        start = slots[tuple(brick)] * ROWS_PER_BRICK
        values[start : start + ROWS_PER_BRICK, 0] = 3.0
        values[start : start + ROWS_PER_BRICK, 1:] = x
    return values


def test_a_finer_grid_is_the_same_linear_field() -> None:
    low, high, voxel = np.array([-1.0, 0.0, 0.5]), np.array([0.5, 1.5, 2.0]), 0.1
    coarse = allocate(low, voxel, np.ones(tuple(4 * brick_counts(low, high, voxel)), dtype=bool))
    values = linear_values(low, voxel, coarse.slots)
    occupied = np.ones(tuple(4 * n for n in coarse.slots.shape), dtype=bool)
    fine, sampled = refine(coarse, values, high, occupied)
    assert fine.voxel == voxel / 2
    expected = linear_values(low, voxel / 2, fine.slots)[:, 1:]
    covered = np.all(expected <= high + 1e-6, axis=1)  # beyond the box a finer brick may stand outside the coarse ones
    np.testing.assert_allclose(sampled[covered, 1:], expected[covered], atol=1e-4)
    assert covered.mean() > 0.5


def test_the_density_of_a_place_does_not_depend_on_the_voxel() -> None:
    low = np.zeros(3)
    coarse = allocate(low, 0.2, np.ones((4, 4, 4), dtype=bool))
    fine = allocate(low, 0.1, np.ones((4, 4, 4), dtype=bool))
    values = np.full((coarse.rows, 4), 0.7, np.float32)
    sampled = sample_vertices(coarse, values, fine)
    assert np.log1p(np.exp(sampled[0, 0])) == pytest.approx(np.log1p(np.exp(0.7)) / 2, rel=1e-5)


def test_halved_blocks_cover_the_same_places() -> None:
    blocks = np.zeros((2, 2, 2), dtype=bool)
    blocks[1, 0, 1] = True
    fine = halved(blocks, (4, 4, 4))
    assert fine.sum() == 8
    assert fine[2:4, 0:2, 2:4].all()


def test_grown_blocks_have_their_neighbours() -> None:
    blocks = np.zeros((5, 5, 5), dtype=bool)
    blocks[2, 2, 2] = True
    assert grown(blocks).sum() == 27
