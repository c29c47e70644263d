"""Wider and narrower masks against the morphology written out."""

import numpy as np
import pytest
from nerfmodal.field.masks import largest, narrowed, widened
from scipy.ndimage import binary_dilation, binary_erosion


@pytest.mark.parametrize("pixels", [0, 1, 3])
@pytest.mark.parametrize("share", [0.05, 0.9])
def test_masks_are_those_of_the_square_around_each_pixel(pixels: int, share: float) -> None:
    masks = np.random.default_rng(5).random((2, 17, 23)) < share
    square = np.ones((2 * pixels + 1, 2 * pixels + 1), dtype=bool)
    assert np.array_equal(widened(masks, pixels), [binary_dilation(one, square) for one in masks])
    assert np.array_equal(narrowed(masks, pixels), [binary_erosion(one, square, border_value=1) for one in masks])
    assert np.array_equal(widened(masks[0], pixels), widened(masks, pixels)[0])


def test_the_largest_channel_is_that_of_numpy() -> None:
    numbers = np.random.default_rng(6).normal(size=(4, 5, 3))
    assert np.array_equal(largest(numbers), numbers.max(axis=-1))
