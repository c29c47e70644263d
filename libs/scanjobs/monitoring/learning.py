"""What is normal for a plant, learned scan by scan: recursive residuals that are exactly standard normal.

A regression of y (a logarithm of f/f0) on what was measured beside it is fitted to the scans learned so far; the next
scan is compared with its prediction. Recursive residuals (Brown, Durbin & Evans 1975, eq 2) divided by the standard
deviation learned so far have Student's t distribution, and Φ⁻¹(F_t(·)) of them are independent standard normals for
every value of the unknown mean, slopes and variance: the self-starting charts of Hawkins (1987). The uncertainty of a
short reference is therefore part of every score, and no threshold has to be inflated for it.
"""

from typing import Final

import numpy as np
from scipy.special import ndtri, ndtri_exp, stdtr

SPARE: Final = 3
"""Scans beyond the number of coefficients before a score is given: with fewer its t distribution is too wide to use."""
FARTHEST: Final = 8.0
"""Scores are not told apart beyond this many standard deviations."""


class Normal:
    """A regression that learns; `score` says how far a scan is from it."""

    def __init__(self, coefficients: int) -> None:
        self._square = np.zeros((coefficients, coefficients))
        self._moment = np.zeros(coefficients)
        self._energy = 0.0
        self._inverse: np.ndarray | None = None
        self.learned = 0

    @property
    def freedom(self) -> int:
        """Degrees of freedom of the residual variance."""
        return self.learned - len(self._moment)

    @property
    def is_ready(self) -> bool:
        """Whether a score can be given."""
        return self.freedom >= SPARE

    def learn(self, row: np.ndarray, value: float, weight: float = 1.0) -> None:
        """One scan that is normal: regressors (coefficients,), y, and 1 / relative variance."""
        self._square += weight * np.outer(row, row)
        self._moment += weight * row * value
        self._energy += weight * value**2
        self._inverse = None
        self.learned += 1

    @property
    def inverse(self) -> np.ndarray:
        """(XᵀWX)⁺, computed once for each scan that is learned."""
        if self._inverse is None:
            self._inverse = np.linalg.pinv(self._square, hermitian=True)
        return self._inverse

    @property
    def coefficients(self) -> np.ndarray:
        """Least-squares coefficients; what was never varied has none (minimum norm)."""
        return self.inverse @ self._moment

    @property
    def deviation(self) -> float:
        """Residual standard deviation; NaN before it is known."""
        if self.freedom <= 0:
            return float("nan")
        return float(np.sqrt(max(self._energy - self._moment @ self.coefficients, 0.0) / self.freedom))

    @property
    def coefficient_stds(self) -> np.ndarray:
        """Standard deviations of the coefficients."""
        return self.deviation * np.sqrt(np.diag(self.inverse).clip(0.0))

    def residual(self, row: np.ndarray, value: float, weight: float = 1.0) -> tuple[float, float]:
        """y minus its prediction, and the standard deviation of that: of the scan and of what was learned."""
        error = value - float(row @ self.inverse @ self._moment)
        spread = 1.0 / weight + float(row @ self.inverse @ row)  # Brown, Durbin & Evans 1975, eq 2, with weights
        return error, self.deviation * float(np.sqrt(spread))

    def score(self, row: np.ndarray, value: float, weight: float = 1.0) -> float:
        """The scan as a standard normal; NaN before the regression is ready."""
        if not self.is_ready:
            return float("nan")
        error, deviation = self.residual(row, value, weight)
        if deviation <= 0.0:
            return float(np.sign(error)) * FARTHEST if error else 0.0
        return normal_score(error / deviation, self.freedom)


def normal_score(t: float, freedom: int) -> float:
    """The standard normal with the same probability as Student's t; computed in the tail that is the smaller."""
    tail = float(stdtr(freedom, -abs(t)))
    if tail <= 0.0:
        return float(np.copysign(FARTHEST, t))
    score = -float(ndtri(tail)) if tail > 1e-300 else -float(ndtri_exp(np.log(tail)))
    return float(np.copysign(min(score, FARTHEST), t))
