"""The trunk's surface: the Jacobian against differences, and a known tube from all sides and from one."""

import numpy as np
import pytest
from nerfmodal.surface.cylinder import choose_cylinder, radial_residuals, sections
from scipy import special


def tube(count: int, degrees: float, seed: int, lean: float = 0.0) -> np.ndarray:
    """A bowed, tapered tube along z with five per cent of strays."""
    rng = np.random.default_rng(seed)
    z = rng.uniform(0, 2, count)
    angle = np.radians(rng.uniform(-degrees / 2, degrees / 2, count))
    radius = 0.06 - 0.01 * z + 0.002 * rng.normal(size=count)
    points = np.column_stack([0.03 * z**2 + lean * z**2 + radius * np.cos(angle), radius * np.sin(angle), z])
    points[: count // 20] = rng.uniform([-0.3, -0.3, 0], [0.4, 0.3, 2], size=(count // 20, 3))
    return points


def test_the_jacobian_is_the_derivative() -> None:
    rng = np.random.default_rng(0)
    along = rng.uniform(-1, 1, 40)
    terms = special.eval_chebyt(np.arange(5), along[:, None])
    across, coefficients = rng.normal(size=(40, 2)), 0.1 * rng.normal(size=12)
    _, jacobian = radial_residuals(coefficients, across, terms, along)
    step = 1e-6
    for column in range(12):
        shift = step * np.eye(12)[column]
        above, _ = radial_residuals(coefficients + shift, across, terms, along)
        below, _ = radial_residuals(coefficients - shift, across, terms, along)
        np.testing.assert_allclose(jacobian[:, column], (above - below) / (2 * step), atol=1e-7)


@pytest.mark.parametrize(("degrees", "tolerance"), [(360.0, 0.0008), (180.0, 0.0015), (90.0, 0.006)])
def test_the_displacement_of_a_tube_is_found_from_any_side(degrees: float, tolerance: float) -> None:
    rest = tube(5000, degrees, 1)
    surface = choose_cylinder(rest, degree=5, sensors=50)
    first, second = surface.fit(rest), surface.fit(tube(5000, degrees, 2, lean=0.01))
    assert first is not None
    assert second is not None
    moved = surface.positions(second.coefficients) - surface.positions(first.coefficients)
    z = surface.positions(first.coefficients)[:, 2]
    np.testing.assert_allclose(moved[:, 0], 0.01 * z**2, atol=tolerance)
    np.testing.assert_allclose(moved[:, 1], 0.0, atol=tolerance)


def test_the_displacement_basis_is_the_derivative_of_the_positions() -> None:
    surface = choose_cylinder(tube(4000, 360.0, 3), degree=4, sensors=20)
    change = np.zeros(surface.size)
    change[:10] = np.random.default_rng(4).normal(size=10)
    moved = surface.positions(surface.start + change) - surface.positions(surface.start)
    along_axes = (surface.displacement_basis() @ change[:10]).reshape(20, 2) @ surface.directions
    np.testing.assert_allclose(moved, along_axes, atol=1e-12)


def test_too_few_points_have_no_fit() -> None:
    surface = choose_cylinder(tube(4000, 360.0, 3), degree=4, sensors=20)
    assert surface.fit(tube(10, 360.0, 5)) is None


def test_the_sections_of_a_parabola_have_its_second_derivative_and_the_tube_s_radius() -> None:
    rest = tube(6000, 360.0, 6)
    surface = choose_cylinder(rest, degree=4, sensors=30)
    fit = surface.fit(rest)
    assert fit is not None
    found = sections(surface, fit.coefficients)
    np.testing.assert_allclose(found.positions, surface.positions(fit.coefficients))
    np.testing.assert_allclose(found.radii, 0.06 - 0.01 * found.positions[:, 2], atol=0.001)
    bent = np.linalg.norm(found.bending, axis=1)
    assert np.median(bent) == pytest.approx(0.06, abs=0.01)  # x = 0.03 z²


def test_the_bending_is_the_second_difference_of_the_positions() -> None:
    surface = choose_cylinder(tube(4000, 360.0, 3), degree=4, sensors=201)
    coefficients = surface.start.copy()
    coefficients[:10] += 0.1 * np.random.default_rng(7).normal(size=10)
    found = sections(surface, coefficients)
    local = surface.frame.to_local(found.positions)
    step = local[1, 2] - local[0, 2]
    second = (local[2:, :2] - 2 * local[1:-1, :2] + local[:-2, :2]) / step**2
    np.testing.assert_allclose(found.bending[1:-1], second, atol=1e-3 * np.abs(second).max())
