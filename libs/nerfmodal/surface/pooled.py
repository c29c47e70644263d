"""Pooled (empirical-Bayes) refit: all frames of an organ say what a frame's coefficients can be.

Coefficients c_k ~ N(mean, V) over the frames; a frame measures c_k with information A_k. The posterior leans on the
prior only where the frame saw little (a hole, a gap between leaflets) and where nothing moves (high degrees), so it
halves the error. A frame that fell for a blob of stray points is recognised by its distance from the others and
starts again.
"""

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float
from scipy import stats

from nerfmodal.surface.robust import Prior, RobustFit

BETTER = 0.85
"""Share of the frames, those nearest to one another, that the prior is learnt from."""
CONCENTRATIONS = 5
ROUNDS = 2
FLOOR = 0.2
"""Of a plain fit's variance: no direction is held more rigid than this. Pressed flat, a direction would hold nothing
but a leak of the motion that changes with the number of points in a frame, and lines would be read in it."""
FEWEST_FRAMES = 8
STRETCH = 90
"""Frames that a prior is learnt from, at least."""
STRANGE = 1e-6
"""A frame as far from the others as one in a million is misled: it starts from the prior's mean instead."""


def refit_pooled(
    fits: Sequence[RobustFit], refit: Callable[[int, Float[np.ndarray, " terms"], Prior], RobustFit]
) -> tuple[RobustFit, ...]:
    """Fits of all valid frames, each given what the others say.

    Parameters
    ----------
    fits
        The frames' own fits.
    refit
        Fits frame k (its place in `fits`) again from a start and under a prior.
    """
    current = tuple(fits)
    if len(fits) < FEWEST_FRAMES:
        return current
    for round_index in range(ROUNDS):
        prior = learn_prior(liveliest(current), posterior=round_index > 0)
        strange = distances(current, prior) > stats.chi2.isf(STRANGE, len(prior.mean))
        current = tuple(
            refit(index, prior.mean if strange[index] else fit.coefficients, prior) for index, fit in enumerate(current)
        )
    return current


def liveliest(fits: Sequence[RobustFit]) -> Sequence[RobustFit]:
    """The stretch of a long record that moves most; a short record is one stretch.

    Over a long decay the typical motion is small, and a prior of all frames would press flat what the first ones show.
    """
    stretches = np.array_split(np.arange(len(fits)), max(1, len(fits) // STRETCH))
    motion = [np.trace(np.cov([fits[k].coefficients for k in places], rowvar=False)) for places in stretches]
    return [fits[k] for k in stretches[int(np.argmax(motion))]]


def learn_prior(fits: Sequence[RobustFit], *, posterior: bool = False) -> Prior:
    """Mean and covariance over the better frames of what the coefficients truly are.

    The better frames are found by concentration steps (as in the minimum covariance determinant). The scatter of
    plain fits holds their errors too, which are taken off; the scatter of posterior means lacks the posterior
    covariance, which the last round leaves to the data (two rounds do not drift).
    """
    coefficients = np.stack([fit.coefficients for fit in fits])
    errors = np.stack([_covariance(fit) for fit in fits])
    better = np.arange(len(fits))
    kept = max(FEWEST_FRAMES, round(BETTER * len(fits)))
    for _ in range(CONCENTRATIONS):
        prior = _prior_of(coefficients[better], errors[better], posterior=posterior)
        better = np.sort(np.argsort(distances(fits, prior), kind="stable")[:kept])
    return _prior_of(coefficients[better], errors[better], posterior=posterior)


def distances(fits: Sequence[RobustFit], prior: Prior) -> Float[np.ndarray, " frames"]:
    """Squared Mahalanobis distance of every frame from the prior, its own error included."""
    scatter = np.linalg.inv(prior.precision)
    steps = [(fit.coefficients - prior.mean, scatter + _covariance(fit)) for fit in fits]
    return np.array([step @ np.linalg.solve(spread, step) for step, spread in steps])


def _prior_of(coefficients: np.ndarray, errors: np.ndarray, *, posterior: bool) -> Prior:
    typical = errors.mean(axis=0)
    scatter = np.cov(coefficients, rowvar=False)
    if not posterior:
        scatter = scatter - typical
    return Prior(mean=coefficients.mean(axis=0), precision=_precision_above(scatter, FLOOR * typical))


def _covariance(fit: RobustFit) -> Float[np.ndarray, "terms terms"]:
    size = len(fit.information)
    ridge = 1e-9 * np.trace(fit.information) / size
    return np.asarray(np.linalg.inv(fit.information + ridge * np.eye(size)))


def _precision_above(scatter: np.ndarray, floor: np.ndarray) -> np.ndarray:
    """Inverse of the covariance `scatter`, in no direction below `floor`."""
    unwhiten = np.linalg.cholesky((floor + floor.T) / 2 + 1e-300 * np.eye(len(floor)))
    white = np.linalg.solve(unwhiten, np.linalg.solve(unwhiten, scatter).T)
    values, vectors = np.linalg.eigh((white + white.T) / 2)
    inverse = np.linalg.solve(unwhiten.T, vectors)
    return np.asarray((inverse / np.maximum(values, 1.0)) @ inverse.T)
