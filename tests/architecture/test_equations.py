"""What docs/equations.md says of the paper's equations 11 to 18, shown with matrices: rows are time, columns sensors.

n frames, m sensors, r components; D (n, m) is made of r modes, q (n, r) and Phi (r, m). Each printed product that
cannot be formed is tried; each reading that replaces it is held by the identity it must obey.
"""

from itertools import pairwise

import numpy as np
import pytest
from nerfmodal.surface.sensors import displace

FRAMES, SENSORS, RANK = 40, 17, 3
RNG = np.random.default_rng(11)
Q = RNG.normal(size=(FRAMES, RANK)) * (4.0, 2.0, 1.0)
PHI = RNG.normal(size=(RANK, SENSORS))
D = Q @ PHI
LEFT, SINGULAR, RIGHT = np.linalg.svd(D, full_matrices=False)
U_R = RIGHT[:RANK].T
ETA = D @ U_R
PSI = np.linalg.lstsq(Q, ETA, rcond=None)[0]


def fits(*matrices: np.ndarray) -> bool:
    """Whether the product can be formed."""
    return all(left.shape[1] == right.shape[0] for left, right in pairwise(matrices))


def test_eq_12_as_printed_cannot_be_formed_and_as_read_gives_the_scores():
    assert not fits(D, U_R.T)
    np.testing.assert_allclose(D @ U_R, LEFT[:, :RANK] * SINGULAR[:RANK], atol=1e-10)


def test_eq_13_fits_as_printed():
    np.testing.assert_allclose(ETA, Q @ PSI, atol=1e-10)
    np.testing.assert_allclose(ETA, sum(np.outer(Q[:, i], PSI[i]) for i in range(RANK)), atol=1e-10)


def test_eq_14_as_printed_cannot_be_formed_and_as_read_gives_the_displacement():
    assert not fits(Q, PSI, U_R)
    np.testing.assert_allclose(Q @ PSI @ U_R.T, D, atol=1e-10)


def test_eq_15_as_printed_has_the_transposed_shape_and_gives_other_shapes():
    printed = U_R @ np.linalg.inv(PSI)
    assert printed.shape == (SENSORS, RANK) != PHI.shape
    assert not np.allclose(mac(printed.T, PHI), 1, atol=0.05)


def test_eq_15_as_read_gives_the_shapes():
    np.testing.assert_allclose(PSI @ U_R.T, PHI, atol=1e-10)


def test_eq_15_as_printed_is_right_where_the_mixing_is_a_rotation():
    """Only if Psi⁻ᵀ = Psi: modes of equal energy whose shapes are orthogonal."""
    rotation = np.linalg.qr(RNG.normal(size=(RANK, RANK)))[0]
    np.testing.assert_allclose((U_R @ np.linalg.inv(rotation)).T, rotation @ U_R.T, atol=1e-10)


def test_eq_16_as_printed_has_a_row_per_sensor_and_as_read_gives_the_coordinates():
    assert (U_R @ PSI).shape == (SENSORS, RANK) != Q.shape
    np.testing.assert_allclose(ETA @ np.linalg.inv(PSI), Q, atol=1e-10)


@pytest.mark.parametrize("mode", range(RANK))
def test_eq_18_as_printed_mixes_twice_and_as_read_leaves_one_mode(mode: int):
    alone = np.outer(Q[:, mode], PSI[mode])  # eq 17 with alpha = 1, beta = 0
    np.testing.assert_allclose(alone @ U_R.T, np.outer(Q[:, mode], PHI[mode]), atol=1e-10)
    assert not np.allclose(alone @ PHI, np.outer(Q[:, mode], PHI[mode]), rtol=0.05)


def test_eq_18_with_all_modes_kept_returns_the_displacement_as_read_alone():
    np.testing.assert_allclose(ETA @ U_R.T, D, atol=1e-10)
    assert not np.allclose(ETA @ PHI, D, rtol=0.05)


@pytest.mark.parametrize("frequency", [2.17, 9.61])
def test_eq_11_from_the_frame_before_scales_each_mode_by_its_frequency(frequency: float):
    rate, frames = 30.0, np.arange(3000)
    wave = np.cos(2 * np.pi * frequency * frames / rate)
    gain = np.diff(wave).std() / wave.std()
    assert gain == pytest.approx(2 * np.sin(np.pi * frequency / rate), rel=1e-3)


def mac(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Modal assurance criterion of shapes in rows, pairwise in order."""
    product = (first * second).sum(axis=1) ** 2
    return product / ((first**2).sum(axis=1) * (second**2).sum(axis=1))


@pytest.mark.parametrize("reference", ["mean", "first", "previous"])
def test_eq_11_displacement_is_the_difference_from_what_was_asked(reference: str):
    positions = np.random.default_rng(2).normal(size=(8, 3))
    moved, valid = displace(positions, np.ones(8, dtype=bool), reference)
    expected = {
        "mean": positions - positions.mean(axis=0),
        "first": positions - positions[0],
        "previous": np.vstack([np.full(3, np.nan), positions[1:] - positions[:-1]]),
    }[reference]
    np.testing.assert_allclose(moved, expected)
    assert valid.tolist() == [reference != "previous", *[True] * 7]
