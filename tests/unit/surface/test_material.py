"""Points that are material: three components at the sensors, lost frames are gaps, and no surface is fitted anew."""

from dataclasses import replace

import numpy as np
import pytest
from jaxtyping import Float
from nerfmodal import surface
from nerfmodal.spec import OrganSpec
from nerfmodal.surface import Track
from nerfmodal.types import PointCloud

FRAMES, RATE = 24, 12.0
DIRECTION = np.array([0.6, 0.0, 0.8])


def shape(points: Float[np.ndarray, "points 3"]) -> Float[np.ndarray, "points 3"]:
    """Bending of a cantilever's kind along x, with a twist, in a direction that is not the normal."""
    share = points[:, 0] / 0.8
    return (share**2 * (3 - share) / 2 + 2 * points[:, 1] * share)[:, None] * DIRECTION


@pytest.fixture
def clouds() -> list[PointCloud]:
    rng = np.random.default_rng(1)
    rest = np.column_stack([rng.uniform(0, 0.8, 900), rng.uniform(-0.1, 0.1, 900), np.zeros(900)])
    rest[:, 2] = 0.1 * rest[:, 0] ** 2
    times = np.arange(FRAMES) / RATE
    return [
        PointCloud(
            points=rest + 0.03 * np.sin(2 * np.pi * 1.5 * time) * shape(rest),
            colors=np.full((900, 3), 0.5),
            time=float(time),
            stds=np.full(900, 1e-3),
        )
        for time in times
    ]


def track(clouds: list[PointCloud]) -> Track:
    return surface.measure_organ(
        OrganSpec(name="leaf", surface="polynomial", degree=3, sensors=200),
        clouds,
        reference="first",
        times=np.array([cloud.time for cloud in clouds]),
        frame_rate=RATE,
        rng=np.random.default_rng(0),
        report=lambda _done, _of, _message: None,
    )


def test_the_sensors_move_as_the_points_along_three_axes(clouds: list[PointCloud]) -> None:
    found = track(clouds).displacement
    np.testing.assert_array_equal(found.directions, np.eye(3))
    expected = 0.03 * np.sin(2 * np.pi * 1.5 * found.times)[:, None, None] * shape(found.sensors.positions)
    np.testing.assert_allclose(found.values, expected, atol=2e-4)


def test_a_frame_in_which_the_organ_was_lost_is_a_gap(clouds: list[PointCloud]) -> None:
    clouds[5] = replace(clouds[5], stds=np.full(900, np.inf))
    found = track(clouds).displacement
    assert not found.valid[5]
    assert found.valid.sum() == FRAMES - 1
    assert np.isnan(found.values[5]).all()


def test_clouds_without_precision_are_not_material(clouds: list[PointCloud]) -> None:
    assert surface.is_material(clouds)
    assert not surface.is_material([replace(clouds[0], stds=None), *clouds[1:]])
    assert not surface.is_material([clouds[0].part(np.arange(900) < 500), *clouds[1:]])
