"""From clouds to a track: what is refused, what is a gap, and what displacement is measured from (eq 11)."""

import numpy as np
import pytest
from nerfmodal.errors import InvalidClouds
from nerfmodal.spec import OrganSpec
from nerfmodal.surface import Track, measure_organ
from nerfmodal.surface.sensors import Reference, displace
from nerfmodal.types import PointCloud

from tests.fixtures.moving_clouds import Mode, Scene, leaf_clouds

TIMES = np.arange(12) / 30.0
ONE = Scene(modes=(Mode(shape="bending_1", frequency=2.0, amplitude=0.03),), times=TIMES, points=1500)


def track(clouds: list[PointCloud | None], reference: Reference = "mean") -> Track:
    return measure_organ(
        OrganSpec(name="leaf", sensors=100),
        clouds,
        reference=reference,
        times=TIMES[: len(clouds)],
        frame_rate=30.0,
        rng=np.random.default_rng(0),
        report=lambda _done, _total, _message: None,
    )


def cloud_of(points: np.ndarray) -> PointCloud:
    return PointCloud(points=points, colors=np.zeros((len(points), 3)), time=0.0)


def test_the_displacement_is_the_product_of_its_factors() -> None:
    found = track(list(leaf_clouds(ONE, 0)[0]))
    product = found.displacement.coefficients @ found.displacement.basis.T
    np.testing.assert_allclose(found.displacement.values[:, :, 0], product, atol=1e-12)
    np.testing.assert_allclose(found.displacement.values.mean(axis=0), 0.0, atol=1e-12)
    assert found.displacement.directions.shape == (1, 3)


def test_a_frame_of_few_points_is_lost() -> None:
    clouds: list[PointCloud | None] = list(leaf_clouds(ONE, 0)[0])
    assert clouds[3] is not None
    clouds[3] = cloud_of(clouds[3].points[:250])
    clouds[5] = cloud_of(np.zeros((0, 3)))
    found = track(clouds)
    assert np.flatnonzero(~found.displacement.valid).tolist() == [3, 5]
    assert np.isnan(found.displacement.values[[3, 5]]).all()
    assert np.isfinite(found.displacement.values[found.displacement.valid]).all()


def test_eq_11_against_mean_first_and_previous() -> None:
    coefficients = np.random.default_rng(0).normal(size=(5, 2))
    valid = np.array([True, True, False, True, True])
    mean, _ = displace(coefficients, valid, "mean")
    first, _ = displace(coefficients, valid, "first")
    previous, pairs = displace(coefficients, valid, "previous")
    np.testing.assert_allclose(np.nanmean(mean, axis=0), 0.0, atol=1e-12)
    np.testing.assert_allclose(first[4], coefficients[4] - coefficients[0])
    np.testing.assert_allclose(previous[1], coefficients[1] - coefficients[0])
    assert pairs.tolist() == [False, True, False, False, True]


def test_the_reference_does_not_change_the_motion() -> None:
    clouds = list(leaf_clouds(ONE, 0)[0])
    mean, first = track(clouds).displacement.values, track(clouds, "first").displacement.values
    np.testing.assert_allclose(mean - mean[0], first, atol=1e-12)


def test_a_point_that_is_no_number_is_refused_with_its_frame() -> None:
    clouds: list[PointCloud | None] = list(leaf_clouds(ONE, 0)[0])
    assert clouds[4] is not None
    points = clouds[4].points.copy()
    points[17, 1] = np.nan
    clouds[4] = cloud_of(points)
    with pytest.raises(InvalidClouds, match="no number") as caught:
        track(clouds)
    assert caught.value.where == "frame 4"


def test_millimetres_are_suspected_and_said() -> None:
    clouds = [cloud_of(1000 * cloud.points) for cloud in leaf_clouds(ONE, 0)[0]]
    with pytest.raises(InvalidClouds, match="millimetres"):
        track(list(clouds))


def test_points_on_one_line_name_the_organ() -> None:
    along = np.linspace(0, 1, 500)[:, None] * np.array([1.0, 2.0, 0.5])
    with pytest.raises(InvalidClouds, match="line") as caught:
        track([cloud_of(along)] * 4)
    assert caught.value.where == "/organs/leaf"
    assert caught.value.hint


def test_one_frame_has_sensors_and_no_displacement() -> None:
    found = track([leaf_clouds(ONE, 0)[0][0]])
    np.testing.assert_allclose(found.displacement.values, 0.0, atol=1e-12)
    assert found.displacement.sensors.positions.shape == (100, 3)
