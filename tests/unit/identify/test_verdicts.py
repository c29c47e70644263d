"""Every reason on the side of its limit where it holds, and on the other."""

import numpy as np
import pytest
from nerfmodal.identify.verdicts import combination_lines, reasons_of, verdict_of
from nerfmodal.types import Reason, Verdict

GOOD: dict[str, float | bool | None] = {
    "frequency": 5.0,
    "damping_ratio": 0.01,
    "damping_std": 0.001,
    "amplitude": 0.01,
    "strongest": 0.02,
    "residual": 0.001,
    "mpc": 0.99,
    "agreement": 0.95,
    "combination": False,
    "duration": 3.0,
    "frame_rate": 30.0,
    "lag_one": 0.0,
}


def reasons(**changes: float | bool | None) -> tuple[Reason, ...]:
    return reasons_of(**{**GOOD, **changes})  # type: ignore[arg-type]


def test_a_good_mode_has_no_reason_against_it() -> None:
    assert reasons() == ()
    assert verdict_of((), 10.0) is Verdict.ACCEPTED


@pytest.mark.parametrize(
    ("changes", "reason", "verdict"),
    [
        ({"combination": True}, Reason.HARMONIC, Verdict.REJECTED),
        ({"frequency": 0.6}, Reason.RECORD_TOO_SHORT, Verdict.DOUBTFUL),
        ({"frequency": 13.7}, Reason.ALIAS_SUSPECT, Verdict.ACCEPTED),
        ({"damping_ratio": -0.01}, Reason.NEGATIVE_DAMPING, Verdict.DOUBTFUL),
        ({"mpc": 0.3}, Reason.LOW_MPC, Verdict.DOUBTFUL),
        ({"amplitude": 0.0003, "residual": 0.0001}, Reason.WEAK, Verdict.DOUBTFUL),
        ({"residual": 0.02}, Reason.FIT_RESIDUAL_HIGH, Verdict.DOUBTFUL),
        ({"lag_one": 0.5}, Reason.DRIFT, Verdict.ACCEPTED),
        ({"agreement": None}, Reason.METHODS_DISAGREE, Verdict.ACCEPTED),
    ],
)
def test_one_flaw_is_one_reason(changes: dict[str, float | None], reason: Reason, verdict: Verdict) -> None:
    assert reasons(**changes) == (reason,)
    assert verdict_of((reason,), 10.0) is verdict


def test_drift_throws_doubt_on_a_mode_that_stands_little_above_the_residual() -> None:
    assert verdict_of((Reason.DRIFT,), 2.0) is Verdict.DOUBTFUL


def lines(*modes: tuple[float, float], lonely: tuple[float, ...] = ()) -> list[bool]:
    frequencies, amplitudes = np.array(modes).T
    return combination_lines(frequencies, np.full(len(modes), 0.001), amplitudes, np.isin(frequencies, lonely))


def test_second_harmonic_sum_and_difference_are_combinations() -> None:
    assert lines((2.0, 0.03), (4.0, 0.001)) == [False, True]
    assert lines((2.0, 0.03), (5.0, 0.02), (7.0, 0.001)) == [False, False, True]
    assert lines((2.0, 0.03), (3.0, 0.001), (5.0, 0.02)) == [False, True, False]


def test_a_strong_line_is_a_mode_wherever_it_stands() -> None:
    assert lines((5.0, 0.015), (10.0, 0.01)) == [False, False]


def test_a_combination_that_no_other_method_finds_may_be_stronger() -> None:
    """A leaf that nine cameras saw: 2 and 10 Hz left 8 Hz, over half as large as 10 Hz, and 5 Hz with 2 Hz 7 Hz.

    Seen to fail: by the share alone both were accepted modes.
    """
    leaf = ((2.0, 0.0057), (5.0, 0.0034), (6.99, 0.00116), (7.98, 0.00084), (10.0, 0.00156))
    assert lines(*leaf) == [False] * 5
    assert lines(*leaf, lonely=(6.99, 7.98)) == [False, False, True, True, False]
    assert lines(*leaf, lonely=(2.0, 5.0, 6.99, 7.98)) == [False] * 5, "of lines that others find too"


def test_a_line_beside_the_combination_is_a_mode() -> None:
    assert lines((2.0, 0.03), (4.2, 0.001)) == [False, False]


def test_three_times_a_strong_line_is_no_mode() -> None:
    """A trunk's swing of 35 mm at 1 Hz: its third harmonic was read at 3.055 +- 0.026 Hz."""
    assert lines((1.0, 0.035), (3.055, 0.0027)) == [False, True]
    assert lines((1.0, 0.035), (3.055, 0.02)) == [False, False]
    assert lines((1.0, 0.035), (3.2, 0.0027)) == [False, False]


def test_a_faint_mode_that_no_other_method_finds_is_doubtful() -> None:
    lonely = reasons(amplitude=0.0015, agreement=None)
    assert lonely == (Reason.WEAK, Reason.METHODS_DISAGREE)
    assert verdict_of(lonely, 10.0) is Verdict.DOUBTFUL
    assert reasons(amplitude=0.0015) == ()
