"""Equations 12 to 18 as identities and on mixtures of known content."""

import numpy as np
import pytest
from nerfmodal.errors import InvalidInput
from nerfmodal.identify.metrics import mac
from nerfmodal.identify.reduction import orthonormalise, reduce_coefficients, reduce_matrix
from nerfmodal.identify.separation import prediction_errors, pursue_complexity
from nerfmodal.identify.shapes import coordinates_of, rotate_to_real, shapes_of_sources, unit_max
from nerfmodal.magnify import magnify, magnify_scores
from nerfmodal.types import ModalModel, ModeQuality, Outcome, Reduction, Sources, Verdict

FRAMES, DOFS, RATE = 90, 200, 30.0
TIMES = np.arange(FRAMES) / RATE


def known_mixture(damping: float = 0.01) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """D = q Phi of three decaying modes with shapes that are not orthogonal."""
    x = np.linspace(0, 1, DOFS)
    shapes = np.stack([x**2, x**2 - 1.2 * x**3, np.sin(9 * x) * x])
    q = np.stack(
        [
            size * np.exp(-damping * 2 * np.pi * f * TIMES) * np.cos(2 * np.pi * f * TIMES + phase)
            for f, size, phase in ((2.17, 0.03, 0.3), (4.83, 0.015, 1.1), (9.61, 0.01, 2.0))
        ],
        axis=1,
    )
    return q @ shapes, q, shapes


def separated() -> tuple[np.ndarray, Reduction, Sources]:
    displacement, _, _ = known_mixture()
    reduction = reduce_matrix(displacement, 3)
    return displacement, reduction, pursue_complexity(reduction.scores)


def test_eq_12_scores_are_the_projection_on_orthonormal_components() -> None:
    displacement, reduction, _ = separated()
    centered = displacement - displacement.mean(axis=0)
    np.testing.assert_allclose(reduction.scores, centered @ reduction.components, atol=1e-12)
    np.testing.assert_allclose(reduction.components.T @ reduction.components, np.eye(3), atol=1e-12)


def test_the_factors_give_exactly_the_components_of_the_full_matrix() -> None:
    rng = np.random.default_rng(1)
    coefficients, basis = rng.normal(size=(40, 6)), rng.normal(size=(300, 6))
    full, fast = reduce_matrix(coefficients @ basis.T, 6), reduce_coefficients(coefficients, basis)
    np.testing.assert_allclose(fast.singular_values, full.singular_values[:6], rtol=1e-9)
    np.testing.assert_allclose(fast.components, full.components, atol=1e-9)
    np.testing.assert_allclose(fast.scores, full.scores, atol=1e-9)
    np.testing.assert_allclose(fast.mean, full.mean, atol=1e-9)


@pytest.mark.parametrize("ratio", [1.0, 1e-6, 1e-12, 0.0])
def test_the_basis_is_factored_exactly_however_ill_conditioned(ratio: float) -> None:
    basis = np.random.default_rng(4).normal(size=(400, 5)) * np.array([1.0, 1.0, 1.0, 1.0, ratio])
    orthogonal, triangle = orthonormalise(basis)
    np.testing.assert_allclose(orthogonal @ triangle, basis, atol=1e-12)
    np.testing.assert_allclose(orthogonal.T @ orthogonal, np.eye(5), atol=1e-12)


def test_lost_frames_have_no_scores_and_do_not_touch_the_others() -> None:
    displacement, _, _ = known_mixture()
    gap = displacement.copy()
    gap[7] = np.nan
    reduction = reduce_matrix(gap, 3)
    assert np.isnan(reduction.scores[7]).all()
    np.testing.assert_allclose(
        np.delete(reduction.scores, 7, axis=0), reduce_matrix(np.delete(gap, 7, axis=0), 3).scores, atol=1e-12
    )


def test_eqs_13_to_16_are_identities() -> None:
    displacement, reduction, sources = separated()
    np.testing.assert_allclose(sources.coordinates @ sources.mixing, reduction.scores, atol=1e-12)  # 13
    phi = shapes_of_sources(reduction, sources).T
    np.testing.assert_allclose(sources.coordinates @ phi, reduction.scores @ reduction.components.T, atol=1e-12)  # 14
    unmixed = reduction.scores @ np.linalg.inv(sources.mixing)
    np.testing.assert_allclose(unmixed, sources.coordinates, atol=1e-12)  # 16
    np.testing.assert_allclose(
        reduction.scores @ reduction.components.T, displacement - displacement.mean(axis=0), atol=1e-9
    )


