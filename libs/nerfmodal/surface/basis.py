"""Polynomials of a total degree in two variables, as products of Legendre polynomials on a box.

Degree 5 has 21 terms, the `poly55` of the paper. On the box [-1, 1]² the products are nearly orthogonal, which keeps
the normal equations well conditioned (monomials in millimetres reach a condition number of 1e26).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

BOX_MARGIN = 1.02
"""Points this far outside the box (in half sides) are not on the organ: the basis explodes there."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PolynomialBasis:
    """The recipe of a basis: total `degree` on the box `center` ± `half` (metres, organ frame)."""

    degree: int
    center: Float[np.ndarray, " 2"]
    half: Float[np.ndarray, " 2"]

    @property
    def terms(self) -> int:
        """Number of basis functions."""
        return (self.degree + 1) * (self.degree + 2) // 2

    def powers(self) -> tuple[tuple[int, int], ...]:
        """Degrees (i, j) along x and y of every term, lowest total degree first."""
        return tuple((total - j, j) for total in range(self.degree + 1) for j in range(total + 1))

    def contains(self, xy: Float[np.ndarray, "points 2"]) -> np.ndarray:
        """Which points lie in the box, a small margin included."""
        return np.asarray(np.all(np.abs(xy - self.center) <= BOX_MARGIN * self.half, axis=1))

    def evaluate(self, xy: Float[np.ndarray, "points 2"]) -> Float[np.ndarray, "points terms"]:
        """Value of every term at every point."""
        unit = (xy - self.center) / self.half
        along, across = (_legendre(unit[:, axis], self.degree) for axis in (0, 1))
        values = np.empty(
            (self.terms, len(xy))
        )  # a term at a time is contiguous: twice as fast to make and to multiply
        for term, (i, j) in enumerate(self.powers()):
            np.multiply(along[i], across[j], out=values[term])
        return values.T


def _legendre(unit: np.ndarray, degree: int) -> list[np.ndarray]:
    """P_0 … P_degree at every point, by Bonnet's recursion."""
    values = [np.ones_like(unit), unit]
    for n in range(1, degree):
        values.append(((2 * n + 1) * unit * values[n] - n * values[n - 1]) / (n + 1))
    return values[: degree + 1]


def basis_around(xy: Float[np.ndarray, "points 2"], degree: int) -> PolynomialBasis:
    """The basis on the bounding box of `xy`."""
    low, high = xy.min(axis=0), xy.max(axis=0)
    return PolynomialBasis(degree=degree, center=(low + high) / 2, half=np.maximum((high - low) / 2, 1e-9))
