"""Pieces of a connected structure that are a sheet or a rod each: its branches, cut where they widen, then rejoined."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Int
from scipy import sparse

from nerfmodal.cloud.branches import LEVEL_CELLS, branches, ways_from
from nerfmodal.cloud.sheets import Sample, roughness, solidity, split_in_two
from nerfmodal.cloud.voxels import Cells

Kind = Literal["sheet", "rod", "lump"]
SLENDER = 0.08
"""Width over length below which a piece is a rod whatever its section looks like (a trunk seen from one side)."""
STOUT = 0.30
ROUND = 0.45
"""Thickness over width of a section from which it is round."""
WIDENS = 1.8
USUAL = 1.25
FEWEST_LEVELS = 6
SHORTEST_ROD = 0.25
"""Of a branch's levels: a shorter narrow end is a stalk or a tip."""
WIDTH_OF_DEVIATION = 3.3
SOLID = 0.8
JOINED = 1.2
"""One sheet through both pieces may be this much rougher than one through each."""
SMOOTH = 0.004
"""Of the extent: below this roughness nothing is told apart."""
JUNCTION = 1.5
"""A piece between others that is rougher than they are by this factor is where they meet."""
FEWEST_CELLS = 24
MEETING = -1
"""The label of cells where branches leave a rod: nobody's."""
MEETING_LEVELS = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class Piece:
    """Cells of one piece of the structure, and what it looks like."""

    cells: Int[np.ndarray, " _"]
    kind: Kind


def pieces_of(cells: Cells, links: sparse.csr_matrix, frames: Sequence[Sample]) -> list[Piece]:
    """A connected structure as sheets and rods; lumps are what is neither, and where branches leave a rod."""
    branch, ways = branches(links, int(np.argmin(cells.centers[:, 2])), cells.side)
    label = _cut_where_wider(branch, ways, cells)
    label = _share_crowns(label, branch, links, ways, cells)
    label = _rejoin(label, links, ways, cells, frames)
    label = _share_junctions(label, links, ways, cells, frames)
    label = _tear_apart(label, links, ways, cells, frames)
    return [_piece(int(one), label, ways, cells) for one in np.unique(label)]


def _piece(one: int, label: np.ndarray, ways: np.ndarray, cells: Cells) -> Piece:
    mine = np.flatnonzero(label == one)
    small = one == MEETING or len(mine) < FEWEST_CELLS
    return Piece(cells=mine, kind="lump" if small else _kind(mine, ways, cells))


def _kind(mine: np.ndarray, ways: np.ndarray, cells: Cells) -> Kind:
    widths, aspects, length = _sections(mine, ways, cells)
    if not len(widths):
        return "lump"
    slender, aspect = float(np.median(widths)) / max(length, 1e-12), float(np.median(aspects))
    if slender < SLENDER or (slender < STOUT and aspect > ROUND):
        return "rod"
    return "lump" if aspect > 0.8 and slender > 0.6 else "sheet"


def _sections(mine: np.ndarray, ways: np.ndarray, cells: Cells) -> tuple[np.ndarray, np.ndarray, float]:
    """Width (m) and thickness over width of the sections across a piece, foot to end, and its length (m)."""
    centers = cells.centers[mine]
    levels = np.floor((ways[mine] - ways[mine].min()) / (LEVEL_CELLS * cells.side)).astype(int)
    used = [level for level in range(levels.max() + 1) if np.count_nonzero(levels == level) >= 3]
    if len(used) < 2:
        return np.zeros(0), np.zeros(0), 0.0
    middles = np.stack([centers[levels == level].mean(axis=0) for level in used])
    along = np.gradient(middles, axis=0)
    length = float(np.linalg.norm(np.diff(middles, axis=0), axis=1).sum() + LEVEL_CELLS * cells.side)
    widths, aspects = [], []
    for level, middle, direction in zip(used, middles, along, strict=True):
        direction = direction / max(float(np.linalg.norm(direction)), 1e-12)
        across = centers[levels == level] - middle
        across = across - np.outer(across @ direction, direction)
        spread = np.sqrt(np.maximum(np.linalg.eigvalsh(across.T @ across / len(across)), 0.0))
        cell = cells.side / np.sqrt(12)
        widths.append(WIDTH_OF_DEVIATION * spread[2])
        aspects.append(np.hypot(spread[1], cell) / np.hypot(spread[2], cell))
    return np.array(widths), np.array(aspects), length


