"""Scores, limits and charts by law: exact distributions, run lengths by simulation, known changes found."""

import numpy as np
import pytest
from scanjobs.monitoring.changes import change_points, sen_slope, trend
from scanjobs.monitoring.charts import Record, run_length_of, watch
from scanjobs.monitoring.drift import History, Wish, drift
from scanjobs.monitoring.learning import Normal, normal_score
from scanjobs.monitoring.limits import (
    cusum_limit,
    cusum_run_length,
    ewma_limit,
    ewma_run_length,
    t2_limit,
    twice_in_a_row,
)
from scipy import stats

HALF_DAY_S = 43_200.0


def test_scores_are_independent_standard_normals_whatever_the_regression() -> None:
    """Hawkins 1987: from the first scores on, with unknown mean, slope and variance."""
    rng = np.random.default_rng(3)
    scores = []
    for _ in range(2000):
        model, found = Normal(2), []
        slope, sigma = rng.normal(0, 5), rng.uniform(0.1, 10)
        for k in range(12):
            row = np.array([1.0, rng.normal()])
            value = 7.0 + slope * row[1] + rng.normal(0, sigma)
            if k >= 5:
                found.append(model.score(row, value))
            model.learn(row, value)
        scores.append(found)
    table = np.array(scores)
    assert stats.kstest(table.ravel(), "norm").pvalue > 0.01
    assert np.abs(np.corrcoef(table.T) - np.eye(table.shape[1])).max() < 0.1


def test_a_regression_is_least_squares() -> None:
    rng = np.random.default_rng(0)
    rows = np.column_stack([np.ones(30), rng.normal(size=30)])
    values = rows @ [2.0, -0.5] + rng.normal(0, 0.1, 30)
    model = Normal(2)
    for row, value in zip(rows, values, strict=True):
        model.learn(row, value)
    fit = stats.linregress(rows[:, 1], values)
    np.testing.assert_allclose(model.coefficients, [fit.intercept, fit.slope])
    np.testing.assert_allclose(model.coefficient_stds, [fit.intercept_stderr, fit.stderr])


@pytest.mark.parametrize("t", [-30.0, -1.0, 0.0, 2.0, 400.0])
def test_scores_have_the_probability_of_their_t(t: float) -> None:
    expected = np.clip(stats.norm.isf(stats.t.sf(abs(t), 9)), 0, 8) * np.sign(t)
    assert normal_score(t, 9) == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize(("limit", "weight", "length"), [(2.814, 0.1, 500), (2.998, 0.25, 500), (3.054, 0.4, 500)])
def test_run_lengths_of_the_ewma_are_those_of_lucas_and_saccucci(limit: float, weight: float, length: float) -> None:
    """Their table 3."""
    assert ewma_run_length(limit, weight) == pytest.approx(length, rel=0.02)
    assert ewma_limit(float(length), weight) == pytest.approx(limit, abs=0.005)


@pytest.mark.parametrize(("limit", "length"), [(4.0, 168), (5.0, 465)])
def test_run_lengths_of_the_cusum_are_those_of_montgomery(limit: float, length: float) -> None:
    """Introduction to Statistical Quality Control, table 9.3, slack 1/2."""
    assert cusum_run_length(limit, 0.5) == pytest.approx(length, rel=0.02)
    assert cusum_limit(cusum_run_length(limit, 0.5), 0.5) == pytest.approx(limit, abs=1e-3)


def test_t2_limit_is_exceeded_as_often_as_asked() -> None:
    rng = np.random.default_rng(5)
    learned, variables, hits = 20, 3, 0
    for _ in range(4000):
        sample = rng.normal(size=(learned, variables))
        error = rng.normal(size=variables) - sample.mean(axis=0)
        hits += error @ np.linalg.solve(np.cov(sample.T), error) > t2_limit(0.02, variables, learned)
    assert hits / 4000 == pytest.approx(0.02, abs=0.007)


def test_two_in_a_row_come_as_rarely_as_asked_with_outliers_too() -> None:
    for outliers in (0.0, 0.02):
        chance = twice_in_a_row(1000.0, outliers)
        assert chance**2 + 2 * outliers * chance == pytest.approx(1e-3)


def record(values: np.ndarray, reference: int = 12) -> Record:
    scans = len(values)
    in_reference = np.broadcast_to((np.arange(scans) < reference)[:, None], values.shape)
    return Record(values, np.full(values.shape, 0.003), np.zeros((scans, 0)), in_reference, np.ones(scans, bool))


def test_charts_of_an_unchanged_plant_keep_to_their_run_length() -> None:
    rng = np.random.default_rng(7)
    length, scans, plants = 150.0, 60, 100
    alarms, watched = 0, 0
    for _ in range(plants):
        found = watch(record(rng.normal(0, 0.01, (scans, 2))), length)
        alarms += bool(found.signals)
        watched += (found.signals[0] if found.signals else scans) - 12
    assert 0.3 / length < alarms / watched < 1.5 / length


