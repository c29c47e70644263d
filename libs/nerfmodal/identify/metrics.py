"""Metrics of modal analysis: how alike two shapes are, how real one is, and how far two sets of modes are apart.

Conventions: shapes are vectors over degrees of freedom; frequencies in Hz, damping ratios in 0-1; errors are found
minus true. Sources: Allemang (2003) for MAC and MSF; Pappa, Elliott and Schenk (1993) for MPC; Heylen, Lammens and
Sas (1997) for MPD.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Complex, Float

from nerfmodal.errors import InvalidInput

Shape = Float[np.ndarray, " _"] | Complex[np.ndarray, " _"]


def mac(first: Shape, second: Shape) -> float:
    """Modal assurance criterion |aᴴb|² / (aᴴa · bᴴb): 1 for the same shape up to a factor, 0 for orthogonal ones."""
    _validate(first, second)
    scale = np.vdot(first, first).real * np.vdot(second, second).real
    return float(np.abs(np.vdot(first, second)) ** 2 / scale) if scale > 0 else 0.0


def mac_matrix(
    first: Float[np.ndarray, "dofs rows"] | Complex[np.ndarray, "dofs rows"],
    second: Float[np.ndarray, "dofs columns"] | Complex[np.ndarray, "dofs columns"],
) -> Float[np.ndarray, "rows columns"]:
    """MAC of every column of `first` with every column of `second`."""
    products = np.abs(first.conj().T @ second) ** 2
    scale = np.outer((np.abs(first) ** 2).sum(axis=0), (np.abs(second) ** 2).sum(axis=0))
    return np.divide(products, scale, out=np.zeros_like(scale), where=scale > 0)


def msf(first: Shape, second: Shape) -> complex:
    """Modal scale factor: the number that `second` is multiplied with to come closest to `first`.

    Raises `InvalidInput` if `second` is zero everywhere: no multiple of it comes closer than another.
    """
    _validate(first, second)
    _refuse_zero(second)
    return complex(np.vdot(second, first) / np.vdot(second, second))


def mpc(shape: Shape) -> float:
    """Modal phase collinearity: 1 if all degrees of freedom move in phase or opposition, 0 if their phase is arbitrary.

    (λ₁ - λ₂)² / (λ₁ + λ₂)² of the covariance of real and imaginary parts, about the origin.
    """
    real, imaginary = np.real(shape), np.imag(shape)
    sxx, syy, sxy = real @ real, imaginary @ imaginary, real @ imaginary
    total = sxx + syy
    return float(((sxx - syy) ** 2 + 4 * sxy**2) / total**2) if total > 0 else 0.0


def mpd(shape: Shape) -> float:
    """Mean phase deviation in degrees: the average angle, weighted by size, from the straight line that fits best.

    Raises `InvalidInput` if the shape is zero everywhere.
    """
    _refuse_zero(shape)
    _, _, axes = np.linalg.svd(np.column_stack([np.real(shape), np.imag(shape)]), full_matrices=False)
    along = np.abs(np.real(shape) * axes[0, 0] + np.imag(shape) * axes[0, 1])
    sizes = np.abs(shape)
    cosines = np.divide(along, sizes, out=np.ones_like(sizes), where=sizes > 0)
    angles = np.degrees(np.arccos(np.clip(cosines, 0.0, 1.0)))
    return float((sizes * angles).sum() / sizes.sum())


def frequency_error(found: float, true: float) -> float:
    """Relative error of a frequency."""
    return (found - true) / true


def damping_error(found: float, true: float) -> float:
    """Error of a damping ratio in percentage points."""
    return 100.0 * (found - true)


def pair(
    first: Sequence[float] | Float[np.ndarray, " rows"],
    second: Sequence[float] | Float[np.ndarray, " columns"],
    likeness: Float[np.ndarray, "rows columns"] | None = None,
    *,
    within_hz: float,
) -> list[tuple[int, int]]:
    """Pairs (index in first, index in second) of two lists of frequencies, each used once, best first.

    Parameters
    ----------
    first, second
        Frequencies in Hz.
    likeness
        MAC of every pair, which decides between lines that are close; by default frequency alone decides.
    within_hz
        Lines further apart are no pair.

    Raises
    ------
    InvalidInput
        `within_hz` is not positive, or `likeness` has another shape than the two lists.
    """
    if not within_hz > 0:
        raise InvalidInput(f"lines within {within_hz} Hz cannot be paired.", hint="Give a positive distance.")
    distance = np.abs(np.subtract.outer(np.asarray(first, dtype=float), np.asarray(second, dtype=float)))
    alike = np.ones_like(distance) if likeness is None else likeness
    if alike.shape != distance.shape:
        raise InvalidInput(
            f"the likeness of {alike.shape} does not fit {distance.shape[0]} and {distance.shape[1]} lines.",
            hint="Give mac_matrix of the same modes.",
        )
    merit = np.where(distance <= within_hz, alike * (1.0 - 0.5 * distance / within_hz), -1.0)
    pairs = []
    while merit.size and merit.max() >= 0:
        row, column = np.unravel_index(int(np.argmax(merit)), merit.shape)
        pairs.append((int(row), int(column)))
        merit[row, :] = -1.0
        merit[:, column] = -1.0
    return sorted(pairs)


def _validate(first: np.ndarray, second: np.ndarray) -> None:
    if first.shape != second.shape:
        raise InvalidInput(
            f"two shapes have {first.shape} and {second.shape} degrees of freedom.",
            hint="Interpolate both to the same sensors first.",
        )


def _refuse_zero(shape: np.ndarray) -> None:
    if not np.abs(shape).any():
        raise InvalidInput("a shape is zero everywhere.", hint="Leave out modes that do not move.")
