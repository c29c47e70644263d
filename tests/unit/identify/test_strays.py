"""One frame in a wrong place is left out and does no harm; what lasts is motion and stays."""

import numpy as np
import pytest
from nerfmodal.identify import identify
from nerfmodal.identify.metrics import mac
from nerfmodal.identify.strays import stray_frames
from nerfmodal.spec import IdentificationSpec

from tests.fixtures.ambient import displacement_of

LINES = ((2.0, 0.03), (5.0, 0.015), (9.7, 0.004))


def record(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Three decays of 60 sensors with noise, and their shapes as columns."""
    times = np.arange(90) / 30.0
    x = np.linspace(0, 1, 60)
    shapes = np.stack([x**2, x**2 - 1.3 * x**3, np.sin(3 * np.pi * x)], axis=1)
    swings = [a * np.exp(-0.01 * 2 * np.pi * f * times) * np.cos(2 * np.pi * f * times + 0.4 * f) for f, a in LINES]
    return np.stack(swings, axis=1) @ shapes.T + 2e-4 * rng.normal(size=(90, 60)), shapes


def test_a_stray_frame_is_a_gap_and_costs_no_shape() -> None:
    """Seen to fail without `stray_frames` in `identify`: the frame is kept."""
    rng = np.random.default_rng(5)
    values, shapes = record(rng)
    values[17] += 0.05 * np.linspace(1, -1, 60) ** 3
    found = identify(displacement_of(values), IdentificationSpec(), seed=0)
    assert list(np.flatnonzero(~found.displacement.valid)) == [17]
    assert found.model.frequencies == pytest.approx([2.0, 5.0, 9.7], abs=0.02)
    for mode in range(3):
        assert mac(found.model.mode_shapes[:, 0, mode], shapes[:, mode]) > 0.99


def test_a_clean_record_loses_nothing() -> None:
    values, _ = record(np.random.default_rng(6))
    assert identify(displacement_of(values), IdentificationSpec(), seed=0).displacement.valid.all()


def test_what_lasts_longer_than_two_frames_stays() -> None:
    rng = np.random.default_rng(7)
    residuals = rng.normal(size=(50, 4))
    residuals[20:24] *= 100.0
    residuals[[5, 30, 31]] *= 100.0
    astray = stray_frames(residuals, np.ones(50, dtype=bool))
    assert list(np.flatnonzero(astray)) == [5, 30, 31]


def test_frames_that_were_lost_before_are_skipped() -> None:
    residuals = np.random.default_rng(8).normal(size=(40, 3))
    residuals[11] *= 100.0
    valid = np.ones(42, dtype=bool)
    valid[[2, 3]] = False
    assert list(np.flatnonzero(stray_frames(residuals, valid))) == [13]
