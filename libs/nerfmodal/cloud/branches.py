"""How a structure branches: level sets of the distance along it from its foot, followed upwards.

Where the cells at one distance fall apart into pieces that go on for long, branches begin. A cell above belongs to the
branch that its shortest way to the foot comes through, so that two leaves which touch further out stay two
(a discrete Reeb graph; Lazarus and Verroust 1999).
"""

import numpy as np
from jaxtyping import Float, Int
from scipy import sparse
from scipy.sparse import csgraph

LEVEL_CELLS = 3.0
"""Thickness of a level in cells."""
SHORTEST = 0.15
"""A branch is at least this share of the longest way from the foot."""
FEWEST_LEVELS = 3


def branches(
    links: sparse.csr_matrix, foot: int, side: float
) -> tuple[Int[np.ndarray, " cells"], Float[np.ndarray, " cells"]]:
    """The branch of every cell of a connected structure, from 0 at its foot, and its way from the foot, metres."""
    ways, before, _ = ways_from(links, np.array([foot]))
    levels = np.floor(ways / (LEVEL_CELLS * side)).astype(int)
    node, parent = _nodes(links, ways, levels, before)
    return _labels(node, parent, _fewest(levels)), ways


def ways_from(
    links: sparse.csr_matrix, starts: Int[np.ndarray, " starts"]
) -> tuple[Float[np.ndarray, " cells"], Int[np.ndarray, " cells"], Int[np.ndarray, " cells"]]:
    """The shortest way (metres) from any start to every cell, the cell before it (negative: none), and the start."""
    ways, before, start = csgraph.dijkstra(links, True, starts, True, min_only=True)
    return np.asarray(ways), np.asarray(before), np.asarray(start)


def _nodes(
    links: sparse.csr_matrix, ways: np.ndarray, levels: np.ndarray, before: np.ndarray
) -> tuple[np.ndarray, list[int]]:
    """Pieces of levels (a node for every cell) and each piece's parent, one level below.

    Pieces that meet become one again, unless they have been apart for long: then every cell stays with the piece
    that its way comes through.
    """
    node = np.full(len(levels), -1)
    parent, age = [-1], [1]
    node[levels == 0] = 0
    fewest = _fewest(levels)
    for level in range(1, levels.max() + 1):
        cells = np.flatnonzero(levels == level)
        origin = _origins(cells[np.argsort(ways[cells])], before, node)
        count, pieces = csgraph.connected_components(links[cells][:, cells], directed=False)
        for piece in range(count):
            mine = cells[pieces == piece]
            for one, part in _apart(mine, origin[pieces == piece], age, fewest):
                node[part] = len(parent)
                parent.append(one)
                age.append(1)
        _grow_older(node[cells], parent, age)
    return node, parent


def _origins(cells: np.ndarray, before: np.ndarray, node: np.ndarray) -> np.ndarray:
    """The piece below that each cell's way comes through, in the order of the cells' numbers."""
    origin: dict[int, int] = {}
    for cell in map(int, cells):  # nearest first: what a cell came from in its own level is known by then
        came = int(before[cell])
        origin[cell] = origin[came] if came in origin else int(node[came])
    return np.array([origin[cell] for cell in sorted(origin)])


def _apart(mine: np.ndarray, origin: np.ndarray, age: list[int], fewest: int) -> list[tuple[int, np.ndarray]]:
    """A piece as parts (origin, cells): one, or one for each origin that has long been on its own."""
    sizes = np.bincount(origin)
    found = np.flatnonzero(sizes)
    old = [int(one) for one in found if age[one] >= fewest]
    if len(old) < 2:
        return [(old[0] if old else int(np.argmax(sizes)), mine)]
    largest = max(old, key=lambda one: sizes[one])
    joined = np.where(np.isin(origin, old), origin, largest)
    return [(one, mine[joined == one]) for one in old]


def _grow_older(nodes: np.ndarray, parent: list[int], age: list[int]) -> None:
    """The largest child carries its parent's age on; the others begin anew."""
    places, sizes = np.unique(nodes, return_counts=True)
    seen: set[int] = set()
    for place in places[np.argsort(-sizes, kind="stable")]:
        if parent[place] not in seen:
            seen.add(parent[place])
            age[place] = age[parent[place]] + 1


def _fewest(levels: np.ndarray) -> int:
    return max(FEWEST_LEVELS, round(SHORTEST * (int(levels.max()) + 1)))


def _labels(node: np.ndarray, parent: list[int], fewest: int) -> np.ndarray:
    """A new branch begins at every long child of a piece that has two of them; short children stay with it."""
    children: list[list[int]] = [[] for _ in parent]
    for child, one in enumerate(parent):
        if one >= 0:
            children[one].append(child)
    height = [1] * len(parent)
    for place in reversed(range(len(parent))):
        height[place] = 1 + max((height[child] for child in children[place]), default=0)
    branch = [0] * len(parent)
    begun = 0
    for place in range(len(parent)):
        long = [child for child in children[place] if height[child] >= fewest]
        for child in children[place]:
            if len(long) > 1 and child in long:
                begun += 1
                branch[child] = begun
            else:
                branch[child] = branch[place]
    return np.array(branch)[node]
