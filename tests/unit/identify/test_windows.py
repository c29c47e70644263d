"""The search in long records: sharp lines between the grid's, damped lines that die early, and silence on noise."""

import numpy as np
import pytest
from nerfmodal.identify.lines import damped_columns, whitened
from nerfmodal.identify.sinusoids import fit_sinusoids
from nerfmodal.identify.windows import windows_of

RATE = 30.0


def record(frames: int, ratio: float, noise: float, times: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(5)
    instants = np.arange(frames) / RATE if times is None else times
    columns = damped_columns(instants, np.array([[2.183, ratio], [9.61, ratio]]))[:, 1::2]
    channels = columns * [0.03, 0.015] @ rng.normal(size=(2, 5)) + noise * rng.normal(size=(len(instants), 5))
    return instants, channels


@pytest.mark.parametrize(("ratio", "within"), [(0.0, 1e-4), (0.001, 1e-3), (0.04, 0.06)])
def test_lines_of_any_damping_are_found_between_the_grids(ratio: float, within: float) -> None:
    times, channels = record(2000, ratio, 0.002)
    fit = fit_sinusoids(times, channels, frame_rate=RATE, max_modes=8, rng=np.random.default_rng(0))
    np.testing.assert_allclose(fit.frequencies, [2.183, 9.61], atol=within)
    np.testing.assert_allclose(fit.damping_ratios, ratio, atol=max(0.1 * ratio, 1e-4))


def test_lost_and_uneven_frames_are_no_lines() -> None:
    rng = np.random.default_rng(6)
    kept = np.sort(rng.choice(1200, 900, replace=False)) / RATE
    times, channels = record(0, 0.002, 0.002, kept + rng.uniform(-0.004, 0.004, 900))
    fit = fit_sinusoids(times, channels, frame_rate=RATE, max_modes=8, rng=rng)
    np.testing.assert_allclose(fit.frequencies, [2.183, 9.61], atol=2e-3)


def test_long_noise_holds_no_line() -> None:
    found = 0
    for seed in range(10):
        rng = np.random.default_rng(seed)
        noise = rng.normal(size=(600, 6))
        fit = fit_sinusoids(np.arange(600) / RATE, noise, frame_rate=RATE, max_modes=8, rng=rng)
        found += len(fit.frequencies) > 0
    assert found <= 1


def test_what_is_left_out_is_not_found_again() -> None:
    times, channels = record(600, 0.0, 0.001)
    search = windows_of(times, RATE, 0.35, 14.0)
    white = whitened(channels - channels.mean(axis=0))
    rng = np.random.default_rng(0)
    first = search.find(white, 1.0, rng)
    assert first is not None
    second = search.without(float(first[0]), 0.5).find(white, 1.0, rng)
    assert second is not None
    assert sorted([first[0], second[0]]) == pytest.approx([2.183, 9.61], abs=0.03)
