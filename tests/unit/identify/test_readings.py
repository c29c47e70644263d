"""Readings in principal components, and who agrees with whom."""

import numpy as np
import pytest
from nerfmodal.identify.metrics import mac_matrix
from nerfmodal.identify.readings import Reading, agreement, consensus, normalised
from nerfmodal.identify.reduction import principal_axes, reduce_matrix

RNG = np.random.default_rng(0)
BASIS = RNG.normal(size=(300, 6))
AXES = principal_axes(RNG.normal(size=(40, 6)), BASIS)


def reading(method: str, frequencies: list[float], local: np.ndarray) -> Reading:
    own, shapes, _ = normalised(AXES, local)
    return Reading(
        method=method,
        frequencies=np.array(frequencies),
        damping_ratios=np.zeros(len(frequencies)),
        local=own,
        shapes=shapes,
        coordinates=np.zeros((40, len(frequencies))),
    )


def test_the_axes_are_those_of_the_full_matrix_and_their_lift_keeps_macs() -> None:
    coefficients = RNG.normal(size=(40, 6))
    axes, full = principal_axes(coefficients, BASIS), reduce_matrix(coefficients @ BASIS.T, 6)
    np.testing.assert_allclose(axes.reduction(6).components, full.components, atol=1e-9)
    np.testing.assert_allclose(axes.scores, full.scores, atol=1e-9)
    local = RNG.normal(size=(6, 3))
    np.testing.assert_allclose(mac_matrix(axes.lift(local), axes.lift(local)), mac_matrix(local, local), atol=1e-12)


def test_shapes_have_a_largest_element_of_one() -> None:
    own, shapes, factors = normalised(AXES, RNG.normal(size=(4, 3)))
    np.testing.assert_allclose(shapes.max(axis=0), 1.0)
    np.testing.assert_allclose(np.abs(shapes).max(axis=0), 1.0)
    np.testing.assert_allclose(AXES.lift(own * factors), shapes * factors, atol=1e-12)


def test_methods_agree_where_frequency_and_shape_do() -> None:
    local = np.eye(6)[:, :3]
    main = reading("a", [2.0, 5.0, 9.0], local)
    near = reading("b", [2.02, 5.01, 9.9], local[:4])  # the third is too far off
    turned = reading("c", [2.0, 5.0, 9.0], local[:, [0, 2, 1]])  # two shapes are those of other modes
    assert agreement(main, near, 3.0)[2] is None
    assert agreement(main, near, 3.0)[0] == pytest.approx(1.0)
    said = consensus(main, (near, turned), 3.0)
    assert [each.methods for each in said] == [("b", "c"), ("b",), ()]
    assert said[2].mac is None


def test_nothing_agrees_with_a_method_that_found_nothing() -> None:
    main = reading("a", [2.0], np.eye(6)[:, :1])
    assert agreement(main, reading("b", [], np.zeros((6, 0))), 3.0) == [None]
