"""Principal components of the displacement matrix (eq 12): rows are time, columns are degrees of freedom.

Thin SVD D - mean = V S Uᵀ; components U (dofs, r), scores eta = D U = V S (frames, r). The paper prints D U_rᵀ, whose
shapes do not fit. Where D = C Bᵀ, QR of B and the SVD of C Rᵀ give *exactly* the same at the cost of a (frames,
terms) matrix.
"""

import numpy as np
from jaxtyping import Float

from nerfmodal.types import Reduction

LARGEST_CONDITION = 1e14
"""Of the normal matrix."""


def reduce_matrix(displacement: Float[np.ndarray, "frames dofs"], rank: int | None = None) -> Reduction:
    """Principal components of the full matrix, metres; frames with NaN are left out and have NaN scores.

    Parameters
    ----------
    displacement
        Displacement of every degree of freedom in every frame.
    rank
        Components kept; all by default.
    """
    return _reduce(displacement, None, rank)


def reduce_coefficients(
    coefficients: Float[np.ndarray, "frames terms"], basis: Float[np.ndarray, "dofs terms"], rank: int | None = None
) -> Reduction:
    """Principal components of `coefficients` @ `basis`.T, without ever forming it."""
    orthogonal, triangle = orthonormalise(basis)
    return _reduce(coefficients @ triangle.T, orthogonal, rank)


def orthonormalise(
    basis: Float[np.ndarray, "dofs terms"],
) -> tuple[Float[np.ndarray, "dofs terms"], Float[np.ndarray, "terms terms"]]:
    """Q and R of a tall matrix by two Cholesky factorisations of its normal matrix.

    As accurate as Householder's QR up to a condition number of 1e7 and five times as fast for 100,000 sensors; beyond
    that, and for a basis with a column of zeros, Householder's it is.
    """
    orthogonal, triangle = basis, np.eye(basis.shape[1])
    for _ in range(2):
        normal = orthogonal.T @ orthogonal
        if len(basis) < basis.shape[1] or np.linalg.cond(normal) > LARGEST_CONDITION:
            factors = np.linalg.qr(basis)
            return factors.Q, factors.R
        step = np.linalg.cholesky(normal).T
        orthogonal, triangle = orthogonal @ np.linalg.inv(step), step @ triangle
    return orthogonal, triangle


def _reduce(rows: np.ndarray, orthogonal: np.ndarray | None, rank: int | None) -> Reduction:
    seen = np.isfinite(rows).all(axis=1)
    mean = rows[seen].mean(axis=0)
    left, singular, right = np.linalg.svd(rows[seen] - mean, full_matrices=False)
    kept = len(singular) if rank is None else min(rank, len(singular))
    signs = _signs(left[:, :kept])
    directions = right[:kept].T * signs
    scores = np.full((len(rows), kept), np.nan)
    scores[seen] = left[:, :kept] * (singular[:kept] * signs)  # eq 12: eta = D U_r = V_r S_r
    return Reduction(
        components=directions if orthogonal is None else orthogonal @ directions,
        scores=scores,
        singular_values=singular,
        mean=mean if orthogonal is None else orthogonal @ mean,
    )


def _signs(scores: np.ndarray) -> np.ndarray:
    """The largest score of every component is positive: the SVD leaves the sign open."""
    largest = np.argmax(np.abs(scores), axis=0)
    return np.where(scores[largest, np.arange(scores.shape[1])] < 0, -1.0, 1.0)
