"""Clocks out of signals whose lag is known; what fits several lags is refused."""

from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from nerfmodal.capture.signals import Signals, repeats
from nerfmodal.capture.synchronise import find_offsets, flashes, motion, signal_peak
from nerfmodal.capture.video import Stamps
from nerfmodal.errors import InvalidCapture
from nerfmodal.spec import CaptureSource

RATE = 30.0
SILENT = [Stamps(path=Path(name), width=8, height=8, time_base=Fraction(1, 30), ticks=(), sound=False) for name in "ab"]


def source(**options: object) -> CaptureSource:
    return CaptureSource.model_validate({"kind": "capture", "path": "x", **options})


def seen(began: float, seed: int, count: int = 150, *, flash: bool = False, pluck: bool = True) -> Signals:
    """What a camera shows that began `began` s after the first: a plant plucked at 2 s, a lamp lit for 0.2 s at 3 s."""
    times = np.arange(count) / RATE
    now = times + began
    rng = np.random.default_rng(seed)
    swing = (
        np.exp(-1.2 * np.maximum(now - 2, 0)) * np.abs(np.cos(2 * np.pi * 1.7 * now)) / (1 + np.exp(-(now - 2) / 0.03))
    )
    swaying = np.abs(np.cos(2 * np.pi * 1.7 * now))
    lamp = 40 / (1 + np.exp(-(now - 3) / 0.02)) / (1 + np.exp((now - 3.2) / 0.02))
    change = 0.3 + 5 * (swing if pluck else swaying) + 0.05 * rng.normal(size=count)
    brightness = 100 + (lamp if flash else 0) + 0.1 * rng.normal(size=count)
    return Signals(times=times, brightness=brightness, change=change)


@pytest.mark.parametrize("began", [0.0, 0.437, -0.81, 1.2345])
def test_motion_tells_when_a_camera_began(began: float) -> None:
    peak = signal_peak(motion(seen(0.0, 1)), motion(seen(began, 2)))
    assert peak.lag == pytest.approx(-began, abs=0.25 / RATE)
    assert peak.stands_out(0.5, 0.85)


@pytest.mark.parametrize("began", [0.437, -0.81])
def test_a_flash_tells_when_a_camera_began(began: float) -> None:
    peak = signal_peak(flashes(seen(0.0, 1, flash=True)), flashes(seen(began, 2, flash=True)))
    assert peak.lag == pytest.approx(-began, abs=0.25 / RATE)
    assert peak.stands_out(0.5, 0.85)


def test_an_endless_sway_is_no_answer() -> None:
    signals = [seen(0.0, 1, pluck=False), seen(0.3, 2, pluck=False)]
    with pytest.raises(InvalidCapture, match="motion does not fit") as caught:
        find_offsets(source(), ["a", "b"], SILENT, signals, "here")
    assert "offsets_s" in str(caught.value.hint)


def test_the_first_clear_way_is_taken() -> None:
    lit = [seen(0.0, 1, flash=True), seen(0.3, 2, flash=True)]
    assert find_offsets(source(), ["a", "b"], SILENT, lit, "here").found_by == "flash"
    dark = [seen(0.0, 1), seen(0.3, 2)]
    found = find_offsets(source(), ["a", "b"], SILENT, dark, "here")
    assert found.found_by == "motion"
    assert found.seconds["b"] == pytest.approx(-0.3, abs=0.25 / RATE)


def test_given_offsets_are_taken_as_they_are() -> None:
    found = find_offsets(source(offsets_s={"b": 0.7}), ["a", "b"], SILENT, [seen(0, 1)] * 2, "here")
    assert (found.seconds, found.found_by) == ({"a": 0.0, "b": 0.7}, "given")
    with pytest.raises(InvalidCapture, match="'c'"):
        find_offsets(source(offsets_s={"c": 0.7}), ["a", "b"], SILENT, [seen(0, 1)] * 2, "here")


def test_clocks_that_are_trusted_are_not_searched() -> None:
    found = find_offsets(source(synchronise="clocks"), ["a", "b"], SILENT, [seen(0, 1), seen(0.3, 2)], "here")
    assert set(found.seconds.values()) == {0.0}


def test_a_repeated_picture_is_known_from_a_still_scene() -> None:
    moving = [seen(0.0, k) for k in range(3)]
    stuck = moving[1].change.copy()
    stuck[[40, 41, 97]] = 0.0
    moving[1] = replace(moving[1], change=stuck)
    found = repeats(moving, [0.0, 0.0, 0.0])
    assert [np.flatnonzero(one).tolist() for one in found] == [[], [40, 41, 97], []]
    still = [replace(one, change=0 * one.change) for one in moving]
    assert not any(one.any() for one in repeats(still, [0.0, 0.0, 0.0]))
