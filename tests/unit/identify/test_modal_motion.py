"""The second pass: decays are found again exactly, noise shrinks with the number of frames, lost frames are filled."""

import numpy as np
import pytest
from nerfmodal.identify import modal_motion
from nerfmodal.types import DisplacementMatrix, ModalModel, ModeQuality, Verdict

from tests.fixtures.ambient import factored

LINES = np.array([[2.17, 0.01], [4.83, 0.02], [9.61, 0.015]])
FRAMES, SENSORS = 90, 40
TIMES = np.arange(FRAMES) / 30.0


def decays(rng: np.random.Generator) -> np.ndarray:
    """Three free decays, each with shapes and phases of its own at every sensor, about a rest that is not zero."""
    total = np.tile(rng.normal(size=SENSORS), (FRAMES, 1))
    for frequency, ratio in LINES:
        omega = 2 * np.pi * frequency
        swing = np.exp(-ratio * omega * TIMES + 1j * omega * np.sqrt(1 - ratio**2) * TIMES)
        total += np.real(np.outer(swing, rng.normal(size=SENSORS) + 1j * rng.normal(size=SENSORS)))
    return total


def matrix(values: np.ndarray) -> DisplacementMatrix:
    return factored(values, np.eye(SENSORS))


def model(accepted: tuple[bool, ...] = (True, True, True)) -> ModalModel:
    verdicts = [Verdict.ACCEPTED if each else Verdict.REJECTED for each in accepted]
    return ModalModel(
        frequencies=LINES[:, 0],
        frequency_stds=np.zeros(3),
        damping_ratios=LINES[:, 1],
        damping_stds=np.zeros(3),
        mode_shapes=np.zeros((SENSORS, 1, 3)),
        coordinates=np.zeros((FRAMES, 3)),
        quality=tuple(
            ModeQuality(energy_share=0.3, mpc=1.0, mac_between_methods=None, verdict=verdict) for verdict in verdicts
        ),
    )


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(3)


def test_free_decays_are_found_again(rng: np.random.Generator) -> None:
    truth = decays(rng)
    np.testing.assert_allclose(modal_motion(matrix(truth), model()).values[..., 0], truth, atol=1e-9)


def test_noise_shrinks_as_the_unknowns_are_fewer_than_the_frames(rng: np.random.Generator) -> None:
    truth = decays(rng)
    noise = rng.normal(size=truth.shape)
    left = modal_motion(matrix(truth + noise), model()).values[..., 0] - truth
    # seven unknowns for ninety frames: a share of sqrt(7 / 90) of white noise is left
    assert np.sqrt(np.mean(left**2)) == pytest.approx(np.sqrt(7 / 90), rel=0.1)


def test_lost_frames_are_filled(rng: np.random.Generator) -> None:
    truth = decays(rng)
    seen = truth.copy()
    seen[[7, 30, 31]] = np.nan
    filled = modal_motion(matrix(seen), model())
    assert filled.valid.all()
    np.testing.assert_allclose(filled.values[..., 0], truth, atol=1e-9)


def test_what_was_not_accepted_has_no_part(rng: np.random.Generator) -> None:
    truth = decays(rng)
    without = modal_motion(matrix(truth), model((True, True, False))).values[..., 0]
    omega = 2 * np.pi * LINES[2, 0]
    third = np.exp(-1j * omega * TIMES) @ without
    assert np.abs(third).max() < 0.3 * np.abs(np.exp(-1j * omega * TIMES) @ truth).max()