@pytest.mark.parametrize(("damping", "least"), [(0.01, (0.999, 0.995, 0.99)), (0.05, (0.999, 0.98, 0.89))])
def test_complexity_pursuit_separates_a_known_mixture(damping: float, least: tuple[float, ...]) -> None:
    displacement, _, shapes = known_mixture(damping)
    reduction = reduce_matrix(displacement, 3)
    found = shapes_of_sources(reduction, pursue_complexity(reduction.scores)).T
    best = [max(mac(shape, true) for shape in found) for true in shapes]
    assert all(value >= limit for value, limit in zip(best, least, strict=True))


def test_eq_15_as_printed_is_worse() -> None:
    _, reduction, sources = separated()
    _, _, shapes = known_mixture()
    printed = reduction.components @ np.linalg.inv(sources.mixing)
    consistent = shapes_of_sources(reduction, sources)
    worst_printed = min(max(mac(column, true) for column in printed.T) for true in shapes)
    worst_consistent = min(max(mac(column, true) for column in consistent.T) for true in shapes)
    assert worst_printed < worst_consistent


def test_predictions_start_at_zero_and_follow_the_recursion() -> None:
    series = np.random.default_rng(2).normal(size=(20, 1))
    predicted, slow = 0.0, []
    for value in series[:, 0]:
        slow.append(value - predicted)
        predicted = 0.5 * predicted + 0.5 * value
    np.testing.assert_allclose(prediction_errors(series)[:, 0], slow, atol=1e-12)


def test_sources_come_by_energy() -> None:
    _, _, sources = separated()
    energy = (sources.coordinates**2).sum(axis=0) * (sources.mixing**2).sum(axis=1)
    assert (np.diff(energy) <= 0).all()


def test_unit_max_has_its_largest_element_at_plus_one() -> None:
    shapes, factors = unit_max(np.array([[1.0, 2.0], [-4.0, 1.0]]))
    np.testing.assert_allclose(shapes, [[-0.25, 1.0], [1.0, 0.5]])
    np.testing.assert_allclose(factors, [-4.0, 2.0])


def test_a_turned_real_shape_is_turned_back() -> None:
    real = np.random.default_rng(3).normal(size=(30, 1))
    turned = rotate_to_real(real * np.exp(1.3j))
    assert mac(turned[:, 0], real[:, 0]) == pytest.approx(1.0)
    assert np.linalg.norm(turned) == pytest.approx(np.linalg.norm(real))


def test_coordinates_are_those_that_made_the_displacement() -> None:
    displacement, q, shapes = known_mixture()
    np.testing.assert_allclose(coordinates_of(displacement, shapes.T), q, atol=1e-10)


def model() -> tuple[ModalModel, np.ndarray]:
    displacement, q, shapes = known_mixture()
    quality = ModeQuality(energy_share=0.3, mpc=1.0, mac_between_methods=None, verdict=Verdict.ACCEPTED)
    return (
        ModalModel(
            frequencies=np.array([2.17, 4.83, 9.61]),
            frequency_stds=np.zeros(3),
            damping_ratios=np.full(3, 0.01),
            damping_stds=np.zeros(3),
            mode_shapes=shapes.T[:, None, :],
            coordinates=q,
            quality=(quality,) * 3,
            outcome=Outcome.OK,
        ),
        displacement,
    )


def test_eq_18_with_equal_factors_gives_the_displacement_back() -> None:
    modes, displacement = model()
    np.testing.assert_allclose(magnify(modes, 1, alpha=1.0, beta=1.0)[:, :, 0], displacement, atol=1e-12)


def test_eq_18_scales_one_mode_and_removes_the_others() -> None:
    modes, _ = model()
    expected = 20.0 * np.outer(modes.coordinates[:, 1], modes.mode_shapes[:, 0, 1])
    np.testing.assert_allclose(magnify(modes, 1, alpha=20.0)[:, :, 0], expected, atol=1e-12)


def test_eq_17_and_18_agree_through_the_components() -> None:
    _, reduction, sources = separated()
    scores = magnify_scores(sources.coordinates, sources.mixing, 0, alpha=3.0, beta=0.5)
    phi = shapes_of_sources(reduction, sources).T
    factors = np.array([3.0, 0.5, 0.5])
    np.testing.assert_allclose(scores @ reduction.components.T, (sources.coordinates * factors) @ phi, atol=1e-12)


def test_a_mode_that_is_not_there_is_refused() -> None:
    with pytest.raises(InvalidInput, match="no mode 3"):
        magnify(model()[0], 3, alpha=1.0)
