"""What a long record's prior is learnt from."""

import numpy as np
import pytest
from nerfmodal.surface.pooled import STRETCH, learn_prior, liveliest
from nerfmodal.surface.robust import RobustFit


def decay(frames: int, life: float) -> list[RobustFit]:
    """Two coefficients: one that decays within `life` frames, one that only errs; errors of 1."""
    rng = np.random.default_rng(0)
    times = np.arange(frames)
    moving = 20 * np.exp(-times / life) * np.cos(0.5 * times)
    return [
        RobustFit(coefficients=row, information=np.eye(2), scale=1.0, inliers=1000)
        for row in np.column_stack([moving, np.zeros(frames)]) + rng.normal(size=(frames, 2))
    ]


@pytest.mark.parametrize("frames", [20, STRETCH, 2 * STRETCH - 1])
def test_a_short_record_is_one_stretch(frames: int) -> None:
    assert len(liveliest(decay(frames, 30.0))) == frames


def test_the_prior_of_a_long_decay_leaves_its_beginning_alone() -> None:
    fits = decay(10 * STRETCH, 30.0)
    moving = liveliest(fits)
    assert moving[0] is fits[0]
    assert len(moving) == STRETCH
    freedom = np.linalg.inv(learn_prior(moving).precision)[0, 0]
    pressed = np.linalg.inv(learn_prior(fits).precision)[0, 0]
    assert freedom > 5 * pressed
