"""Mode shapes from the separation (eqs 13-16, read consistently) and their normalisation.

D ≈ q Psi Uᵀ (eq 14), hence Phi = Psi Uᵀ (eq 15) and q = eta Psi⁻¹ (eq 16). As printed, 15 and 16 swap the roles of
Psi and its inverse: 15 then gives MAC 0.888 instead of 0.9998, and 16 has the wrong shape.

A shape is `unit_max`: its largest element is 1 and positive, so that its coordinate is in the unit of D. A complex
shape is rotated to be as real as it can be; how real that is, the MPC says (`metrics.mpc`).
"""

import numpy as np
from jaxtyping import Complex, Float

from nerfmodal.types import Reduction, Sources


def shapes_of_sources(reduction: Reduction, sources: Sources) -> Float[np.ndarray, "dofs modes"]:
    """Shapes as columns, not normalised: Phiᵀ = U Psiᵀ (eq 15)."""
    rank = sources.mixing.shape[1]
    return np.asarray(reduction.components[:, :rank] @ sources.mixing.T)  # eq 15: Phi = Psi U_rᵀ


def unit_max(
    shapes: Float[np.ndarray, "dofs modes"],
) -> tuple[Float[np.ndarray, "dofs modes"], Float[np.ndarray, " modes"]]:
    """Shapes whose largest element is +1, and the factors they were divided by."""
    highest, lowest = shapes.max(axis=0), shapes.min(axis=0)
    factors = np.where(highest >= -lowest, highest, lowest)
    factors = np.where(factors == 0, 1.0, factors)
    return shapes / factors, factors


def rotate_to_real(shapes: Complex[np.ndarray, "dofs modes"]) -> Float[np.ndarray, "dofs modes"]:
    """The real part after the rotation that makes it largest: phase of half the angle of Σ z²."""
    phases = 0.5 * np.angle((shapes**2).sum(axis=0))
    return np.real(shapes * np.exp(-1j * phases))


def coordinates_of(
    displacement: Float[np.ndarray, "frames dofs"], shapes: Float[np.ndarray, "dofs modes"]
) -> Float[np.ndarray, "frames modes"]:
    """Least-squares modal coordinates q of D ≈ q Phi for real shapes (columns); NaN frames stay NaN."""
    return np.asarray(displacement @ np.linalg.pinv(shapes).T)
