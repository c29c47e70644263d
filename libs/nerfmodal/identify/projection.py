"""Variable projection: frequencies and damping ratios of damped sinusoids common to many whitened channels.

The amplitudes are eliminated by least squares at every step; the Jacobian is Kaufman's. Golub and Pereyra (1973, 2003).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy import linalg

from nerfmodal.identify.lines import all_slopes, damped_columns

MOST_STEPS = 60
SETTLED = 1e-7
"""Relative fall of the cost at which the fit has settled."""
FIRST_DAMPING = 1e-3
LARGEST_DAMPING = 1e8
SINGULAR = 1e-12


@dataclass(frozen=True, slots=True, kw_only=True)
class Bounds:
    """Lowest and highest (frequency Hz, damping ratio) of any line."""

    low: Float[np.ndarray, " 2"]
    high: Float[np.ndarray, " 2"]


def refine(
    times: Float[np.ndarray, " frames"],
    white: Float[np.ndarray, "frames channels"],
    lines: Float[np.ndarray, "modes 2"],
    bounds: Bounds | None,
) -> tuple[Float[np.ndarray, "modes 2"], Float[np.ndarray, "parameters parameters"]]:
    """Lines that leave the least residual, and the normal matrix JᵀJ of (frequencies, damping ratios) there.

    Without `bounds` nothing moves and only the normal matrix is computed.
    """
    cost, normal, gradient = _linearise(times, white, lines)
    if bounds is None:
        return lines, normal
    damping = FIRST_DAMPING
    for _ in range(MOST_STEPS):
        step = np.linalg.solve(normal + damping * np.diag(np.diag(normal) + 1e-300), gradient)
        trial = np.clip(lines + step.reshape(2, -1).T, bounds.low, bounds.high)
        trial_cost, trial_normal, trial_gradient = _linearise(times, white, trial)
        if trial_cost >= cost:
            damping *= 10.0
            if damping > LARGEST_DAMPING:
                break
            continue
        settled = cost - trial_cost <= SETTLED * cost
        lines, cost, normal, gradient = trial, trial_cost, trial_normal, trial_gradient
        damping = max(damping / 10.0, 1e-12)
        if settled:
            break
    return lines, normal


def _linearise(times: np.ndarray, white: np.ndarray, lines: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    """Cost, JᵀJ and the descent direction Jᵀr at `lines`."""
    columns = damped_columns(times, lines)
    orthogonal, triangle = np.linalg.qr(columns)
    projected = orthogonal.T @ white
    residuals = white - orthogonal @ projected
    amplitudes = _solve_triangle(triangle, projected)
    slopes = all_slopes(times, columns, lines)
    slopes = slopes - orthogonal @ (orthogonal.T @ slopes)  # Kaufman: what the columns' slopes add to the columns
    pairs = np.vstack([amplitudes[1:], amplitudes[1:]])
    # column p of the Jacobian is slopes_p @ pair_p, frames x channels: its products need neither frames nor channels
    normal = _sum_pairs((slopes.T @ slopes) * (pairs @ pairs.T))
    gradient = ((slopes.T @ residuals) * pairs).sum(axis=1).reshape(-1, 2).sum(axis=1)
    return float((residuals**2).sum()), normal, gradient


def _solve_triangle(triangle: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Amplitudes; two lines that have become one leave the triangle singular, and share theirs."""
    sizes = np.abs(np.diag(triangle))
    if sizes.min() > SINGULAR * sizes.max():
        return np.asarray(linalg.solve_triangular(triangle, right, check_finite=False))
    return np.asarray(np.linalg.lstsq(triangle, right, rcond=None)[0])


def _sum_pairs(products: np.ndarray) -> np.ndarray:
    """Sums over the blocks of two rows and two columns, cosine and sine of one line."""
    size = len(products) // 2
    return np.asarray(products.reshape(size, 2, size, 2).sum(axis=(1, 3)))
