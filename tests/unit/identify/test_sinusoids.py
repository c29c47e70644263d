"""The joint damped-sinusoid fit: exact on clean records, at the physical limit in noise, silent on noise alone."""

import numpy as np
import pytest
from nerfmodal.bounds import cramer_rao
from nerfmodal.identify.lines import candidate_grid, column_derivatives, damped_columns, find_line
from nerfmodal.identify.metrics import mac
from nerfmodal.identify.shapes import rotate_to_real
from nerfmodal.identify.sinusoids import SinusoidFit, fit_lines, fit_sinusoids, useful_channels

RATE = 30.0
TIMES = np.arange(90) / RATE
LINES = np.array([[2.17, 0.005], [4.83, 0.01], [9.61, 0.02]])
SHAPES = np.random.default_rng(0).normal(size=(3, 8))
AMPLITUDES = np.array([0.03, 0.015, 0.01])


def record(times: np.ndarray = TIMES, lines: np.ndarray = LINES, noise: float = 0.0, seed: int = 1) -> np.ndarray:
    """Eight channels of damped cosines with a phase each, a constant, and noise that is correlated between channels."""
    rng = np.random.default_rng(seed)
    columns = damped_columns(times, lines)[:, 1:]
    phases = rng.uniform(0, 2 * np.pi, len(lines))
    q = np.cos(phases) * columns[:, ::2] - np.sin(phases) * columns[:, 1::2]
    mixed = rng.normal(size=(len(times), 8)) @ (np.eye(8) + 0.5 * np.random.default_rng(2).normal(size=(8, 8)))
    return (q * AMPLITUDES[: len(lines)]) @ SHAPES[: len(lines)] + 0.4 + noise * mixed


def fitted(channels: np.ndarray, times: np.ndarray = TIMES, seed: int = 0) -> SinusoidFit:
    return fit_sinusoids(times, channels, frame_rate=RATE, max_modes=8, rng=np.random.default_rng(seed))


def test_a_clean_record_is_read_exactly() -> None:
    fit = fitted(record(noise=1e-9))
    np.testing.assert_allclose(fit.frequencies, LINES[:, 0], atol=1e-6)
    np.testing.assert_allclose(fit.damping_ratios, LINES[:, 1], atol=1e-6)
    for found, true in zip(rotate_to_real(fit.amplitudes.T).T, SHAPES, strict=True):
        assert mac(found, true) == pytest.approx(1.0)


def test_any_time_stamps_do() -> None:
    rng = np.random.default_rng(3)
    times = np.sort(rng.uniform(0, 3, 70))
    fit = fitted(record(times, noise=1e-5), times)
    np.testing.assert_allclose(fit.frequencies, LINES[:, 0], atol=2e-4)


def test_the_start_of_time_does_not_matter() -> None:
    channels = record(noise=0.001)
    later = fitted(channels, TIMES + 1000.0)
    np.testing.assert_allclose(later.frequencies, fitted(channels).frequencies, atol=1e-6)


def test_mixing_the_channels_changes_nothing() -> None:
    channels, mixing = record(noise=0.002), np.random.default_rng(4).normal(size=(8, 8))
    straight, mixed = fitted(channels), fitted(channels @ mixing)
    np.testing.assert_allclose(mixed.frequencies, straight.frequencies, atol=1e-5)
    np.testing.assert_allclose(mixed.damping_stds, straight.damping_stds, rtol=1e-3)


def test_noise_alone_holds_no_line() -> None:
    silent = [len(fitted(0.01 * np.random.default_rng(seed).normal(size=(90, 8))).frequencies) for seed in range(15)]
    assert sum(count > 0 for count in silent) <= 1


def test_two_close_lines_are_two() -> None:
    lines = np.array([[2.0, 0.01], [2.2, 0.01]])
    fit = fitted(record(lines=lines, noise=0.0005))
    np.testing.assert_allclose(fit.frequencies, [2.0, 2.2], atol=0.01)


def test_a_growing_line_has_negative_damping() -> None:
    lines = np.array([[3.0, -0.01]])
    assert fitted(record(lines=lines, noise=0.0005)).damping_ratios[0] == pytest.approx(-0.01, abs=0.001)


