"""Plants and structures as numbers: triangles, colours, organs, and where each vertex lies on its organ. No Blender.

The structures themselves stand in `palm`, `herb`, `tree` and `beams`; `structures` knows them by name.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial import cKDTree

from nerfmodal.geometry.frames import frame_of_box
from nerfmodal.simulate.patches import Patch, join
from nerfmodal.spec import Box, OrientedBox
from nerfmodal.types import Mesh

OrganKind = Literal["leaf", "stem", "branch", "plate"]
STATIONS = 101
"""Points of a centreline."""
MOTION_ROOM = 0.08
"""How far (m) an organ may swing and still lie in its region."""
EDGE_ROOM = 0.02
"""Further room (m) of a region, for the thickness of a reconstructed surface."""
GROUND_ROOM = 0.02
"""The regions begin this high (m), so that the ground is in none of them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Organ:
    """A part of a structure that has modes of its own, and the box its points stay in.

    `line` is its centreline at rest, from the fixed end to the tip at equal steps of s, `side` the unit vector across
    it that +y points along; `parent` is what it grows from, at s = `at` there; `direction` is along which it moves
    where a mode does not say.
    """

    name: str
    kind: OrganKind
    region: OrientedBox
    line: Float[np.ndarray, "stations 3"]
    side: Float[np.ndarray, " 3"]
    parent: str | None = None
    at: float = 1.0
    direction: tuple[float, float, float] = (0.0, 0.0, 1.0)

    @property
    def length(self) -> float:
        """Length of the centreline, metres."""
        return float(np.linalg.norm(np.diff(self.line, axis=0), axis=1).sum())

    @property
    def chord(self) -> Float[np.ndarray, " 3"]:
        """Unit vector from the fixed end to the tip."""
        ends = self.line[-1] - self.line[0]
        return np.asarray(ends / np.linalg.norm(ends))

    @property
    def tangents(self) -> Float[np.ndarray, "stations 3"]:
        """Unit vectors along the centreline."""
        steps = np.gradient(self.line, axis=0)
        return np.asarray(steps / np.linalg.norm(steps, axis=1, keepdims=True))

    def locate(
        self, points: Float[np.ndarray, "points 3"]
    ) -> tuple[Float[np.ndarray, " points"], Float[np.ndarray, " points"]]:
        """Organ coordinates of points on its surface (world, metres): s along and y across in metres."""
        nearest = np.asarray(cKDTree(self.line).query(points)[1])
        ahead = ((points - self.line[nearest]) * self.tangents[nearest]).sum(axis=1)
        s = np.clip(nearest / (len(self.line) - 1) + ahead / self.length, 0.0, 1.0)
        return s, (points - along_line(self.line, s)) @ self.side


def along_line(
    values: Float[np.ndarray, "stations 3"], s: Float[np.ndarray, " points"]
) -> Float[np.ndarray, "points 3"]:
    """Values at equal steps of s in 0..1, at any s between."""
    stations = np.linspace(0, 1, len(values))
    return np.stack([np.interp(s, stations, values[:, axis]) for axis in range(3)], axis=1)


@dataclass(frozen=True, slots=True, kw_only=True)
class Plant:
    """A structure at rest. `along` is s in 0..1 from an organ's fixed end, `across` metres off its axis.

    `masses` (kg) are lumped at the vertices. A part that never moves is in the mesh alone, not in `organs`.
    """

    mesh: Mesh
    along: Float[np.ndarray, " vertices"]
    across: Float[np.ndarray, " vertices"]
    masses: Float[np.ndarray, " vertices"]
    organs: tuple[Organ, ...]
    region: Box

    @property
    def regions(self) -> dict[str, OrientedBox]:
        """The region of each organ by its name."""
        return {organ.name: organ.region for organ in self.organs}

    def organ(self, name: str) -> Organ:
        """The organ of this name."""
        return next(organ for organ in self.organs if organ.name == name)

    def belongs(self, organ: str) -> Bool[np.ndarray, " vertices"]:
        """Which vertices are the organ's."""
        return self.mesh.organ == self.mesh.organs.index(organ)


def assemble(patches: Sequence[Patch], organs: tuple[Organ, ...], stand: Patch | None = None) -> Plant:
    """One plant of a patch for each organ, and of a stand that never moves."""
    parts = [*patches, *([] if stand is None else [stand])]
    whole = join(parts)
    mesh = Mesh(
        vertices=whole.vertices,
        triangles=whole.triangles,
        colors=whole.colors,
        organ=np.repeat(np.arange(len(parts)), [len(patch.vertices) for patch in parts]),
        organs=(*(organ.name for organ in organs), *([] if stand is None else ["stand"])),
    )
    low = whole.vertices.min(axis=0) - MOTION_ROOM - EDGE_ROOM
    high = whole.vertices.max(axis=0) + MOTION_ROOM + EDGE_ROOM
    low[2] = GROUND_ROOM
    region = Box(min_m=point(low), max_m=point(high))
    return Plant(mesh=mesh, along=whole.along, across=whole.across, masses=whole.masses, organs=organs, region=region)


def flat_region(outer: Float[np.ndarray, "points 3"], yaw: float, room: float = MOTION_ROOM) -> OrientedBox:
    """A box along a leaf's or a branch's chord with room (m) for its motion up and down; `yaw` in radians.

    `outer` are its points where neither a neighbour nor the stem touches it.
    """
    outward = np.array([np.cos(yaw), np.sin(yaw), 0.0])
    slope = np.polyfit(outer @ outward, outer[:, 2], 1)[0]
    tilted = OrientedBox(
        center_m=(0.0, 0.0, 0.0),
        size_m=(1.0, 1.0, 1.0),
        yaw_deg=float(np.degrees(yaw)),
        pitch_deg=float(np.degrees(np.arctan(slope))),
    )
    frame = frame_of_box(tilted)
    local = frame.to_local(outer)
    margin = np.array([0.04, 0.02, room + EDGE_ROOM])
    low, high = local.min(axis=0) - margin * np.array([0, 1, 1]), local.max(axis=0) + margin
    center = frame.to_world((low + high)[None] / 2)[0]
    return tilted.model_copy(update={"center_m": point(center), "size_m": point(high - low)})


def upright_region(stem: Patch, top: float, room: float = MOTION_ROOM) -> OrientedBox:
    """An upright box around a stem, x axis along it, from just above the ground to `top` (m)."""
    low, high = stem.vertices.min(axis=0) - room, stem.vertices.max(axis=0) + room
    center = np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, (GROUND_ROOM + top) / 2])
    size = np.array([top - GROUND_ROOM, high[1] - low[1], high[0] - low[0]])
    return OrientedBox(center_m=point(center), size_m=point(size), yaw_deg=0.0, pitch_deg=90.0)


def point(values: Float[np.ndarray, " 3"]) -> tuple[float, float, float]:
    """Coordinates to a tenth of a millimetre, as a specification holds them."""
    return (round(float(values[0]), 4), round(float(values[1]), 4), round(float(values[2]), 4))