def history(at: np.ndarray, values: np.ndarray, warm: np.ndarray | None = None) -> History:
    frequencies = np.array([2.0, 5.0]) * np.exp(values)
    covariates = {} if warm is None else {"temperature_c": warm}
    return History(at, frequencies, 0.003 * frequencies, covariates)


def test_a_step_is_found_with_its_size_and_beginning() -> None:
    rng = np.random.default_rng(11)
    at = HALF_DAY_S * np.arange(50)
    warm = 22 + rng.normal(0, 3, 50)
    values = rng.normal(0, 0.004, (50, 2)) - 0.002 * (warm - 22)[:, None]
    values[30:] += np.log(0.97)
    found = drift(history(at, values, warm), Wish())
    assert found.covariates == ("temperature_c",)
    assert found.finding is not None
    assert abs(found.finding.onset - 30) <= 1
    assert 30 <= found.finding.detected <= 33
    assert found.finding.change == pytest.approx(-0.03, abs=4 * found.finding.change_std)
    assert (found.finding.confidence > 0.99, found.finding.severity, found.finding.tracks) == (True, "warning", (0, 1))
    for effect in found.effects:
        assert effect.per_unit == pytest.approx(-0.002, abs=4 * effect.std)


def test_heat_alone_is_no_drift() -> None:
    rng = np.random.default_rng(12)
    at = HALF_DAY_S * np.arange(60)
    warm = 22 + rng.normal(0, 3, 60) + np.where(np.arange(60) > 40, 6.0, 0.0)
    values = rng.normal(0, 0.003, (60, 2)) - 0.002 * (warm - 22)[:, None]
    assert drift(history(at, values, warm), Wish()).finding is None
    assert drift(history(at, values), Wish()).finding is not None


def test_one_wild_scan_is_no_alarm() -> None:
    values = np.random.default_rng(13).normal(0, 0.004, (50, 2))
    values[35] += 0.05
    assert drift(history(HALF_DAY_S * np.arange(50), values), Wish()).finding is None


def test_charts_begin_anew_where_an_alarm_was_closed() -> None:
    values = np.random.default_rng(14).normal(0, 0.004, (50, 2))
    values[30:36] -= 0.03
    at = HALF_DAY_S * np.arange(50)
    assert drift(history(at, values), Wish()).finding is not None
    assert drift(history(at, values), Wish(charts_from=float(at[36]))).finding is None


def test_a_steady_change_is_growth_where_that_is_said() -> None:
    values = np.random.default_rng(15).normal(0, 0.003, (80, 2)) - 0.0006 * np.arange(80)[:, None]
    at = HALF_DAY_S * np.arange(80)
    assert drift(history(at, values), Wish()).finding is not None
    assert drift(history(at, values), Wish(growth=True)).finding is None


def test_scale_of_the_frequencies_changes_nothing() -> None:
    values = np.random.default_rng(16).normal(0, 0.004, (50, 2))
    values[30:] -= 0.02
    one = history(HALF_DAY_S * np.arange(50), values)
    other = History(one.at, 10 * one.frequencies, 10 * one.stds, {})
    first, second = drift(one, Wish()), drift(other, Wish())
    np.testing.assert_allclose(first.charts.scores, second.charts.scores, atol=1e-6)
    assert first.finding is not None
    assert second.finding is not None
    assert first.finding.change == pytest.approx(second.finding.change)


def test_fewer_false_alarms_asked_are_wider_limits() -> None:
    assert run_length_of(0.1, 730.0) == pytest.approx(7300.0)
    assert ewma_limit(7300.0, 0.25) > ewma_limit(730.0, 0.25)


def test_change_points_and_trends_are_told_and_noise_is_not() -> None:
    rng = np.random.default_rng(17)
    noise = rng.normal(0, 1.0, 60)
    step = noise + np.where(np.arange(60) >= 25, 6.0, 0.0)
    [point] = change_points(step)
    assert (point.scan, point.after - point.before) == (25, pytest.approx(6.0, abs=1.0))
    assert change_points(noise) == ()
    at = HALF_DAY_S * np.arange(60)
    rising = trend(at, noise + 0.2 * np.arange(60))
    assert rising is not None
    assert (rising.word, rising.per_day) == ("increasing", pytest.approx(0.4, abs=0.05))
    assert trend(at[:5], noise[:5]) is None


def test_sen_slope_is_the_median_of_all_pairs_at_uneven_times() -> None:
    days = np.array([0.0, 1.0, 1.5, 4.0, 9.0])
    assert sen_slope(days, 3.0 * days + 1.0) == pytest.approx(3.0)
