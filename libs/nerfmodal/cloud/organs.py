"""Which points belong to which leaf or branch, found from the clouds alone.

A record's points fall into cells of space; those that are there through the record hang together as structures. A
structure is followed from its foot along its branches; each becomes a sheet (leaf) or a rod (trunk, branch). Ground
and lumps are left out. An organ is the space that its cells and their neighbours take through its whole motion, but for
where it meets others: there its surface goes on without points.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import csgraph

from nerfmodal.cloud.ground import without_ground
from nerfmodal.cloud.segments import FEWEST_CELLS, Piece, pieces_of
from nerfmodal.cloud.sheets import Sample
from nerfmodal.cloud.voxels import Cells, space_of, stable_cells
from nerfmodal.types import PointCloud

MOST_FRAMES = 48
MOST_POINTS = 12_000
"""Points of a frame that are looked at."""
SURFACE_FRAMES = 6
"""Frames whose surfaces decide whether pieces are one sheet."""
FEWEST_POINTS = 300
"""Of an organ in a frame, in half of `COUNTED_FRAMES` frames: fewer make no surface."""
COUNTED_FRAMES = 9
SMALLEST = 0.04
"""Of the points of the largest structure: smaller ones are floaters."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FoundOrgan:
    """A leaf (sheet) or branch (rod) and the space it takes: cells of `side` metres from `low`."""

    name: str
    kind: Literal["sheet", "rod"]
    low: Float[np.ndarray, " 3"]
    side: float
    space: Bool[np.ndarray, "i j k"]

    def contains(self, points: Float[np.ndarray, "points 3"]) -> Bool[np.ndarray, " points"]:
        """Which points may be the organ's."""
        place = np.floor((points - self.low) / self.side).astype(int)
        shape = np.array(self.space.shape)
        clipped = np.clip(place, 0, shape - 1)
        return np.asarray(np.all(place == clipped, axis=1) & self.space[tuple(clipped.T)])

    def select(self, cloud: PointCloud) -> PointCloud:
        """The part of a cloud that may be the organ's."""
        mine = self.contains(cloud.points)
        return cloud.part(mine)


def find_organs(clouds: Sequence[PointCloud | None], rng: np.random.Generator) -> tuple[FoundOrgan, ...]:
    """The organs of a record: leaves `leaf_0` … by their direction around the middle, then `trunk` or `stem_0` ….

    Parameters
    ----------
    clouds
        One per frame in time order, metres; None is a lost frame.
    rng
        Draws the points that are looked at.

    Returns
    -------
    tuple of FoundOrgan
        Empty where nothing is there through the record.
    """
    frames = _sample(clouds, rng)
    if not frames:
        return ()
    frames = without_ground(frames)
    cells = stable_cells(frames)
    if len(cells.places) < FEWEST_CELLS:
        return ()
    samples = [(points, cells.numbers_of(points)) for points in frames]
    pieces = _pieces(cells, [(points[number >= 0], number[number >= 0]) for points, number in samples])
    return tuple(organ for organ in _named(cells, pieces) if _is_dense(organ, clouds))


def _is_dense(organ: FoundOrgan, clouds: Sequence[PointCloud | None]) -> bool:
    """Whether half of some frames hold enough points for a surface."""
    present = [cloud for cloud in clouds if cloud is not None]
    some = present[:: max(1, len(present) // COUNTED_FRAMES)]
    return bool(np.median([organ.contains(cloud.points).sum() for cloud in some]) >= FEWEST_POINTS)


def _sample(clouds: Sequence[PointCloud | None], rng: np.random.Generator) -> list[np.ndarray]:
    present = [cloud.points for cloud in clouds if cloud is not None and len(cloud.points)]
    chosen = np.unique(np.linspace(0, len(present) - 1, min(MOST_FRAMES, len(present))).round().astype(int))
    return [present[place][rng.permutation(len(present[place]))[:MOST_POINTS]] for place in chosen]


def _pieces(cells: Cells, frames: list[Sample]) -> list[Piece]:
    links = cells.links()
    _, structure = csgraph.connected_components(links, directed=False)
    seen = np.bincount(structure[np.concatenate([numbers for _, numbers in frames])], minlength=structure.max() + 1)
    places = np.unique(np.linspace(0, len(frames) - 1, min(SURFACE_FRAMES, len(frames))).round().astype(int))
    found: list[Piece] = []
    for one in np.flatnonzero((seen >= SMALLEST * seen.max()) & (np.bincount(structure) >= FEWEST_CELLS)):
        mine = np.flatnonzero(structure == one)
        part = cells.keep(structure == one)
        within = [(points, part.numbers_of(points)) for points, _ in (frames[place] for place in places)]
        within = [(points[numbers >= 0], numbers[numbers >= 0]) for points, numbers in within]
        pieces = pieces_of(part, links[mine][:, mine], within)
        found += [Piece(cells=mine[piece.cells], kind=piece.kind) for piece in pieces]
    return found


def _named(cells: Cells, pieces: Sequence[Piece]) -> tuple[FoundOrgan, ...]:
    labels = np.full(len(cells.places), -1)
    for place, piece in enumerate(pieces):
        labels[piece.cells] = place
    middle = cells.centers.mean(axis=0)
    sheets = [place for place, piece in enumerate(pieces) if piece.kind == "sheet"]
    rods = [place for place, piece in enumerate(pieces) if piece.kind == "rod"]
    sheets.sort(key=lambda place: _direction(cells, labels == place, middle))
    rods.sort(key=lambda place: -len(pieces[place].cells))
    names = [(f"leaf_{k}", place) for k, place in enumerate(sheets)]
    names += [("trunk" if len(rods) == 1 else f"stem_{k}", place) for k, place in enumerate(rods)]
    return tuple(
        FoundOrgan(
            name=name,
            kind="rod" if pieces[place].kind == "rod" else "sheet",
            low=cells.low,
            side=cells.side,
            space=space_of(cells, labels == place, (labels >= 0) & (labels != place)),
        )
        for name, place in names
    )


def _direction(cells: Cells, mine: Int[np.ndarray, " cells"] | np.ndarray, middle: np.ndarray) -> float:
    """Angle around the vertical from +x, a full turn from just below +x on."""
    out = cells.centers[mine].mean(axis=0) - middle
    return float((np.arctan2(out[1], out[0]) + 0.1) % (2 * np.pi))
