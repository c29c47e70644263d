"""Modes of a thin rectangular plate that is clamped along one edge (Kirchhoff), by Rayleigh and Ritz.

Trial functions s² P_i(2s - 1) P_j(2y/w) with Legendre's P: clamped at s = 0, free elsewhere (natural conditions), and
all integrals are exact by Gauss' quadrature. Frequencies are λ / (2π a²) sqrt(D / ρh); Leissa, Vibration of Plates
(NASA SP-160, 1969), section 4.2 gives λ of square plates.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
from jaxtyping import Float
from scipy.linalg import eigh
from scipy.special import legendre, roots_legendre

ALONG, ACROSS = 9, 7
"""Trial functions along and across: enough for four digits of the first six frequencies."""
FINE = 33


@dataclass(frozen=True, slots=True, kw_only=True)
class PlateModes:
    """Modes of a cantilever plate of length a and width w; `aspect` is w / a.

    `eigenvalues` are λ = ω a² sqrt(ρh / D); `coefficients` weigh the trial functions, largest deflection 1.
    """

    aspect: float
    eigenvalues: Float[np.ndarray, " modes"]
    coefficients: Float[np.ndarray, "modes along across"]

    def shape(
        self, s: Float[np.ndarray, " points"], across: Float[np.ndarray, " points"], order: int
    ) -> Float[np.ndarray, " points"]:
        """Deflection in mode `order` at s along (0..1) and `across` (-1..1 from edge to edge)."""
        x = np.stack([f(s) for f in _along()])
        y = np.stack([g(across) for g in _across()])
        return np.asarray(np.einsum("ij,ip,jp->p", self.coefficients[order - 1], x, y))

    def frequency(self, order: int, length: float, rigidity: float, mass: float) -> float:
        """Natural frequency (Hz): `length` m along, rigidity D in N m, `mass` in kg/m²."""
        return float(self.eigenvalues[order - 1] / (2 * np.pi * length**2) * np.sqrt(rigidity / mass))


@cache
def cantilever_plate(aspect: float, poisson: float = 0.3, count: int = 6) -> PlateModes:
    """The first `count` modes of a plate whose width is `aspect` times its length."""
    x, y = _products(_along(), 0.0), _products(_across(), -1.0)
    r = 2.0 / aspect  # d/dy in units of the length, where the trial functions run from -1 to 1
    stiffness = (
        _join(x[2, 2], y[0, 0])
        + r**4 * _join(x[0, 0], y[2, 2])
        + poisson * r**2 * (_join(x[2, 0], y[0, 2]) + _join(x[0, 2], y[2, 0]))
        + 2 * (1 - poisson) * r**2 * _join(x[1, 1], y[1, 1])
    )
    squares, vectors = eigh(stiffness, _join(x[0, 0], y[0, 0]), subset_by_index=[0, count - 1])
    plain = vectors.T.reshape(count, ALONG, ACROSS)
    modes = PlateModes(aspect=aspect, eigenvalues=np.sqrt(squares), coefficients=plain)
    return PlateModes(aspect=aspect, eigenvalues=modes.eigenvalues, coefficients=_unit(modes))


def _unit(modes: PlateModes) -> Float[np.ndarray, "modes along across"]:
    """Coefficients of shapes that are 1 where they are largest: a corner or the middle of the free edge."""
    s, y = (grid.ravel() for grid in np.meshgrid(np.linspace(0, 1, FINE), np.linspace(-1, 1, FINE)))
    scaled = []
    for order, coefficients in enumerate(modes.coefficients, start=1):
        values = modes.shape(s, y, order)
        scaled.append(coefficients / values[np.argmax(np.abs(values))])
    return np.stack(scaled)


def _along() -> list[np.poly1d]:
    s = np.poly1d([1, 0])
    return [s**2 * _legendre(i)(2 * s - 1) for i in range(ALONG)]


def _across() -> list[np.poly1d]:
    return [_legendre(j) for j in range(ACROSS)]


def _legendre(degree: int) -> np.poly1d:
    return np.poly1d(legendre(degree).coeffs)


def _products(functions: list[np.poly1d], start: float) -> Float[np.ndarray, "orders orders n n"]:
    """Integrals from `start` to 1 of products of derivatives 0, 1 and 2 of the trial functions."""
    nodes, weights = roots_legendre(FINE)
    half = (1 - start) / 2
    places = start + half * (nodes + 1)
    values = np.stack([[f.deriv(order)(places) for f in functions] for order in range(3)])
    return np.einsum("aip,bjp,p->abij", values, values, half * weights)


def _join(x: Float[np.ndarray, "i j"], y: Float[np.ndarray, "k l"]) -> Float[np.ndarray, "m n"]:
    return np.kron(x, y)