def _cut_where_wider(branch: np.ndarray, ways: np.ndarray, cells: Cells) -> np.ndarray:
    """Branches cut where a long rod ends and something wider begins: a trunk below its crown or its one leaf.

    Twice the branch's number below the cut, one more above.
    """
    label = 2 * branch
    for one in np.unique(branch):
        mine = np.flatnonzero(branch == one)
        levels = np.floor((ways[mine] - ways[mine].min()) / (LEVEL_CELLS * cells.side)).astype(int)
        widths, _, _ = _sections(mine, ways, cells)
        if len(widths) < FEWEST_LEVELS or len(widths) != levels.max() + 1:
            continue
        cut = _before_widening(widths, _step(np.log(widths + cells.side)))
        ratio = np.median(widths[cut:]) / max(float(np.median(widths[:cut])), cells.side)
        narrow = levels < cut if ratio > 1 else levels >= cut
        long = np.mean(np.arange(len(widths)) < cut) if ratio > 1 else np.mean(np.arange(len(widths)) >= cut)
        if max(ratio, 1 / ratio) >= WIDENS and long >= SHORTEST_ROD and _kind(mine[narrow], ways, cells) == "rod":
            label[mine[levels >= cut]] = 2 * one + 1
    return label


def _before_widening(widths: np.ndarray, cut: int) -> int:
    """The cut moved down to where the section first is a little wider than below."""
    usual = float(np.median(widths[:cut]))
    while cut > FEWEST_LEVELS and USUAL * usual < widths[cut - 1] < widths[cut]:
        cut -= 1
    return cut


def _step(values: np.ndarray) -> int:
    """Where two constants, one before and one from there on, come closest to the values."""
    costs = [values[:k].var() * k + values[k:].var() * (len(values) - k) for k in range(1, len(values))]
    return 1 + int(np.argmin(costs))


