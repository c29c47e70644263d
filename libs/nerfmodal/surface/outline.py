"""The supported area of an organ: where the record really has points, in its own plane.

A grid of cells over the pooled points; a cell is supported where its density is no outlier's. Gaps between leaflets
are closed, the largest patch is kept. Sensors stand inside this outline × 0.95, never in its bounding box: the
polynomial means nothing where there are no points (torsion MAC 0.15).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy import ndimage

CELLS_ALONG = 72
DENSEST = 75.0
"""Percentile of the occupied cells' density that stands for the organ's own."""
SPARSE = 0.25
"""Of that density: below it a cell holds outliers only."""
CLOSING_CELLS = 3
SHRINK = 0.95
GOLDEN = 1.32471795724474602596
"""The plastic number: its powers spread points evenly over a square (the R2 sequence)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Outline:
    """Supported cells of side `cell` metres; cell (0, 0) has its corner at `low` (organ frame)."""

    low: Float[np.ndarray, " 2"]
    cell: float
    supported: Bool[np.ndarray, "columns rows"]

    def contains(self, xy: Float[np.ndarray, "points 2"]) -> Bool[np.ndarray, " points"]:
        """Which points lie on supported cells."""
        place = np.floor((xy - self.low) / self.cell).astype(int)
        shape = np.array(self.supported.shape)
        within = np.all((place >= 0) & (place < shape), axis=1)
        clipped = np.clip(place, 0, shape - 1)
        return np.asarray(within & self.supported[clipped[:, 0], clipped[:, 1]])

    def corners(self) -> Float[np.ndarray, "2 2"]:
        """Lowest and highest (x, y) of the supported cells."""
        places = np.argwhere(self.supported)
        return np.stack([self.low + self.cell * places.min(axis=0), self.low + self.cell * (places.max(axis=0) + 1)])

    def center(self) -> Float[np.ndarray, " 2"]:
        """Centroid of the supported area."""
        return np.asarray(self.low + self.cell * (np.argwhere(self.supported).mean(axis=0) + 0.5))


def trace_outline(xy: Float[np.ndarray, "points 2"]) -> Outline:
    """The outline of pooled points of an organ's plane."""
    low, high = np.quantile(xy, [0.001, 0.999], axis=0)
    cell = float((high - low).max() / CELLS_ALONG)
    low = low - 2 * cell
    shape = np.ceil((high + 2 * cell - low) / cell).astype(int)
    edges = [low[axis] + cell * np.arange(shape[axis] + 1) for axis in (0, 1)]
    counts, _, _ = np.histogram2d(xy[:, 0], xy[:, 1], bins=edges)
    typical = np.percentile(counts[counts > 0], DENSEST)
    return Outline(low=low, cell=cell, supported=_one_patch(counts > SPARSE * typical))


def place_sensors(outline: Outline, count: int) -> Float[np.ndarray, "sensors 2"]:
    """`count` points spread evenly inside the outline × 0.95; the first of many are those of few."""
    low, high = outline.corners()
    center = outline.center()
    found: list[np.ndarray] = []
    start = 0
    while sum(map(len, found)) < count:
        steps = np.arange(start + 1, start + 1 + 4 * count)[:, None]
        candidates = low + (high - low) * np.mod(0.5 + steps * np.array([1 / GOLDEN, 1 / GOLDEN**2]), 1.0)
        found.append(candidates[outline.contains(center + (candidates - center) / SHRINK)])
        start += 4 * count
    return np.concatenate(found)[:count]


def _one_patch(occupied: np.ndarray) -> np.ndarray:
    padded = np.pad(occupied, CLOSING_CELLS)
    closed = ndimage.binary_closing(padded, iterations=CLOSING_CELLS) | padded
    inner = closed[CLOSING_CELLS:-CLOSING_CELLS, CLOSING_CELLS:-CLOSING_CELLS]
    labels, patches = ndimage.label(ndimage.binary_fill_holes(inner))
    if patches < 2:
        return np.asarray(labels > 0)
    sizes = np.bincount(labels.ravel())[1:]
    return np.asarray(labels == 1 + int(np.argmax(sizes)))
