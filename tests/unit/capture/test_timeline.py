"""Instants out of time stamps: by simulated clocks whose losses, phases and drifts are known."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from nerfmodal.capture.timeline import group
from nerfmodal.errors import InvalidCapture

RATE = 30.0
NAMES = ("a", "b", "c", "d")


def clocks(count: int = 90) -> list[np.ndarray]:
    return [np.arange(count) / RATE for _ in NAMES]


def test_equal_clocks_are_one() -> None:
    line = group(clocks(), NAMES, "x", 3)
    np.testing.assert_allclose(line.times, np.arange(90) / RATE)
    assert (line.chosen == np.arange(90)[:, None]).all()


@settings(max_examples=40, deadline=None)
@given(
    lost=st.sets(st.integers(1, 88), max_size=8),
    late=st.floats(-0.49, 0.49),
    noise=st.floats(0.0, 0.05),
    seed=st.integers(0, 2**16),
)
@example(lost={16, 18, 34, 47, 55, 56, 61, 63}, late=0.0, noise=0.05, seed=0)  # medians of differences are 1 % apart
def test_lost_pictures_are_missing_and_no_other_stands_in(lost: set[int], late: float, noise: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    stamps = clocks()
    stamps[1] = np.delete(stamps[1], sorted(lost)) + late / RATE
    stamps = [one + noise / RATE * rng.uniform(-1, 1, len(one)) for one in stamps]
    line = group(stamps, NAMES, "x", 3)
    assert len(line.times) == 90
    assert set(np.flatnonzero(line.chosen[:, 1] < 0)) == lost
    used = line.chosen[line.chosen[:, 1] >= 0, 1]
    assert (np.diff(used) == 1).all()
    turn = (line.phases[1] * RATE - late + 0.5) % 1 - 0.5
    assert abs(turn) < 0.03


def test_a_varying_frame_rate_keeps_its_times() -> None:
    times = np.cumsum(np.random.default_rng(0).uniform(0.8, 1.2, 60)) / RATE
    line = group([times] * 3, NAMES[:3], "x", 3)
    np.testing.assert_allclose(line.times, times - times[0])


def test_the_record_is_what_all_have_filmed() -> None:
    stamps = clocks()
    stamps[2] = stamps[2][10:]
    stamps[3] = stamps[3][:80]
    line = group(stamps, NAMES, "x", 3)
    assert (line.chosen[0] == [10, 10, 0, 10]).all()
    assert len(line.times) == 70


def test_an_instant_that_too_few_saw_is_dropped() -> None:
    stamps = clocks()
    stamps[0], stamps[1] = np.delete(stamps[0], 40), np.delete(stamps[1], 40)
    line = group(stamps, NAMES, "x", 3)
    assert (len(line.times), line.dropped) == (89, 1)


@pytest.mark.parametrize(
    ("stamps", "said"),
    [
        ([np.arange(90) / 30, np.arange(90) / 30, np.arange(75) / 25], "25.000 pictures a second"),
        ([np.arange(90) / 30, np.arange(90) / 30, np.arange(20) / 30], "'c' with 20 pictures"),
        ([np.arange(90) / 30, np.arange(90) / 30, np.array([0.0])], "one picture"),
        ([np.arange(90) / 30, np.arange(90) / 30, 9 + np.arange(90) / 30], "film together"),
    ],
)
def test_what_cannot_be_grouped_is_refused(stamps: list[np.ndarray], said: str) -> None:
    with pytest.raises(InvalidCapture, match=said) as caught:
        group(stamps, NAMES[:3], "x", 3)
    assert caught.value.hint
