"""Skins: what an organ's sensors look like when they are drawn, as triangles over them.

A sheet's sensors are joined to their neighbours in the sheet's own plane. A rod's sensors stand on its centreline: the
skin is a tube of `SIDES` corners around them, whose radius is a share of the length and shows nothing measured.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import Delaunay, QhullError

LONGEST_EDGE = 3.5
"""A triangle whose longest edge is more than this many median edges spans a gap and is left out."""
FLATTEST = 1e-6
"""A sheet narrower than this share of its length is a line: it has no triangles."""
RADIUS = 0.012
"""Of a tube, as a share of the rod's length."""
SIDES = 8
MOST_RINGS = 60


@dataclass(frozen=True, slots=True, kw_only=True)
class Skin:
    """Vertices in metres, the sensor that each vertex moves with, and the triangles between vertices."""

    vertices: Float[np.ndarray, "vertices 3"]
    sensor: Int[np.ndarray, " vertices"]
    triangles: Int[np.ndarray, "triangles 3"]


def skin_of(positions: Float[np.ndarray, "sensors 3"], surface: str, *, most: int) -> Skin:
    """The skin over an organ's sensors: a tube for a `cylinder`; a sheet keeps `most` of them, evenly chosen."""
    return tube(positions) if surface == "cylinder" else sheet(positions, most=most)


def sheet(positions: Float[np.ndarray, "sensors 3"], *, most: int) -> Skin:
    """The skin of a sheet: a vertex for every sensor that is kept."""
    kept = np.unique(np.linspace(0, len(positions) - 1, min(len(positions), most)).round()).astype(int)
    return Skin(vertices=positions[kept], sensor=kept, triangles=sheet_triangles(positions[kept]))


def tube(positions: Float[np.ndarray, "sensors 3"]) -> Skin:
    """The skin of a rod: rings across its length around sensors in their order along it."""
    order = rod_order(positions)
    rings = order[np.unique(np.linspace(0, len(order) - 1, min(len(order), MOST_RINGS)).round()).astype(int)]
    centred = positions - positions.mean(axis=0)
    across = np.linalg.svd(centred.T @ centred)[2][1:]
    angle = 2 * np.pi * np.arange(SIDES) / SIDES
    radius = RADIUS * np.linalg.norm(np.ptp(positions, axis=0))
    ring = radius * np.column_stack([np.cos(angle), np.sin(angle)]) @ across
    vertices = (positions[rings][:, None, :] + ring).reshape(-1, 3)
    return Skin(vertices=vertices, sensor=np.repeat(rings, SIDES), triangles=_tube_triangles(len(rings)))


def rod_order(positions: Float[np.ndarray, "sensors 3"]) -> Int[np.ndarray, " sensors"]:
    """Sensors in their order along the direction they are spread in most."""
    centred = positions - positions.mean(axis=0)
    along = centred @ np.linalg.svd(centred, full_matrices=False)[2][0]
    return np.argsort(along, kind="stable")


def sheet_triangles(points: Float[np.ndarray, "points 3"]) -> Int[np.ndarray, "triangles 3"]:
    """Triangles between neighbours in the sheet's own plane; those that span a gap are left out."""
    centred = points - points.mean(axis=0)
    axes = np.linalg.svd(centred, full_matrices=False)[2]
    flat = centred @ axes[:2].T
    if len(points) < 4 or np.ptp(flat[:, 1]) <= FLATTEST * np.ptp(flat[:, 0]):
        return np.empty((0, 3), dtype=int)
    try:
        triangles = Delaunay(flat).simplices.astype(int)
    except QhullError:  # all points on one line, to rounding
        return np.empty((0, 3), dtype=int)
    corners = flat[triangles]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    return triangles[longest <= LONGEST_EDGE * np.median(longest)]


def outline(triangles: Int[np.ndarray, "triangles 3"]) -> Int[np.ndarray, "edges 2"]:
    """The edges that belong to one triangle alone."""
    unique, count = np.unique(_all_edges(triangles), axis=0, return_counts=True)
    return unique[count == 1]


def edges(triangles: Int[np.ndarray, "triangles 3"]) -> Int[np.ndarray, "edges 2"]:
    """Every edge once, the lower index first."""
    return np.unique(_all_edges(triangles), axis=0)


def _all_edges(triangles: Int[np.ndarray, "triangles 3"]) -> Int[np.ndarray, "edges 2"]:
    return np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)


def _tube_triangles(rings: int) -> Int[np.ndarray, "triangles 3"]:
    """Two triangles for every side between neighbouring rings."""
    first = SIDES * np.arange(max(rings - 1, 0))[:, None] + np.arange(SIDES)
    second = SIDES * np.arange(max(rings - 1, 0))[:, None] + (np.arange(SIDES) + 1) % SIDES
    lower = np.stack([first, second, first + SIDES], axis=-1)
    upper = np.stack([second, second + SIDES, first + SIDES], axis=-1)
    return np.concatenate([lower.reshape(-1, 3), upper.reshape(-1, 3)])
