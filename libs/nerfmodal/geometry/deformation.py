"""Smooth displacement of an organ in few numbers: products of Legendre polynomials along and across its frame.

A beam's or a plate's lowest modes are smooth along the organ and nearly straight across it, so few terms reach far:
degree 6 along, and across a slope and a curvature that vary more slowly. Affine motion is among them exactly.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from numpy.polynomial import legendre

from nerfmodal.geometry.frames import LocalFrame

DEGREES = (6, 4, 2)
"""Highest degree along the organ, for each degree across it."""
ROOM = 1.2
"""Half-sizes of the organ's frame within which the polynomials are believed; farther out they stay as there."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Deformation:
    """The terms of an organ's displacement; `half` is half the organ's size along and across its frame, metres."""

    frame: LocalFrame
    half: Float[np.ndarray, " 2"]
    degrees: tuple[int, ...] = DEGREES

    @property
    def orders(self) -> Int[np.ndarray, "terms 2"]:
        """Degree along and across of each term."""
        return np.array([(a, b) for b, most in enumerate(self.degrees) for a in range(most + 1)])

    def at(self, points: Float[np.ndarray, "points 3"]) -> Float[np.ndarray, "points terms"]:
        """The terms at world points (of the organ before it moved); displacement is their product with coefficients."""
        flat = np.clip(self.frame.to_local(points)[:, :2] / self.half, -ROOM, ROOM)
        along = legendre.legvander(flat[:, 0], max(self.degrees))  # type: ignore[no-untyped-call]
        across = legendre.legvander(flat[:, 1], len(self.degrees) - 1)  # type: ignore[no-untyped-call]
        orders = self.orders
        return np.asarray(along[:, orders[:, 0]] * across[:, orders[:, 1]])


def deformation_of(points: Float[np.ndarray, "points 3"], degrees: tuple[int, ...] = DEGREES) -> Deformation:
    """The terms for an organ of which points are known: its frame are their principal axes."""
    axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2].T
    axes[:, 2] = np.cross(axes[:, 0], axes[:, 1])
    local = points @ axes
    low, high = local.min(axis=0), local.max(axis=0)
    frame = LocalFrame(origin=axes @ (0.5 * (low + high)), axes=axes)
    return Deformation(frame=frame, half=np.maximum(0.5 * (high - low)[:2], 1e-9), degrees=degrees)
