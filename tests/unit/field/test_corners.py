"""The corners of a cell against the interpolation and its transpose written out."""

from collections.abc import Callable
from typing import Any, no_type_check

import numba
import numpy as np
import pytest
from nerfmodal.field import corners
from numba.core.errors import TypingError

SLOTS = np.arange(8, dtype=np.int32).reshape(2, 2, 2)[::-1].copy()
"""Two bricks along each axis, not in the order of their places."""
INSIDE, ACROSS_ONE, ACROSS_ALL = [2.3, 5.6, 1.1], [9.2, 7.7, 3.5], [7.9, 7.2, 7.4]


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(3)


def vertices(slots: np.ndarray, values: np.ndarray) -> np.ndarray:
    """The grid laid out in space; what has no vertices is empty."""
    laid = np.zeros((16, 16, 16, values.shape[1]))
    laid[..., 0] = corners.EMPTY_RAW
    for brick in np.ndindex(2, 2, 2):
        if slots[brick] >= 0:
            place = tuple(slice(8 * b, 8 * b + 8) for b in brick)
            laid[place] = values[512 * slots[brick] :][:512].reshape(8, 8, 8, -1)
    return laid


def weights_at(point: list[float]) -> np.ndarray:
    """Trilinear weights of all vertices."""
    axes = [np.clip(1 - np.abs(np.arange(16) - x), 0, None) for x in point]
    return np.asarray(np.einsum("i,j,k->ijk", *axes))


def gathered(slots: np.ndarray, values: np.ndarray, point: list[float]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Interpolated numbers, and what `tell` needs of the sample."""
    rows, offsets, samples = np.full((1, 8), -1, np.int32), np.zeros((1, 3), np.float32), np.zeros((1, 8), np.float32)
    raw = corners.gather(slots, 0, values, *point, rows, offsets, samples, 0)
    return np.array([raw, *samples[0, 4:7]]), rows, offsets


@pytest.mark.parametrize("point", [INSIDE, ACROSS_ONE, ACROSS_ALL])
@pytest.mark.parametrize("missing", [None, (1, 0, 0), (0, 0, 0)])
def test_what_is_gathered_is_the_trilinear_sum(
    rng: np.random.Generator, point: list[float], missing: tuple[int, int, int] | None
) -> None:
    values, slots = rng.normal(size=(8 * 512, 4)).astype(np.float32), SLOTS.copy()
    if missing is not None:
        slots[missing] = -1
    wanted = np.einsum("ijk,ijkc->c", weights_at(point), vertices(slots, values))
    found, _, _ = gathered(slots, values, point)
    assert found == pytest.approx(wanted, abs=1e-5)


@pytest.mark.parametrize("point", [INSIDE, ACROSS_ONE, ACROSS_ALL])
@pytest.mark.parametrize("missing", [None, (1, 0, 0), (0, 0, 0)])
def test_what_is_told_is_the_transpose(
    rng: np.random.Generator, point: list[float], missing: tuple[int, int, int] | None
) -> None:
    values, slots = np.zeros((8 * 512, 4), np.float32), SLOTS.copy()
    if missing is not None:
        slots[missing] = -1
    _, rows, offsets = gathered(slots, values, point)
    gradient, touched = np.zeros_like(values), np.zeros(len(values) // corners.LINE, np.uint8)
    four = rng.normal(size=4).astype(np.float32)
    corners.tell(gradient, touched, rows, offsets, 0, tuple(four))
    laid = vertices(slots, gradient)
    laid[laid[..., 0] == corners.EMPTY_RAW] = 0
    there = vertices(slots, np.ones_like(values))[..., :1] == 1
    assert laid == pytest.approx(np.where(there, weights_at(point)[..., None] * four, 0), abs=1e-6)
    lines = gradient.reshape(-1, corners.LINE * 4).any(axis=1)
    assert not (lines & (touched == 0)).any()


@pytest.mark.parametrize("array", [np.zeros((4, 4)), np.zeros((4, 4), np.float32)[:, ::2], np.zeros(16, np.float32)])
def test_rows_of_anything_else_are_refused_at_compile_time(array: np.ndarray) -> None:
    @no_type_check
    def sum_of(values: Any) -> Any:
        return corners.blend(values, (0,), (np.float32(1),))

    compiled: Callable[[np.ndarray], Any] = numba.njit(sum_of)
    with pytest.raises(TypingError, match="rows of four single-precision numbers"):
        compiled(array)
