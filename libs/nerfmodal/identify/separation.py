"""Blind separation of the scores into modal coordinates (eq 13) by complexity pursuit (Stone 2001).

A source is a direction whose long-term variance is large against the variance of its one-step prediction error: a
generalised eigenproblem. Predictor error (1 - z⁻¹)/(1 - λz⁻¹) with a half-life of one sample, started at zero:
started at the first sample, damped records lose the faster modes (MAC 0.92 / 0.69 instead of 1 / 0.999).
"""

import numpy as np
from jaxtyping import Float
from scipy import linalg, signal

from nerfmodal.types import Outcome, Sources

SHORT_HALF_LIFE = 1.0
RIDGE = 1e-12


def pursue_complexity(scores: Float[np.ndarray, "frames rank"]) -> Sources:
    """Modal coordinates q and mixing Psi with scores = q @ Psi (eq 13), the most energetic first.

    `scores` must be evenly sampled without gaps (see `spectra.bridge_gaps`). The order is by energy, not by
    predictability: a sinusoid above a sixth of the frame rate is *less* predictable than white noise.
    """
    frames, rank = scores.shape
    if frames <= rank:
        return Sources(coordinates=scores, mixing=np.eye(rank), outcome=Outcome.TOO_FEW_FRAMES)
    errors = prediction_errors(scores)
    short = errors.T @ errors / frames
    short += RIDGE * np.trace(short) / rank * np.eye(rank)
    _, unmixing = linalg.eigh(scores.T @ scores / frames, short)
    mixing = np.linalg.inv(unmixing)
    coordinates = scores @ unmixing  # eq 16, consistent: q = eta Psi⁻¹
    energy = (coordinates**2).sum(axis=0) * (mixing**2).sum(axis=1)
    order = np.argsort(-energy, kind="stable")
    return Sources(coordinates=coordinates[:, order], mixing=mixing[order])


def prediction_errors(
    scores: Float[np.ndarray, "frames rank"], half_life: float = SHORT_HALF_LIFE
) -> Float[np.ndarray, "frames rank"]:
    """Errors of the exponentially weighted prediction x̃(t) = λ x̃(t-1) + (1-λ) x(t-1), with x̃(0) = 0."""
    decay = 2.0 ** (-1.0 / half_life)
    return np.asarray(signal.lfilter([1.0, -1.0], [1.0, -decay], scores, axis=0))
