"""A record's points in cells of space: where something is in most of the record, and how the cells hang together.

Scale-free: a cell's side is a share of the record's extent. What is there in too few frames (a floater of one frame,
stray points) has no cell; a moving leaf sweeps the cells of its whole motion.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import ndimage, sparse, spatial

CELLS_ALONG = 72
"""Cells along the longest side of what is stable."""
ENDS = 0.01
SPARSE = 0.06
"""Of the density that a point usually sees: cells below it hold stray points only."""
STABLE = 0.12
"""Share of the frames in which a cell or a neighbour must hold points."""
LINK_CELLS = 2.5
"""Cells this far apart hang together: gaps between leaflets are bridged."""
ROUGH_CELLS = 40
REACH_CELLS = 2
"""How far around its cells an organ's points are looked for, and how far other organs make them doubtful."""
CLEAR_SHARE = 0.4


@dataclass(frozen=True, slots=True, kw_only=True)
class Cells:
    """Occupied cells of side `side` metres: `places` on the grid from `low`, `numbers` on the dense grid (-1: none)."""

    low: Float[np.ndarray, " 3"]
    side: float
    places: Int[np.ndarray, "cells 3"]
    numbers: Int[np.ndarray, "i j k"]

    @property
    def centers(self) -> Float[np.ndarray, "cells 3"]:
        """Middle of every cell, metres."""
        return self.low + self.side * (self.places + 0.5)

    def numbers_of(self, points: Float[np.ndarray, "points 3"]) -> Int[np.ndarray, " points"]:
        """The cell of every point; -1 for points in none."""
        place = np.floor((points - self.low) / self.side).astype(int)
        shape = np.array(self.numbers.shape)
        within = np.all((place >= 0) & (place < shape), axis=1)
        clipped = np.clip(place, 0, shape - 1)
        return np.where(within, self.numbers[tuple(clipped.T)], -1)

    def keep(self, kept: Bool[np.ndarray, " cells"]) -> "Cells":
        """Some of the cells, numbered anew."""
        return _numbered(self.low, self.side, self.places[kept], self.numbers.shape)

    def links(self) -> sparse.csr_matrix:
        """Distances (metres) between cells that hang together."""
        pairs = spatial.cKDTree(self.places).query_pairs(LINK_CELLS, output_type="ndarray")
        lengths = self.side * np.linalg.norm(self.places[pairs[:, 0]] - self.places[pairs[:, 1]], axis=1)
        size = len(self.places)
        one_way = sparse.coo_matrix((lengths, (pairs[:, 0], pairs[:, 1])), shape=(size, size))
        return sparse.csr_matrix(one_way + one_way.T)


def stable_cells(frames: Sequence[Float[np.ndarray, "_ 3"]]) -> Cells:
    """The cells that hold points through most of the record, at a side that suits what is stable."""
    pooled = np.concatenate(frames)
    low, high = np.quantile(pooled, [ENDS, 1 - ENDS], axis=0)
    rough = _stable(frames, low, high, float((high - low).max() / ROUGH_CELLS))
    low, high = rough.centers.min(axis=0) - rough.side, rough.centers.max(axis=0) + rough.side
    return _stable(frames, low, high, float((high - low).max() / CELLS_ALONG))


def _stable(frames: Sequence[np.ndarray], low: np.ndarray, high: np.ndarray, side: float) -> Cells:
    side = max(side, 1e-12)
    shape = tuple(int(size) for size in np.ceil((high - low) / side).astype(int) + 3)
    low = low - side
    counts, seen = np.zeros(shape), np.zeros(shape)
    for points in frames:
        place = np.floor((points - low) / side).astype(int)
        place = place[np.all((place >= 0) & (place < np.array(shape)), axis=1)]
        filled = np.bincount(np.ravel_multi_index(tuple(place.T), shape), minlength=counts.size).reshape(shape)
        counts += filled
        seen += ndimage.maximum_filter(filled > 0, size=3)
    kept = (counts > SPARSE * _usual(counts)) & (seen >= STABLE * len(frames))
    return _numbered(low, side, np.argwhere(kept), shape)


def _usual(counts: np.ndarray) -> float:
    """The count of the cell that the median point lies in: cells with a stray point or two do not weigh."""
    filled = np.sort(counts[counts > 0])
    if not len(filled):
        return 0.0
    return float(filled[np.searchsorted(np.cumsum(filled), filled.sum() / 2)])


def _numbered(low: np.ndarray, side: float, places: np.ndarray, shape: tuple[int, ...]) -> Cells:
    numbers = np.full(shape, -1)
    numbers[tuple(places.T)] = np.arange(len(places))
    return Cells(low=low, side=side, places=places, numbers=numbers)


def space_of(cells: Cells, mine: Bool[np.ndarray, " cells"], others: Bool[np.ndarray, " cells"]) -> np.ndarray:
    """The dense grid (i, j, k) that the cells `mine` and their neighbours take, away from those of other organs.

    Where organs meet, their points cannot be told apart and belong to none; should that be most of an organ (leaves
    that lie on one another), all its own neighbourhood stays.
    """
    near, contested = _around(cells, mine), _around(cells, others)
    own = near & ~contested
    clear = np.count_nonzero(own[tuple(cells.places[mine].T)])
    return own if clear >= CLEAR_SHARE * np.count_nonzero(mine) else near


def _around(cells: Cells, some: np.ndarray) -> np.ndarray:
    dense = np.zeros(cells.numbers.shape, dtype=bool)
    dense[tuple(cells.places[some].T)] = True
    return np.asarray(ndimage.binary_dilation(dense, ndimage.generate_binary_structure(3, 3), iterations=REACH_CELLS))