def test_the_derivatives_of_the_columns() -> None:
    step = 1e-6
    for parameter in (0, 1):
        shift = step * np.eye(2)[parameter]
        difference = (damped_columns(TIMES, LINES + shift) - damped_columns(TIMES, LINES - shift)) / (2 * step)
        for mode, derivative in enumerate(column_derivatives(TIMES, LINES, parameter)):
            np.testing.assert_allclose(derivative, difference[:, 1 + 2 * mode : 3 + 2 * mode], atol=1e-4)


def test_the_search_finds_the_line_that_the_model_lacks() -> None:
    residual = record(noise=0.0005) - record(noise=0.0005).mean(axis=0)
    known = LINES[:2]
    columns = damped_columns(TIMES, known)
    residual = residual - columns @ np.linalg.lstsq(columns, residual, rcond=None)[0]
    line = find_line(TIMES, residual, known, grid=candidate_grid(TIMES, 0.35, 13.5), rng=np.random.default_rng(0))
    assert line is not None
    assert line[0] == pytest.approx(9.61, abs=0.1)


def test_errors_are_at_the_bound_and_the_stated_deviation_is_true() -> None:
    """One line in white noise that is equal in all channels: root-mean-square errors against Cramér-Rao."""
    lines = LINES[1:2]
    shape = np.ones(4) / 2.0
    truth = (damped_columns(TIMES, lines)[:, 1:2] * 0.01) @ shape[None]
    bound = cramer_rao(TIMES, 4.83, 0.01, 10.0)
    errors, stated = [], []
    for seed in range(120):
        channels = truth + 0.001 * np.random.default_rng(seed).normal(size=(90, 4))
        start = np.array([[4.8, 0.0]])
        found = fit_lines(TIMES, channels, start, frame_rate=RATE)[0]
        errors.append(found - lines[0])
        if seed < 20:
            fit = fitted(channels, seed=seed)
            stated.append((fit.frequency_stds[0], fit.damping_stds[0]))
    rms = np.sqrt(np.mean(np.square(errors), axis=0))
    assert rms[0] < 1.2 * bound[0]
    assert rms[1] < 1.2 * bound[1]
    np.testing.assert_allclose(np.mean(stated, axis=0), bound, rtol=0.25)


@pytest.mark.parametrize(
    ("frequency", "damping", "millihertz"),
    [(1.0, 0.0, 2.8), (14.0, 0.0, 2.8), (1.0, 0.01, 3.1), (5.0, 0.01, 4.4), (10.0, 0.02, 16.0), (5.0, 0.05, 22.0)],
)
def test_the_bound_is_the_published_table(frequency: float, damping: float, millihertz: float) -> None:
    frequency_sd, damping_sd = cramer_rao(TIMES, frequency, damping, 10.0)
    assert 1e3 * frequency_sd == pytest.approx(millihertz, rel=0.1)
    assert damping_sd == pytest.approx(frequency_sd / frequency, rel=0.25)


def test_twice_the_record_is_worth_almost_three_times() -> None:
    short, _ = cramer_rao(TIMES, 5.0, 0.0, 10.0)
    double, _ = cramer_rao(np.arange(180) / RATE, 5.0, 0.0, 10.0)
    assert short / double == pytest.approx(2.8, rel=0.05)


def test_channels_that_are_rounding_are_left_out() -> None:
    scores = np.random.default_rng(5).normal(size=(90, 4)) * np.array([1.0, 0.1, 1e-9, 1e-12])
    assert useful_channels(scores) == 2
    assert useful_channels(np.random.default_rng(6).normal(size=(24, 20))) == 4
    assert useful_channels(np.random.default_rng(6).normal(size=(90, 20))) == 13


def test_lag_one_is_the_correlation_of_the_residual() -> None:
    rng = np.random.default_rng(7)
    state, rows = np.zeros(4), []
    for _ in range(400):
        state = 0.6 * state + 0.8 * rng.normal(size=4)
        rows.append(state)
    times = np.arange(400) / RATE
    fit = fit_sinusoids(times, np.array(rows), frame_rate=RATE, max_modes=1, rng=rng)
    assert fit.lag_one(np.zeros(len(fit.frequencies), dtype=bool)) == pytest.approx(0.6, abs=0.1)
