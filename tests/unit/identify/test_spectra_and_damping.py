"""Spectra and the logarithmic decrement on sinusoids of known frequency and damping."""

import numpy as np
import pytest
from nerfmodal.identify.damping import extrema, logarithmic_decrement
from nerfmodal.identify.spectra import bridge_gaps, peak_frequency, power_spectral_density, resample_evenly

RATE = 30.0
TIMES = np.arange(90) / RATE


def decay(frequency: float, damping: float, phase: float = 0.3) -> np.ndarray:
    omega = 2 * np.pi * frequency
    return np.exp(-damping * omega * TIMES) * np.cos(omega * np.sqrt(1 - damping**2) * TIMES + phase)


@pytest.mark.parametrize("damping", [0.0, 0.005, 0.02, 0.05])
def test_the_decrement_of_a_clean_decay(damping: float) -> None:
    assert logarithmic_decrement(decay(2.17, damping), 2.17, RATE) == pytest.approx(damping, abs=0.002)


def test_the_decrement_of_less_than_three_half_periods_is_no_number() -> None:
    assert np.isnan(logarithmic_decrement(decay(0.4, 0.01), 0.4, RATE))


def test_extrema_come_once_in_a_half_period() -> None:
    """Twelve half periods; with a phase of 0.3 the first top lies before the record."""
    times, sizes = extrema(decay(2.0, 0.01), 2.0, RATE)
    assert len(times) == 11
    assert (np.diff(sizes) < 0.01).all()


def test_parseval_holds() -> None:
    series = np.random.default_rng(0).normal(size=(90, 2))
    frequencies, density = power_spectral_density(series, RATE)
    np.testing.assert_allclose(density.sum(axis=0) * (frequencies[1] - frequencies[0]), series.var(axis=0))


@pytest.mark.parametrize("frames", [90, 91])
def test_a_line_stands_in_its_bin(frames: int) -> None:
    times = np.arange(frames) / RATE
    frequencies, density = power_spectral_density(np.cos(2 * np.pi * 5.0 * times)[:, None], RATE)
    assert frequencies[np.argmax(density)] == pytest.approx(5.0, abs=0.2)


@pytest.mark.parametrize("frequency", [2.17, 4.83, 9.61])
def test_the_peak_lies_between_the_bins(frequency: float) -> None:
    assert peak_frequency(decay(frequency, 0.0), RATE) == pytest.approx(frequency, abs=0.02)


def test_gaps_are_bridged_by_straight_lines() -> None:
    series = np.arange(10.0)[:, None].repeat(2, axis=1)
    gap = series.copy()
    gap[[0, 4, 5]] = np.nan
    bridged = bridge_gaps(gap)
    np.testing.assert_allclose(bridged[1:], series[1:])
    np.testing.assert_allclose(bridged[0], series[1])


def test_an_uneven_series_is_put_on_an_even_grid() -> None:
    times = np.array([0.0, 0.05, 0.1, 0.2, 0.3])
    even = resample_evenly(times, times[:, None], 10.0)
    np.testing.assert_allclose(even[:, 0], [0.0, 0.1, 0.2, 0.3])
