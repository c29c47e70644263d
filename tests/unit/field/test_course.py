"""What is said of a training, and when it is given up or has settled."""

import numpy as np
import pytest
from nerfmodal.errors import TrainingDiverged
from nerfmodal.field.course import Course, Settling, psnr


def test_loss_psnr_and_speed_are_told() -> None:
    heard: list[tuple[int, int, str]] = []
    course = Course(3, lambda *said: heard.append(said))
    course.step(0.01, 100)
    done, total, message = heard[-1]
    assert (done, total) == (1, 3)
    assert "loss 1.00e-02, PSNR 20.0 dB" in message
    assert message.endswith("k rays/s")


def test_a_hundredth_is_twenty_decibels() -> None:
    assert psnr(0.01) == pytest.approx(20.0)


@pytest.mark.parametrize("loss", [np.nan, np.inf])
def test_a_loss_that_is_no_number_ends_the_training(loss: float) -> None:
    course = Course(10, lambda *_: None)
    with pytest.raises(TrainingDiverged, match="iteration 0"):
        course.step(loss, 1)


def test_a_loss_that_rises_far_ends_the_training_with_both_numbers() -> None:
    course = Course(500, lambda *_: None)
    for _ in range(200):
        course.step(0.001, 1)
    with pytest.raises(TrainingDiverged, match=r"rose from 0\.001 to"):
        for _ in range(50):
            course.step(0.5, 1)


def test_a_new_stage_may_begin_worse() -> None:
    course = Course(500, lambda *_: None)
    for _ in range(200):
        course.step(0.001, 1)
    course.turn()
    for _ in range(200):
        course.step(0.5, 1)
    assert course.done == 400


def test_a_surface_rests_when_its_rays_meet_it_where_they_did() -> None:
    places = iter([np.ones(200), np.ones(200) + 0.1, np.ones(200) + 0.1001])
    settling = Settling(lambda: next(places), 0.01)
    assert [settling.rests() for _ in range(3)] == [False, False, True]


def test_a_surface_that_still_appears_does_not_rest() -> None:
    some = np.where(np.arange(200) < 100, 1.0, 0.0)
    places = iter([some, np.ones(200)])
    settling = Settling(lambda: next(places), 0.01)
    assert [settling.rests(), settling.rests()] == [False, False]
