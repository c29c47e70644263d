"""The density of a known signal: Parseval's law, a line at its frequency, and lost frames that change neither."""

import numpy as np
import pytest
from nerfmodal.figures.spectrum import LONGEST_SEGMENT, power_spectral_density
from scipy.integrate import trapezoid

RATE = 30.0


def test_density_integrates_to_the_variance():
    rng = np.random.default_rng(0)
    times, values = np.arange(90) / RATE, rng.normal(0, 3, 90)
    frequencies, density = power_spectral_density(times, values, RATE)
    assert trapezoid(density, frequencies) == pytest.approx(values.var(), rel=1e-6)


@pytest.mark.parametrize("lost", [[], [3, 17, 18, 60]])
def test_a_line_between_bins_stands_at_its_place(lost):
    times = np.arange(90) / RATE
    values = np.cos(2 * np.pi * 4.83 * times)
    values[lost] = np.nan
    frequencies, density = power_spectral_density(times, values, RATE)
    assert frequencies[np.argmax(density)] == pytest.approx(4.83, abs=0.09)


def test_white_noise_of_a_long_record_is_flat_at_its_level():
    rng = np.random.default_rng(1)
    times = np.arange(16 * LONGEST_SEGMENT) / RATE
    _, density = power_spectral_density(times, rng.normal(0, 1, len(times)), RATE)
    assert density[8:-8].mean() == pytest.approx(2 / RATE, rel=0.05)
