"""Pooled (empirical-Bayes) refit: all frames of an organ say what a frame's coefficients can be.

Coefficients c_k ~ N(mean, V) over the frames; a frame measures c_k with information A_k. The posterior leans on the
prior only where the frame saw little (a hole, a gap between leaflets) and where nothing moves (high degrees), so it
halves the error.
"""

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float

from nerfmodal.surface.robust import Prior, RobustFit

BETTER = 0.85
"""Share of the frames, the best determined ones, that the prior is learnt from."""
ROUNDS = 2
FLOOR = 1e-6
"""Of the largest prior variance: no direction is ever held rigid."""
FEWEST_FRAMES = 8


def refit_pooled(fits: Sequence[RobustFit], refit: Callable[[int, Prior], RobustFit]) -> tuple[RobustFit, ...]:
    """Fits of all valid frames, each given what the others say.

    Parameters
    ----------
    fits
        The frames' own fits.
    refit
        Fits frame k (its place in `fits`) again under a prior.
    """
    if len(fits) < FEWEST_FRAMES:
        return tuple(fits)
    current = tuple(fits)
    for round_index in range(ROUNDS):
        prior = learn_prior(current, posterior=round_index > 0)
        current = tuple(refit(index, prior) for index in range(len(current)))
    return current


def learn_prior(fits: Sequence[RobustFit], *, posterior: bool = False) -> Prior:
    """Mean and covariance over the better frames of what the coefficients truly are.

    The scatter of plain fits holds their errors too, which are taken off; the scatter of posterior means lacks the
    posterior covariance, which the last step leaves to the data (two rounds do not drift).
    """
    spread = np.array([np.trace(_covariance(fit)) for fit in fits])
    better = np.argsort(spread, kind="stable")[: max(FEWEST_FRAMES, round(BETTER * len(fits)))]
    coefficients = np.stack([fits[index].coefficients for index in better])
    mean = coefficients.mean(axis=0)
    scatter = np.cov(coefficients, rowvar=False)
    if not posterior:
        scatter = scatter - np.mean([_covariance(fits[index]) for index in better], axis=0)
    return Prior(mean=mean, precision=_inverse_of_positive(scatter))


def _covariance(fit: RobustFit) -> Float[np.ndarray, "terms terms"]:
    size = len(fit.information)
    ridge = 1e-9 * np.trace(fit.information) / size
    return np.asarray(np.linalg.inv(fit.information + ridge * np.eye(size)))


def _inverse_of_positive(matrix: np.ndarray) -> np.ndarray:
    values, vectors = np.linalg.eigh((matrix + matrix.T) / 2)
    values = np.maximum(values, FLOOR * max(values[-1], 1e-18))
    return np.asarray((vectors / values) @ vectors.T)
