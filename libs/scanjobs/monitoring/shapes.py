"""A mode shape small enough to keep in a row: a few sensors, evenly chosen, with where they are and how they move.

Two shapes can be compared where they are of the same sensors: as many, at the same places within a tenth of the organ's
size. The comparison is the modal assurance criterion of Allemang & Brown (1982).
"""

from typing import Final

import numpy as np

POINTS: Final = 24
SAME_PLACE: Final = 0.1
"""Largest root-mean-square distance of sensors, relative to the organ's radius."""


def pack(positions: np.ndarray, shape: np.ndarray, directions: np.ndarray) -> bytes:
    """The shape at a few sensors, from positions (sensors, 3) m, shape (sensors, axes), directions (axes, 3)."""
    chosen = np.unique(np.linspace(0, len(positions) - 1, POINTS).round().astype(int))
    places = positions[chosen] - positions[chosen].mean(axis=0)
    motion = shape[chosen] @ directions
    return np.hstack([places, motion]).astype("<f4").tobytes()


def unpack(packed: bytes) -> tuple[np.ndarray, np.ndarray]:
    """Places (points, 3) about their centre, m, and motion (points, 3)."""
    table = np.frombuffer(packed, dtype="<f4").reshape(-1, 6).astype(float)
    return table[:, :3], table[:, 3:]


def mac(first: bytes | None, second: bytes | None) -> float | None:
    """Modal assurance criterion of two packed shapes, 0 to 1; None where they are not of the same sensors."""
    if first is None or second is None or len(first) != len(second):
        return None
    (places, one), (others, two) = unpack(first), unpack(second)
    radius = np.sqrt((places**2).sum(axis=1).mean())
    apart = np.sqrt(((places - others) ** 2).sum(axis=1).mean())
    energy = float((one**2).sum() * (two**2).sum())
    if apart > SAME_PLACE * radius or energy <= 0.0:
        return None
    return float((one * two).sum() ** 2 / energy)
