"""The leaf's surface: basis, robust fit, pooled refit, outline and frame, each against a closed form or a slow loop."""

import numpy as np
import pytest
from nerfmodal.errors import InvalidClouds
from nerfmodal.surface.basis import PolynomialBasis
from nerfmodal.surface.outline import place_sensors, trace_outline
from nerfmodal.surface.plane import plane_frame
from nerfmodal.surface.polynomial import choose_sheet
from nerfmodal.surface.pooled import refit_pooled
from nerfmodal.surface.robust import Prior, RobustFit, fit_robustly, tukey_weights
from numpy.polynomial import legendre

BASIS = PolynomialBasis(degree=5, center=np.array([0.4, 0.1]), half=np.array([0.5, 0.2]))


def scattered(count: int, seed: int) -> tuple[np.ndarray, np.random.Generator]:
    rng = np.random.default_rng(seed)
    return BASIS.center + BASIS.half * rng.uniform(-1, 1, size=(count, 2)), rng


def test_poly55_has_21_terms_and_they_are_products_of_legendre_polynomials() -> None:
    xy, _ = scattered(30, 0)
    unit = (xy - BASIS.center) / BASIS.half
    slow = np.stack(
        [
            legendre.legval(unit[:, 0], np.eye(6)[i]) * legendre.legval(unit[:, 1], np.eye(6)[j])
            for i, j in BASIS.powers()
        ],
        axis=1,
    )
    assert BASIS.terms == 21
    assert max(i + j for i, j in BASIS.powers()) == 5
    np.testing.assert_allclose(BASIS.evaluate(xy), slow, atol=1e-12)


def test_a_polynomial_is_recovered_exactly() -> None:
    xy, rng = scattered(500, 1)
    truth = rng.normal(size=21)
    fit = fit_robustly(BASIS.evaluate(xy), BASIS.evaluate(xy) @ truth)
    np.testing.assert_allclose(fit.coefficients, truth, atol=1e-6)


@pytest.mark.parametrize("share", [0.05, 0.15])
def test_outliers_do_not_pull(share: float) -> None:
    xy, rng = scattered(6000, 2)
    truth = 0.05 * rng.normal(size=21)
    design = BASIS.evaluate(xy)
    heights = design @ truth + 0.005 * rng.normal(size=len(xy))
    heights[: int(share * len(xy))] += rng.uniform(0.05, 0.4, size=int(share * len(xy)))
    fit = fit_robustly(design, heights)
    error = np.sqrt(np.mean((design @ (fit.coefficients - truth)) ** 2))
    least_squares = np.linalg.lstsq(design, heights, rcond=None)[0]
    assert error < 0.0006
    assert np.sqrt(np.mean((design @ (least_squares - truth)) ** 2)) > 10 * error


def test_many_points_give_what_all_iterations_on_them_give() -> None:
    xy, rng = scattered(30_000, 3)
    design = BASIS.evaluate(xy)
    heights = design @ (0.05 * rng.normal(size=21)) + 0.005 * rng.normal(size=len(xy))
    fit = fit_robustly(design, heights)
    longer = fit_robustly(design, heights, start=fit.coefficients)
    assert np.abs(design @ (fit.coefficients - longer.coefficients)).max() < 1e-5


def test_tukey_gives_nothing_to_gross_errors_and_one_to_none() -> None:
    np.testing.assert_allclose(tukey_weights(np.array([0.0, 4.685, 10.0])), [1.0, 0.0, 0.0])


def test_a_prior_without_data_is_the_answer() -> None:
    xy = np.tile(BASIS.center, (400, 1))
    mean = np.arange(21.0) / 100
    prior = Prior(mean=mean, precision=1e8 * np.eye(21))
    heights = BASIS.evaluate(xy) @ mean + 0.003 * np.tile([1.0, -1.0], 200)
    fit = fit_robustly(BASIS.evaluate(xy), heights, start=mean, prior=prior)
    np.testing.assert_allclose(fit.coefficients, mean, atol=1e-6)


def test_the_pooled_refit_fills_a_hole_from_the_other_frames() -> None:
    xy, rng = scattered(1500, 4)
    shape = np.zeros(21)
    shape[[1, 3]] = 0.02, 0.01
    motion = np.cos(np.arange(60) * 0.7)
    designs, heights = [], []
    for frame in range(60):
        kept = np.abs(xy[:, 0] - 0.75) > 0.2 if frame % 3 == 0 else np.ones(len(xy), dtype=bool)
        designs.append(BASIS.evaluate(xy[kept]))
        heights.append(designs[-1] @ (shape * motion[frame]) + 0.005 * rng.normal(size=kept.sum()))

    def again(index: int, start: np.ndarray, prior: Prior) -> RobustFit:
        return fit_robustly(designs[index], heights[index], start=start, prior=prior)

    plain = [fit_robustly(design, height) for design, height in zip(designs, heights, strict=True)]
    pooled = refit_pooled(plain, again)
    whole = BASIS.evaluate(xy)

    def error(fits: list[RobustFit] | tuple[RobustFit, ...]) -> float:
        errors = [whole @ (fit.coefficients - shape * q) for fit, q in zip(fits, motion, strict=True)]
        return float(np.sqrt(np.mean(np.square(errors))))

    assert error(pooled) < 0.3 * error(plain)


def test_sensors_stand_inside_the_outline_and_the_first_of_many_are_those_of_few() -> None:
    rng = np.random.default_rng(5)
    angle, radius = rng.uniform(0, 2 * np.pi, 40_000), np.sqrt(rng.uniform(0, 1, 40_000))
    xy = np.column_stack([radius * np.cos(angle), 0.4 * radius * np.sin(angle)])
    outline = trace_outline(np.vstack([xy, rng.uniform([-1.1, -0.5], [1.1, 0.5], size=(600, 2))]))
    sensors = place_sensors(outline, 3000)
    assert np.hypot(sensors[:, 0], sensors[:, 1] / 0.4).max() < 1.02
    assert np.hypot(sensors[:, 0], sensors[:, 1] / 0.4).max() > 0.9
    np.testing.assert_array_equal(place_sensors(outline, 100), sensors[:100])


def test_the_plane_turns_with_the_leaf() -> None:
    rng = np.random.default_rng(6)
    flat = np.column_stack([rng.uniform(-0.5, 0.5, 5000), rng.uniform(-0.2, 0.2, 5000), 0.003 * rng.normal(size=5000)])
    flat[:250] = rng.uniform(-0.6, 0.6, size=(250, 3))
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    turn *= np.sign(np.linalg.det(turn))
    frame = plane_frame(flat @ turn.T + [5.0, -2.0, 1.0])
    assert abs(frame.axes[:, 2] @ turn[:, 2]) > 0.9999
    assert abs(frame.axes[:, 0] @ turn[:, 0]) > 0.999
    assert frame.axes[2, 2] >= 0
    assert np.linalg.det(frame.axes) == pytest.approx(1.0)


def test_points_on_a_line_are_refused() -> None:
    along = np.linspace(0, 1, 1000)
    with pytest.raises(InvalidClouds, match="line"):
        choose_sheet(np.column_stack([along, 2 * along, -along]), degree=5, sensors=10)
