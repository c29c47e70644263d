"""The sheet's other bases: each by a closed form, and all of them on one leaf behind the one interface."""

import numpy as np
import pytest
from nerfmodal.spec import OrganSpec
from nerfmodal.surface import measure_organ
from nerfmodal.surface.basis import PolynomialBasis, spline_around
from nerfmodal.surface.robust import fit_robustly

from tests.fixtures.moving_clouds import Mode, Scene, leaf_clouds

SQUARE = np.array([[-1.0, -1.0], [1.0, 1.0]])


def test_the_tensor_basis_has_a_term_for_every_pair_of_degrees() -> None:
    basis = PolynomialBasis(degree=5, center=np.zeros(2), half=np.ones(2), tensor=True)
    assert basis.terms == 36
    assert set(basis.powers()) == {(i, j) for i in range(6) for j in range(6)}
    xy = np.random.default_rng(0).uniform(-1, 1, size=(400, 2))
    heights = xy[:, 0] ** 5 * xy[:, 1] ** 4
    fit = fit_robustly(basis.evaluate(xy), heights)
    np.testing.assert_allclose(basis.evaluate(xy) @ fit.coefficients, heights, atol=1e-6)


def test_splines_sum_to_one_and_hold_every_cubic() -> None:
    xy = np.random.default_rng(1).uniform(-1, 1, size=(2000, 2))
    basis = spline_around(SQUARE, 6, xy)
    assert basis.terms == (6 + 3) * (3 + 3)
    np.testing.assert_allclose(basis.evaluate(xy).sum(axis=1), 1.0, atol=1e-12)
    heights = xy[:, 0] ** 3 - 2 * xy[:, 0] * xy[:, 1] ** 2
    design = basis.evaluate(xy)
    np.testing.assert_allclose(design @ np.linalg.lstsq(design, heights, rcond=None)[0], heights, atol=1e-9)


def test_splines_without_points_are_left_out() -> None:
    xy = np.random.default_rng(2).uniform(-1, 1, size=(4000, 2))
    disc = xy[np.hypot(*xy.T) < 0.9]
    basis = spline_around(SQUARE, 8, disc)
    assert 0 < basis.terms < (8 + 3) * (4 + 3)
    np.testing.assert_allclose(basis.evaluate(0.8 * disc).sum(axis=1), 1.0, atol=0.05)


@pytest.mark.parametrize("surface", ["polynomial", "tensor", "spline"])
def test_every_surface_follows_a_leaf(surface: str) -> None:
    times = np.arange(20) / 30
    scene = Scene(modes=(Mode(shape="bending_1", frequency=2.0, amplitude=0.03),), times=times, points=2500)
    clouds, truth = leaf_clouds(scene, 0)
    track = measure_organ(
        OrganSpec.model_validate({"name": "leaf", "surface": surface, "sensors": 200}),
        clouds,
        reference="mean",
        times=times,
        frame_rate=30.0,
        rng=np.random.default_rng(0),
        report=lambda _done, _total, _message: None,
    )
    assert track.surface == surface
    positions = track.displacement.sensors.positions
    along = truth[0].points[:, 0]
    order = np.argsort(along)
    shape = np.interp(positions[:, 0], along[order], truth[0].shape[order, 2])
    moved = np.outer(truth[0].coordinates - truth[0].coordinates.mean(), shape)
    error = track.displacement.values[:, :, 0] - moved
    assert np.sqrt(np.mean(error**2)) < 0.03 * np.sqrt(np.mean(moved**2))
