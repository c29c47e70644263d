"""Motion magnification: one mode made large and the others small, for the eye (eqs 17-18, read consistently).

    eta_i = alpha q_i psi_i + beta Σ_{j≠i} q_j psi_j                     (17)
    D_i   = eta_i U_rᵀ = q diag(beta … alpha … beta) Phi                  (18)

The printed eq 18, eta_i Phi, would apply Psi twice. alpha = beta = 1 gives back what the modes hold of D.
"""

import numpy as np
from jaxtyping import Float

from nerfmodal.errors import InvalidInput
from nerfmodal.types import ModalModel, OrganResult


def magnify(
    model: ModalModel, mode: int, *, alpha: float, beta: float = 0.0
) -> Float[np.ndarray, "frames sensors axes"]:
    """Displacement in metres of every sensor with mode `mode` (0-based) times `alpha` and the others times `beta`.

    Raises `InvalidInput` if there is no such mode.
    """
    modes = len(model.frequencies)
    if not 0 <= mode < modes:
        raise InvalidInput(f"there is no mode {mode}; the model has {modes}.", hint="Modes are counted from 0.")
    factors = np.full(modes, beta)
    factors[mode] = alpha
    return np.asarray(np.einsum("fm,sam->fsa", model.coordinates * factors, model.mode_shapes))  # eq 18


def magnify_scores(
    coordinates: Float[np.ndarray, "frames modes"],
    mixing: Float[np.ndarray, "modes rank"],
    mode: int,
    *,
    alpha: float,
    beta: float = 0.0,
) -> Float[np.ndarray, "frames rank"]:
    """The scores eta_i (eq 17); with the components U_r, eta_i @ U_rᵀ is the magnified displacement."""
    factors = np.full(len(mixing), beta)
    factors[mode] = alpha
    return np.asarray((coordinates * factors) @ mixing)  # eq 17


def magnified_positions(
    organ: OrganResult, mode: int, *, alpha: float, beta: float = 0.0
) -> Float[np.ndarray, "frames sensors 3"]:
    """Where the organ's sensors are in the magnified film: the mean surface plus eq 18, world metres."""
    moved = magnify(organ.model, mode, alpha=alpha, beta=beta)
    return np.asarray(organ.displacement.sensors.positions + moved @ organ.displacement.directions)