def _share_crowns(
    label: np.ndarray, branch: np.ndarray, links: sparse.csr_matrix, ways: np.ndarray, cells: Cells
) -> np.ndarray:
    """Where a trunk was cut and branches go on: next to the trunk nobody's, further out the nearest branch's."""
    shared = label.copy()
    for one in np.unique(label[label % 2 == 1]):
        between = np.flatnonzero(label == one)
        beyond = np.flatnonzero((branch != one // 2) & (ways > np.median(ways[between])))
        touching = np.unique(branch[beyond[np.asarray(links[beyond][:, between].sum(axis=1)).ravel() > 0]])
        if len(touching) < 2:
            continue
        starts = np.flatnonzero(np.isin(branch, touching))
        top = between[ways[between] < ways[between].min() + MEETING_LEVELS * LEVEL_CELLS * cells.side]
        shared[between] = label[ways_from(links, starts)[2][between]]
        shared[top] = MEETING
    return shared


def _rejoin(
    label: np.ndarray, links: sparse.csr_matrix, ways: np.ndarray, cells: Cells, frames: Sequence[Sample]
) -> np.ndarray:
    """Neighbouring pieces that are one solid sheet, or one straight rod, become one; the best pair first."""
    label = label.copy()
    refused: set[tuple[int, int]] = set()
    while True:
        pairs = [pair for pair in _neighbours(label, links) if pair not in refused]
        rated = [(_likeness(label, pair, ways, cells), pair) for pair in pairs]
        merit, best = max(rated, default=(0.0, (0, 0)))
        if merit <= 0.0:
            return label
        if merit > 1.0 or _one_sheet(label, best, cells, frames):
            label[label == best[1]] = best[0]
            refused = {pair for pair in refused if best[0] not in pair and best[1] not in pair}
        else:
            refused.add(best)


def _neighbours(label: np.ndarray, links: sparse.csr_matrix) -> list[tuple[int, int]]:
    pairs = links.tocoo()
    ends = np.stack([label[pairs.row], label[pairs.col]], axis=1)
    return [(int(a), int(b)) for a, b in np.unique(ends[(ends[:, 0] < ends[:, 1]) & (ends[:, 0] != MEETING)], axis=0)]


def _likeness(label: np.ndarray, pair: tuple[int, int], ways: np.ndarray, cells: Cells) -> float:
    """Above 1: surely one (rods in line, crumbs); 0: surely not; between: solidity of the two together."""
    first, second = (np.flatnonzero(label == one) for one in pair)
    if min(len(first), len(second)) < FEWEST_CELLS // 2:
        return 2.0
    kinds = {_kind(first, ways, cells), _kind(second, ways, cells)}
    both = np.concatenate([first, second])
    if kinds == {"rod"}:
        return 1.5 if _kind(both, ways, cells) == "rod" and _in_line(cells.centers[first], cells.centers[second]) else 0
    if "rod" in kinds:
        return 0.0
    solid = solidity(cells.centers[both], cells.side)
    return solid if solid >= SOLID else 0.0


def _in_line(first: np.ndarray, second: np.ndarray) -> bool:
    axes = [np.linalg.svd(part - part.mean(axis=0), full_matrices=False)[2][0] for part in (first, second)]
    step = second.mean(axis=0) - first.mean(axis=0)
    step = step / max(float(np.linalg.norm(step)), 1e-12)
    return bool(min(abs(axes[0] @ axes[1]), abs(axes[0] @ step), abs(axes[1] @ step)) > np.cos(np.radians(35)))


def _points(frames: Sequence[Sample], mine: np.ndarray) -> list[np.ndarray]:
    return [points[mine[numbers]] for points, numbers in frames]


def _one_sheet(label: np.ndarray, pair: tuple[int, int], cells: Cells, frames: Sequence[Sample]) -> bool:
    first, second = (label == one for one in pair)
    together = roughness(_points(frames, first | second))
    apart = np.average(
        [roughness(_points(frames, part)) for part in (first, second)], weights=[first.sum(), second.sum()]
    )
    extent = float(np.ptp(cells.centers[first | second], axis=0).max())
    return bool(together <= max(JOINED * apart, SMOOTH * extent))


def _share_junctions(
    label: np.ndarray, links: sparse.csr_matrix, ways: np.ndarray, cells: Cells, frames: Sequence[Sample]
) -> np.ndarray:
    """Where several sheets meet is no sheet of its own: its cells go to the nearest of them."""
    shared = label.copy()
    pairs = _neighbours(label, links)
    kinds = {int(one): _kind(np.flatnonzero(label == one), ways, cells) for one in np.unique(label[label != MEETING])}
    rough = {one: roughness(_points(frames, label == one)) for one in kinds}
    for one in kinds:
        around = [other for pair in pairs if one in pair for other in pair if other != one and kinds[other] == "sheet"]
        meets = len(around) >= 2 and rough[one] > JUNCTION * np.median([rough[other] for other in around])
        if kinds[one] != "rod" and meets:
            mine = np.flatnonzero(label == one)
            shared[mine] = label[ways_from(links, np.flatnonzero(np.isin(label, around)))[2][mine]]
    return shared


def _tear_apart(
    label: np.ndarray, links: sparse.csr_matrix, ways: np.ndarray, cells: Cells, frames: Sequence[Sample]
) -> np.ndarray:
    """A piece that two sheets follow much better than one is two that touch."""
    label = label.copy()
    waiting = [int(one) for one in np.unique(label[label != MEETING])]
    while waiting:
        one = waiting.pop()
        mine = np.flatnonzero(label == one)
        if len(mine) < 4 * FEWEST_CELLS or _kind(mine, ways, cells) == "rod":
            continue
        second = _torn(mine, links, cells, frames)
        if second is not None:
            fresh = int(label.max()) + 1
            label[mine[second]] = fresh
            waiting += [one, fresh]
    return label


def _torn(mine: np.ndarray, links: sparse.csr_matrix, cells: Cells, frames: Sequence[Sample]) -> np.ndarray | None:
    new = np.full(len(cells.places), -1)
    new[mine] = np.arange(len(mine))
    inside = [(points[new[numbers] >= 0], new[numbers][new[numbers] >= 0]) for points, numbers in frames]
    extent = float(np.ptp(cells.centers[mine], axis=0).max())
    if roughness([points for points, _ in inside]) <= SMOOTH * extent:
        return None
    second = split_in_two(inside, cells.centers[mine], links[mine][:, mine])
    if second is None or min(second.sum(), (~second).sum()) < FEWEST_CELLS:
        return None
    return second
