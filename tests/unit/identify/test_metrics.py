"""Metrics against their definitions and invariances."""

import numpy as np
import pytest
from nerfmodal.errors import InvalidInput
from nerfmodal.identify.metrics import damping_error, frequency_error, mac, mac_matrix, mpc, mpd, msf, pair

RNG = np.random.default_rng(0)
REAL = RNG.normal(size=50)
COMPLEX = RNG.normal(size=50) + 1j * RNG.normal(size=50)


def test_mac_of_a_shape_with_any_multiple_of_itself_is_one() -> None:
    assert mac(COMPLEX, (2.0 - 3.0j) * COMPLEX) == pytest.approx(1.0)


def test_mac_of_orthogonal_shapes_is_zero() -> None:
    assert mac(np.array([1.0, 1.0]), np.array([1.0, -1.0])) == pytest.approx(0.0)


def test_mac_of_nothing_is_zero() -> None:
    assert mac(np.zeros(3), np.ones(3)) == 0.0


def test_mac_of_a_known_angle_is_its_cosine_squared() -> None:
    assert mac(np.array([1.0, 0.0]), np.array([np.cos(0.3), np.sin(0.3)])) == pytest.approx(np.cos(0.3) ** 2)


def test_mac_matrix_holds_the_mac_of_every_pair() -> None:
    first, second = RNG.normal(size=(20, 3)), RNG.normal(size=(20, 4))
    slow = [[mac(a, b) for b in second.T] for a in first.T]
    np.testing.assert_allclose(mac_matrix(first, second), slow)


def test_shapes_of_different_sensors_are_refused() -> None:
    with pytest.raises(InvalidInput, match="degrees of freedom"):
        mac(np.ones(3), np.ones(4))


def test_msf_scales_the_second_onto_the_first() -> None:
    assert msf(REAL * 2.5, REAL) == pytest.approx(2.5)


def test_mpc_is_one_for_a_turned_real_shape_and_low_for_random_phases() -> None:
    assert mpc(REAL * np.exp(0.7j)) == pytest.approx(1.0)
    assert mpc(COMPLEX) < 0.3


def test_mpd_is_zero_for_a_turned_real_shape_and_the_angle_for_two_phases() -> None:
    assert mpd(REAL * np.exp(0.7j)) == pytest.approx(0.0, abs=1e-4)
    assert mpd(np.array([np.exp(0.2j), np.exp(-0.2j)])) == pytest.approx(np.degrees(0.2))


def test_errors_are_found_minus_true() -> None:
    assert frequency_error(2.02, 2.0) == pytest.approx(0.01)
    assert damping_error(0.012, 0.010) == pytest.approx(0.2)


def test_pairs_are_the_nearest_and_each_is_used_once() -> None:
    assert pair([1.0, 2.0, 9.0], [2.1, 1.2, 2.05], within_hz=0.5) == [(0, 1), (1, 2)]


def test_close_lines_are_told_apart_by_their_shapes() -> None:
    likeness = np.array([[0.1, 0.9], [0.9, 0.1]])
    assert pair([2.0, 2.1], [2.0, 2.1], likeness, within_hz=0.5) == [(0, 1), (1, 0)]


def test_nothing_pairs_with_nothing() -> None:
    assert pair([], [1.0], within_hz=1.0) == []


def test_a_shape_that_does_not_move_has_no_scale_and_no_phase() -> None:
    with pytest.raises(InvalidInput, match="zero everywhere"):
        msf(REAL, np.zeros(50))
    with pytest.raises(InvalidInput, match="zero everywhere"):
        mpd(np.zeros(3))


@pytest.mark.parametrize("within_hz", [0.0, -1.0, np.nan])
def test_lines_cannot_be_paired_within_no_distance(within_hz: float) -> None:
    with pytest.raises(InvalidInput, match="cannot be paired"):
        pair([1.0], [1.0], within_hz=within_hz)


def test_likeness_of_other_modes_is_refused() -> None:
    with pytest.raises(InvalidInput, match="does not fit 1 and 2 lines"):
        pair([1.0], [1.0, 2.0], np.ones((2, 2)), within_hz=1.0)
