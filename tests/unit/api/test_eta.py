"""The seconds left: closed forms and scalings."""

import pytest
from scanjobs.repository import KindSummary

from services.api.eta import Pace, seconds_left


def kind(name: str, total: int, fraction: float, failed: int = 0) -> KindSummary:
    return KindSummary(
        kind=name, total=total, done=round(total * fraction), running=0, failed=failed, fraction=fraction
    )


def pace(worked_s: float = 40.0, elapsed_s: float = 20.0, **mean_s: float) -> Pace:
    return Pace(mean_s=mean_s, worked_s=worked_s, elapsed_s=elapsed_s)


def test_work_left_is_divided_by_the_pace() -> None:
    # 6 renders of 4 s at 2 s of work a second
    assert seconds_left([kind("render", 10, 0.4)], pace(render=4.0)) == pytest.approx(12)


def test_twice_the_workers_take_half_the_time() -> None:
    progress = [kind("render", 10, 0.4), kind("train", 10, 0.1)]
    one = seconds_left(progress, pace(worked_s=20, render=4.0, train=6.0))
    two = seconds_left(progress, pace(worked_s=40, render=4.0, train=6.0))
    assert one is not None
    assert two == pytest.approx(one / 2)


def test_a_kind_that_has_not_begun_costs_what_the_dearest_does() -> None:
    progress = [kind("render", 2, 0.5), kind("train", 3, 0.0)]
    assert seconds_left(progress, pace(10, 10, render=5.0)) == pytest.approx(5 + 3 * 5)


def test_what_has_failed_is_not_waited_for() -> None:
    assert seconds_left([kind("render", 4, 0.5, failed=2)], pace(10, 10, render=5.0)) == 0


def test_nothing_is_foretold_before_anything_has_ended() -> None:
    assert seconds_left([kind("render", 4, 0.1)], Pace(mean_s={}, worked_s=0, elapsed_s=0)) is None


def test_nothing_left_is_zero() -> None:
    assert seconds_left([kind("render", 4, 1.0)], pace(render=5.0)) == 0
