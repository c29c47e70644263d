"""Functions of two variables on a box that a sheet's heights are a sum of.

Polynomials as products of Legendre polynomials: of a total degree (degree 5 has 21 terms, the `poly55` of the paper) or
of a degree along each axis (tensor: 36 terms; as good inside the outline, six times worse outside). On the box
[-1, 1]² the products are nearly orthogonal, which keeps the normal equations well conditioned (monomials in
millimetres reach a condition number of 1e26). Splines as products of cubic B-splines: local, for sheets that
no polynomial follows.
"""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float
from scipy.interpolate import BSpline

BOX_MARGIN = 1.02
"""Points this far outside the box (in half sides) are not on the organ: the basis explodes there."""


CUBIC = 3
FEWEST_IN_TERM = 0.02
"""A spline that has less than this share of the usual weight of points stands outside the outline and is left out."""


@runtime_checkable
class Basis(Protocol):
    """What the bases have in common."""

    @property
    def terms(self) -> int:
        """Number of basis functions."""

    def contains(self, xy: Float[np.ndarray, "points 2"]) -> np.ndarray:
        """Which points lie in the box, a small margin included."""

    def evaluate(self, xy: Float[np.ndarray, "points 2"]) -> Float[np.ndarray, "points terms"]:
        """Value of every term at every point."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PolynomialBasis:
    """The recipe of a basis: `degree` on the box `center` ± `half` (metres, organ frame); total, or along each axis."""

    degree: int
    center: Float[np.ndarray, " 2"]
    half: Float[np.ndarray, " 2"]
    tensor: bool = False

    @property
    def terms(self) -> int:
        """Number of basis functions."""
        return len(self.powers())

    def powers(self) -> tuple[tuple[int, int], ...]:
        """Degrees (i, j) along x and y of every term, lowest total degree first."""
        highest = 2 * self.degree if self.tensor else self.degree
        every = ((total - j, j) for total in range(highest + 1) for j in range(total + 1))
        return tuple((i, j) for i, j in every if max(i, j) <= self.degree)

    def contains(self, xy: Float[np.ndarray, "points 2"]) -> np.ndarray:
        """Which points lie in the box, a small margin included."""
        return _in_box(xy, self.center, self.half)

    def evaluate(self, xy: Float[np.ndarray, "points 2"]) -> Float[np.ndarray, "points terms"]:
        """Value of every term at every point."""
        unit = (xy - self.center) / self.half
        along, across = (_legendre(unit[:, axis], self.degree) for axis in (0, 1))
        powers = self.powers()
        values = np.empty((len(powers), len(xy)))  # a term at a time is contiguous: twice as fast to make and multiply
        for term, (i, j) in enumerate(powers):
            np.multiply(along[i], across[j], out=values[term])
        return values.T


@dataclass(frozen=True, slots=True, kw_only=True)
class SplineBasis:
    """Products of cubic B-splines over `pieces` (along, across) equal pieces of the box; only the terms in `used`."""

    pieces: tuple[int, int]
    center: Float[np.ndarray, " 2"]
    half: Float[np.ndarray, " 2"]
    used: tuple[int, ...]

    @property
    def terms(self) -> int:
        """Number of basis functions."""
        return len(self.used)

    def contains(self, xy: Float[np.ndarray, "points 2"]) -> np.ndarray:
        """Which points lie in the box, a small margin included."""
        return _in_box(xy, self.center, self.half)

    def evaluate(self, xy: Float[np.ndarray, "points 2"]) -> Float[np.ndarray, "points terms"]:
        """Value of every term at every point."""
        return _splines(np.clip((xy - self.center) / self.half, -1.0, 1.0), self.pieces)[:, self.used]


def spline_around(xy: Float[np.ndarray, "points 2"], pieces: int, points: np.ndarray) -> SplineBasis:
    """Splines on the bounding box of `xy`, half as many pieces across; those where `points` (n, 2) are."""
    low, high = xy.min(axis=0), xy.max(axis=0)
    center, half = (low + high) / 2, np.maximum((high - low) / 2, 1e-9)
    both = (pieces, max(1, pieces // 2))
    weight = (_splines(np.clip((points - center) / half, -1.0, 1.0), both) ** 2).sum(axis=0)
    used = np.flatnonzero(weight > FEWEST_IN_TERM * np.median(weight[weight > 0]))
    return SplineBasis(pieces=both, center=center, half=half, used=tuple(map(int, used)))


def _splines(unit: np.ndarray, pieces: tuple[int, int]) -> np.ndarray:
    """Every product of a spline along and one across at every point."""
    sides = []
    for axis, count in enumerate(pieces):
        knots = np.concatenate([[-1.0] * CUBIC, np.linspace(-1, 1, count + 1), [1.0] * CUBIC])
        sides.append(BSpline.design_matrix(unit[:, axis], knots, CUBIC).toarray())
    return np.asarray(np.einsum("pi,pj->pij", *sides).reshape(len(unit), -1))


def _in_box(xy: np.ndarray, center: np.ndarray, half: np.ndarray) -> np.ndarray:
    return np.asarray(np.all(np.abs(xy - center) <= BOX_MARGIN * half, axis=1))


def _legendre(unit: np.ndarray, degree: int) -> list[np.ndarray]:
    """P_0 … P_degree at every point, by Bonnet's recursion."""
    values = [np.ones_like(unit), unit]
    for n in range(1, degree):
        values.append(((2 * n + 1) * unit * values[n] - n * values[n - 1]) / (n + 1))
    return values[: degree + 1]


def basis_around(xy: Float[np.ndarray, "points 2"], degree: int, *, tensor: bool = False) -> PolynomialBasis:
    """The polynomials on the bounding box of `xy`."""
    low, high = xy.min(axis=0), xy.max(axis=0)
    half = np.maximum((high - low) / 2, 1e-9)
    return PolynomialBasis(degree=degree, center=(low + high) / 2, half=half, tensor=tensor)
