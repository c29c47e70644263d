"""Displacement as factors: parts of D without D, exact factors of a measured matrix, coordinates of like shapes."""

import numpy as np
import pytest
from nerfmodal.identify import identify
from nerfmodal.identify.lines import damped_columns
from nerfmodal.identify.opinions import pursue
from nerfmodal.identify.readings import Record
from nerfmodal.identify.reduction import principal_axes
from nerfmodal.identify.separation import pursue_complexity
from nerfmodal.identify.shapes import shapes_of_sources, unit_max
from nerfmodal.spec import IdentificationSpec
from nerfmodal.types import DisplacementMatrix, SensorGrid, Verdict

from tests.fixtures.ambient import displacement_of, factored

RNG = np.random.default_rng(0)
TIMES = np.arange(90) / 30.0


@pytest.mark.parametrize(("frames", "sensors"), [(40, 3), (10, 30)])
def test_factors_of_a_measured_matrix_give_it_back_exactly(frames: int, sensors: int) -> None:
    values = RNG.normal(size=(frames, sensors, 2))
    valid = np.ones(frames, dtype=bool)
    valid[4] = False
    displacement = DisplacementMatrix.of_values(
        values,
        directions=np.eye(3)[:2],
        times=np.arange(frames) / 30.0,
        frame_rate=30.0,
        sensors=SensorGrid(organ="leaf", positions=np.zeros((sensors, 3))),
        valid=valid,
    )
    np.testing.assert_array_equal(displacement.values[valid], values[valid])
    assert np.isnan(displacement.values[4]).all()
    np.testing.assert_array_equal(displacement.of_sensors(1, 3), displacement.values[:, 1:3])
    np.testing.assert_array_equal(displacement.of_frames(2, 7), displacement.values[2:7])


def test_the_result_is_that_of_the_full_matrix() -> None:
    lines = np.array([[2.17, 0.01], [4.83, 0.01]])
    coefficients = damped_columns(TIMES, lines)[:, 1::2] @ RNG.normal(size=(2, 6))
    coefficients += 0.01 * RNG.normal(size=coefficients.shape)
    basis = RNG.normal(size=(200, 6))
    short = identify(factored(coefficients, basis), IdentificationSpec(), seed=0)
    full = identify(displacement_of(coefficients @ basis.T), IdentificationSpec(), seed=0)
    np.testing.assert_allclose(short.model.frequencies, full.model.frequencies, atol=1e-6)
    np.testing.assert_allclose(short.model.mode_shapes, full.model.mode_shapes, atol=1e-5)


def test_the_chain_s_shapes_are_those_of_equation_15() -> None:
    coefficients, basis = RNG.normal(size=(90, 5)).cumsum(axis=0), RNG.normal(size=(50, 5))
    displacement = factored(coefficients, basis)
    axes = principal_axes(coefficients, basis)
    found = pursue(Record(displacement=displacement, axes=axes), 3)
    reduction = axes.reduction(3)
    sources = pursue_complexity(reduction.scores)
    shapes, factors = unit_max(shapes_of_sources(reduction, sources))
    np.testing.assert_allclose(found.shapes, shapes, atol=1e-9)
    np.testing.assert_allclose(found.coordinates, sources.coordinates * factors, atol=1e-9)


def test_more_modes_than_independent_shapes_are_all_accepted() -> None:
    """The third shape is a mixture of the first two: its coordinate is the fitted line, not a difference of theirs."""
    lines = np.array([[2.17, 0.01], [4.83, 0.01], [7.19, 0.012]])
    first, second = RNG.normal(size=(2, 8))
    shapes = np.stack([first, second, 0.6 * first + 0.8 * second])
    truth = damped_columns(TIMES, lines)[:, 1::2] * [0.03, 0.02, 0.01]
    coefficients = truth @ shapes + 5e-4 * RNG.normal(size=(90, 8))
    basis = np.linalg.qr(RNG.normal(size=(60, 8)))[0]
    model = identify(factored(coefficients, basis), IdentificationSpec(), seed=0).model
    np.testing.assert_allclose(model.frequencies, lines[:, 0], atol=0.01)
    assert [quality.verdict for quality in model.quality] == [Verdict.ACCEPTED] * 3
    assert sum(quality.energy_share for quality in model.quality) < 1.5
    for series, true in zip(model.coordinates.T, truth.T, strict=True):
        assert abs(np.corrcoef(series, true)[0, 1]) > 0.99
