"""The bounds against the closed form of an undamped line and against a slow Fisher matrix by differences."""

import numpy as np
import pytest
from nerfmodal.bounds import PHASES, ambient_deviations, cramer_rao

TIMES = np.arange(90) / 30.0


def test_a_long_undamped_line_has_the_textbook_bound():
    """sd f = sqrt(6) σ / (π A T sqrt(N)) (Rife and Boorstyn 1974, amplitude and phase unknown)."""
    times = np.arange(3000) / 30.0
    frequency_sd, _ = cramer_rao(times, 5.0, 0.0, 10.0)
    assert frequency_sd == pytest.approx(np.sqrt(6) / (np.pi * 10 * 100.0 * np.sqrt(3000)), rel=2e-3)


def slow_bound(frequency: float, damping: float) -> np.ndarray:
    """Inverse of the full Fisher matrix over five unknowns, derivatives by differences; phases averaged."""

    def signal(values: np.ndarray) -> np.ndarray:
        f, zeta, cosine, sine, constant = values
        omega = 2 * np.pi * f
        angle = omega * np.sqrt(1 - zeta**2) * TIMES
        return constant + np.exp(-zeta * omega * TIMES) * (cosine * np.cos(angle) + sine * np.sin(angle))

    schur = np.zeros((2, 2))
    for phase in np.pi * np.arange(PHASES) / PHASES:
        at = np.array([frequency, damping, np.cos(phase), -np.sin(phase), 0.0])
        slopes = np.stack([(signal(at + h) - signal(at - h)) / 2e-6 for h in 1e-6 * np.eye(5)], axis=1)
        fisher = slopes.T @ slopes
        schur += (fisher[:2, :2] - fisher[:2, 2:] @ np.linalg.solve(fisher[2:, 2:], fisher[2:, :2])) / PHASES
    return np.sqrt(np.diag(np.linalg.inv(schur)))


@pytest.mark.parametrize(("frequency", "damping"), [(1.07, 0.01), (4.83, 0.05), (9.61, 0.3), (2.0, 0.0)])
def test_the_bound_is_the_inverse_of_the_fisher_matrix(frequency: float, damping: float):
    assert cramer_rao(TIMES, frequency, damping, 1.0) == pytest.approx(slow_bound(frequency, damping), rel=1e-4)


def test_noise_scales_the_bound_and_wind_needs_time():
    assert cramer_rao(TIMES, 5.0, 0.01, 20.0)[0] == pytest.approx(cramer_rao(TIMES, 5.0, 0.01, 10.0)[0] / 2)
    minute, four = ambient_deviations(2.17, 0.02, 60.0), ambient_deviations(2.17, 0.02, 240.0)
    assert minute == pytest.approx((2 * four[0], 2 * four[1]))
