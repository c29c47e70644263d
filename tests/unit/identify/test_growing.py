"""A record that grows tells what the whole one tells, in any order of its frames."""

from dataclasses import replace

import numpy as np
import pytest
from nerfmodal.identify import identify
from nerfmodal.identify.growing import FrameFit, GrowingRecord, modes_so_far, pool
from nerfmodal.identify.lines import damped_columns
from nerfmodal.spec import IdentificationSpec, OrganSpec
from nerfmodal.surface.following import follow
from nerfmodal.types import Outcome, SensorGrid

from tests.fixtures.moving_clouds import Mode, Scene, Trunk, leaf_clouds, trunk_clouds

LINES = np.array([[2.17, 0.005], [4.83, 0.01], [9.61, 0.02]])
TERMS, SENSORS, RATE = 9, 60, 30.0
NOISE = 0.002
RNG = np.random.default_rng(0)
SHAPES = RNG.normal(size=(3, TERMS))
BASIS = RNG.normal(size=(SENSORS, TERMS))
EMPTY = GrowingRecord(
    sensors=SensorGrid(organ="leaf", positions=np.zeros((SENSORS, 3))),
    surface="polynomial",
    basis=BASIS,
    directions=np.array([[0.0, 0.0, 1.0]]),
    frame_rate=RATE,
)
SETTINGS = IdentificationSpec()


def frames(count: int = 90) -> list[FrameFit]:
    times = np.arange(count) / RATE
    q = damped_columns(times, LINES)[:, 1::2] * [0.03, 0.02, 0.015]
    measured = q @ SHAPES + NOISE * np.random.default_rng(1).normal(size=(count, TERMS))
    information = np.eye(TERMS) / NOISE**2
    return [
        FrameFit(time=float(time), coefficients=row, information=information)
        for time, row in zip(times, measured, strict=True)
    ]


def grown(order: list[FrameFit], record: GrowingRecord = EMPTY) -> GrowingRecord:
    for frame in order:
        record = record.with_frame(frame)
    return record


def test_step_by_step_is_the_same_as_at_once() -> None:
    every, record = frames(), EMPTY
    for start in range(0, 90, 15):
        record = grown(every[start : start + 15], record)
        result, record = modes_so_far(record, SETTINGS, seed=0)
    at_once = identify(grown(every).displacement(), SETTINGS, seed=0)
    np.testing.assert_allclose(result.model.frequencies, at_once.model.frequencies, atol=1e-4)
    np.testing.assert_allclose(result.model.damping_ratios, at_once.model.damping_ratios, atol=1e-4)
    assert [quality.verdict for quality in result.model.quality] == [
        quality.verdict for quality in at_once.model.quality
    ]
    np.testing.assert_allclose(result.model.frequencies, LINES[:, 0], atol=0.02)


def test_the_order_of_arrival_does_not_matter() -> None:
    every = frames(40)
    shuffled = [every[place] for place in np.random.default_rng(2).permutation(40)]
    first, _ = modes_so_far(grown(every), SETTINGS, seed=0)
    second, _ = modes_so_far(grown(shuffled), SETTINGS, seed=0)
    np.testing.assert_array_equal(first.model.frequencies, second.model.frequencies)


def test_a_frame_that_comes_twice_counts_once() -> None:
    every = frames(20)
    record = grown([*every, replace(every[3], coefficients=every[4].coefficients)])
    assert len(record.frames) == 20
    np.testing.assert_array_equal(record.frames[3].coefficients, every[4].coefficients)


@pytest.mark.parametrize("count", [0, 1, 15])
def test_too_few_frames_say_so(count: int) -> None:
    record = grown(frames()[:count])
    result, after = modes_so_far(record, SETTINGS, seed=0)
    assert result.model.outcome is Outcome.TOO_FEW_FRAMES
    assert after is record


def test_a_line_that_more_frames_do_not_bear_out_is_given_up() -> None:
    false = np.vstack([LINES, [[7.3, 0.01]]])
    result, _ = modes_so_far(replace(grown(frames()), known=false), SETTINGS, seed=0)
    np.testing.assert_allclose(result.model.frequencies, LINES[:, 0], atol=0.02)


def test_pooling_takes_noise_off_where_nothing_moves_and_leaves_the_motion() -> None:
    every = frames()
    still = np.linalg.svd(SHAPES)[2][3:]
    moving = np.linalg.svd(SHAPES)[2][:3]
    raw, pooled = np.stack([frame.coefficients for frame in every]), pool(tuple(every))
    assert (pooled @ still.T).std() < 0.5 * (raw @ still.T).std()
    assert np.abs((pooled - raw) @ moving.T).max() < 3 * NOISE


@pytest.mark.parametrize("kind", ["polynomial", "cylinder"])
def test_from_clouds_frame_by_frame_the_modes_are_those_imposed(kind: str) -> None:
    mode = Mode(shape="bending_1", frequency=2.17, damping=0.01, amplitude=0.03)
    if kind == "cylinder":
        clouds, _ = trunk_clouds(Trunk(modes=(mode,), times=np.arange(60) / RATE, points=1500), 0)
    else:
        clouds, _ = leaf_clouds(Scene(modes=(mode,), times=np.arange(60) / RATE, points=1500), 0)
    follower = follow(
        OrganSpec(name="organ", surface=kind, sensors=50, degree=4), clouds[:15], np.random.default_rng(0)
    )
    first = follower.surface.fit(clouds[0].points)
    assert first is not None
    record = GrowingRecord(
        sensors=SensorGrid(organ="organ", positions=follower.surface.positions(first.coefficients)),
        surface=kind,
        basis=follower.surface.displacement_basis(),
        directions=follower.surface.directions,
        frame_rate=RATE,
    )
    for index, cloud in enumerate(clouds):
        fit = follower.measure(cloud, index)
        assert fit is not None
        record = record.with_frame(
            FrameFit(time=cloud.time, coefficients=fit.coefficients, information=fit.information)
        )
    result, _ = modes_so_far(record, SETTINGS, seed=0)
    assert result.model.frequencies[0] == pytest.approx(2.17, abs=0.02)
    assert result.model.damping_ratios[0] == pytest.approx(0.01, abs=0.005)
