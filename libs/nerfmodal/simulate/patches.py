"""Pieces of a mesh that know where on their organ each vertex lies, and how pieces become one mesh.

Organ coordinates: `along` is s in 0..1 from the fixed end to the tip; `across` is the signed distance in metres
from the organ's axis.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int


@dataclass(frozen=True, slots=True, kw_only=True)
class Patch:
    """A triangulated piece of one organ; lengths in metres, colours linear in [0, 1], masses in kg at its vertices."""

    vertices: Float[np.ndarray, "vertices 3"]
    triangles: Int[np.ndarray, "triangles 3"]
    colors: Float[np.ndarray, "vertices 3"]
    along: Float[np.ndarray, " vertices"]
    across: Float[np.ndarray, " vertices"]
    masses: Float[np.ndarray, " vertices"]


def join(patches: Sequence[Patch]) -> Patch:
    """One patch with the vertices of all, in order."""
    starts = np.cumsum([0, *(len(patch.vertices) for patch in patches)])
    return Patch(
        vertices=np.concatenate([patch.vertices for patch in patches]),
        triangles=np.concatenate([patch.triangles + start for patch, start in zip(patches, starts[:-1], strict=True)]),
        colors=np.concatenate([patch.colors for patch in patches]),
        along=np.concatenate([patch.along for patch in patches]),
        across=np.concatenate([patch.across for patch in patches]),
        masses=np.concatenate([patch.masses for patch in patches]),
    )


def grid_triangles(rows: int, columns: int, *, closed: bool = False) -> Int[np.ndarray, "triangles 3"]:
    """Triangles of a grid of vertices numbered row by row; `closed` joins the last column to the first."""
    last = columns if closed else columns - 1
    row, column = np.meshgrid(np.arange(rows - 1), np.arange(last), indexing="ij")
    here, right = row * columns + column, row * columns + (column + 1) % columns
    above, diagonal = here + columns, right + columns
    first = np.stack([here, right, diagonal], axis=-1).reshape(-1, 3)
    second = np.stack([here, diagonal, above], axis=-1).reshape(-1, 3)
    return np.concatenate([first, second])


def tube(
    centers: Float[np.ndarray, "rings 3"],
    radii: Float[np.ndarray, " rings"],
    side: Float[np.ndarray, "rings 3"],
    upper: Float[np.ndarray, "rings 3"],
    sides: int,
) -> tuple[Float[np.ndarray, "vertices 3"], Int[np.ndarray, "triangles 3"]]:
    """Rings of `sides` vertices around a centreline; `side` and `upper` are unit vectors across it."""
    angles = 2 * np.pi * np.arange(sides) / sides
    ring = np.cos(angles)[None, :, None] * side[:, None, :] + np.sin(angles)[None, :, None] * upper[:, None, :]
    vertices = centers[:, None, :] + radii[:, None, None] * ring
    return vertices.reshape(-1, 3), grid_triangles(len(centers), sides, closed=True)


def rod_masses(
    centers: Float[np.ndarray, "rings 3"], areas: Float[np.ndarray, " rings"], density: float, sides: int
) -> Float[np.ndarray, " vertices"]:
    """Masses (kg) of a tube's vertices: each ring has half of the pieces beside it. `areas` in m²."""
    pieces = np.linalg.norm(np.diff(centers, axis=0), axis=1) * (areas[1:] + areas[:-1]) / 2
    rings = density * (np.append(pieces, 0.0) + np.append(0.0, pieces)) / 2
    return np.repeat(rings / sides, sides)


def blotches(
    points: Float[np.ndarray, "points 3"], random: np.random.Generator, finest: float = 0.03, coarsest: float = 0.15
) -> Float[np.ndarray, " points"]:
    """A smooth random field in about -1..1 with details between these sizes, metres."""
    waves = random.normal(size=(48, 3))
    waves *= (2 * np.pi / random.uniform(finest, coarsest, size=(48, 1))) / np.linalg.norm(waves, axis=1, keepdims=True)
    phases = random.uniform(0, 2 * np.pi, size=48)
    return np.cos(points @ waves.T + phases).sum(axis=1) / 7.0
