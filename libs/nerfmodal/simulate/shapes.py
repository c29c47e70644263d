"""Mode shapes in closed form, on organ coordinates: s in 0..1 from the fixed end, y metres across.

Bending is that of a clamped-free uniform beam (Euler and Bernoulli; Blevins, Formulas for Natural Frequency and Mode
Shape, table 8-1), torsion that of a clamped-free shaft. Shapes are 1 where they are largest. Plates: see `plates`.
"""

import numpy as np
from jaxtyping import Float

BEAM_ROOTS = (1.8751040687119611, 4.694091132974175, 7.854757438237612)
"""Roots of cos(b) cosh(b) = -1: the clamped-free beam's eigenvalues."""


def cantilever_shape(s: Float[np.ndarray, " points"], order: int) -> Float[np.ndarray, " points"]:
    """Bending shape `order` (1, 2 or 3) of a clamped-free uniform beam, 1 at its tip s = 1."""
    b, ratio, tip = _beam(order)
    return (np.cosh(b * s) - np.cos(b * s) - ratio * (np.sinh(b * s) - np.sin(b * s))) / tip


def cantilever_slope(s: Float[np.ndarray, " points"], order: int) -> Float[np.ndarray, " points"]:
    """Derivative of `cantilever_shape` by s."""
    b, ratio, tip = _beam(order)
    return b * (np.sinh(b * s) + np.sin(b * s) - ratio * (np.cosh(b * s) - np.cos(b * s))) / tip


def shaft_twist(s: Float[np.ndarray, " points"], order: int = 1) -> Float[np.ndarray, " points"]:
    """Angle of a clamped-free shaft in torsion `order`, 1 at its largest: sin((2k - 1) pi s / 2)."""
    return np.asarray(np.sin((2 * order - 1) * np.pi * s / 2))


def beam_frequency(order: int, length: float, stiffness: float, mass: float) -> float:
    """Natural frequency (Hz) of a clamped-free beam of `length` m, EI `stiffness` N m², `mass` kg/m."""
    return float(BEAM_ROOTS[order - 1] ** 2 / (2 * np.pi * length**2) * np.sqrt(stiffness / mass))


def _beam(order: int) -> tuple[float, float, float]:
    """Root, ratio of the hyperbolic sines' part to the cosines', and the unscaled deflection of the tip."""
    b = BEAM_ROOTS[order - 1]
    ratio = (np.cosh(b) + np.cos(b)) / (np.sinh(b) + np.sin(b))
    tip = np.cosh(b) - np.cos(b) - ratio * (np.sinh(b) - np.sin(b))
    return b, float(ratio), float(tip)
