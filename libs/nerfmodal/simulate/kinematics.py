"""How an organ moves in one mode: a shift and a turn of its cross-sections for every metre of modal coordinate.

`linear`: all points are shifted along one direction, whatever the size of the motion (the paper's z offset).
`rotation`: sections of a slender member turn by the slope of the bending and stay plane, its centreline keeps its
length exactly: x(p) = C'(s) + R(s) (p - C(s)), C'(s) = C(0) + ∫ R(s) dC. To first order both bend alike; a large swing
of the second draws the tip in, which has twice the frequency.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from nerfmodal.simulate.plants import Organ, Plant, along_line
from nerfmodal.simulate.plates import cantilever_plate
from nerfmodal.simulate.shapes import cantilever_shape, cantilever_slope, shaft_twist
from nerfmodal.spec import ImposedMode


@dataclass(frozen=True, slots=True, kw_only=True)
class Sway:
    """What one metre of a mode's coordinate does, to first order.

    `points` are displacements where it was asked; the largest of the organ's vertices is of length 1. `shifts` (m) and
    `turns` (rotation vectors, radians) are those of the sections at the stations of its centreline.
    """

    points: Float[np.ndarray, "vertices 3"]
    shifts: Float[np.ndarray, "stations 3"]
    turns: Float[np.ndarray, "stations 3"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Places:
    """Points of an organ's surface at rest (world, metres) and their organ coordinates: s along, y metres across."""

    points: Float[np.ndarray, "points 3"]
    s: Float[np.ndarray, " points"]
    y: Float[np.ndarray, " points"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Sections:
    """Where an organ's centreline is and how its sections are turned (rotation vectors, radians)."""

    line: Float[np.ndarray, "stations 3"]
    turns: Float[np.ndarray, "stations 3"]

    def carry(
        self, points: Float[np.ndarray, "points 3"], rest: Float[np.ndarray, "stations 3"], at: float
    ) -> Float[np.ndarray, "points 3"]:
        """Points that ride on the section at s = `at`, whose centreline at rest is `rest`."""
        place = np.array([at])
        turn = Rotation.from_rotvec(along_line(self.turns, place)[0])
        return turn.apply(points - along_line(rest, place)) + along_line(self.line, place)


def direction_of(organ: Organ, mode: ImposedMode) -> Float[np.ndarray, " 3"]:
    """Unit vector (world) that a positive coordinate moves along."""
    direction = np.asarray(mode.direction or organ.direction, dtype=float)
    return direction / np.linalg.norm(direction)


def shifted(plant: Plant, organ: Organ, mode: ImposedMode, points: Places | None = None) -> Sway:
    """Linear kinematics: the shape times one direction; riders turn with the slope.

    At the organ's vertices, or at other `points` of its surface.
    """
    own = _own(plant, organ)
    places, direction = points or own, direction_of(organ, mode)
    stations, order = np.linspace(0, 1, len(organ.line)), int(mode.shape[-1])
    middle, turns = np.zeros(len(stations)), np.zeros_like(organ.line)
    if mode.shape.startswith("bending"):
        shape, middle = cantilever_shape(places.s, order), cantilever_shape(stations, order)
        turns = np.outer(cantilever_slope(stations, order) / organ.length, np.cross(organ.chord, direction))
    elif mode.shape.startswith("torsion"):
        largest = np.abs(own.y * shaft_twist(own.s, order)).max()
        shape = places.y * shaft_twist(places.s, order) / largest
        turns = np.outer(shaft_twist(stations, order) / largest, organ.chord)
    else:
        half = np.abs(own.y).max()
        shape = cantilever_plate(round(2 * half / organ.length, 9)).shape(places.s, places.y / half, order)
    return Sway(points=np.outer(shape, direction), shifts=np.outer(middle, direction), turns=turns)


def turned(plant: Plant, organ: Organ, mode: ImposedMode, points: Places | None = None) -> Sway:
    """Rotation to first order: sections turn about the axis across the member and the direction, or about itself.

    At the organ's vertices, or at other `points` of its surface.
    """
    stations, order = np.linspace(0, 1, len(organ.line)), int(mode.shape[-1])
    if mode.shape.startswith("torsion"):
        turns = shaft_twist(stations, order)[:, None] * organ.tangents
    else:
        axis = np.cross(organ.chord, direction_of(organ, mode))
        turns = np.outer(cantilever_slope(stations, order) / organ.length, axis / np.linalg.norm(axis))
    steps = np.cross((turns[1:] + turns[:-1]) / 2, np.diff(organ.line, axis=0))
    shifts = np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])

    def moved(places: Places) -> Float[np.ndarray, "points 3"]:
        arms = places.points - along_line(organ.line, places.s)
        return along_line(shifts, places.s) + np.cross(along_line(turns, places.s), arms)

    own = _own(plant, organ)
    size = np.linalg.norm(moved(own), axis=1).max()
    return Sway(points=moved(points or own) / size, shifts=shifts / size, turns=turns / size)


def _own(plant: Plant, organ: Organ) -> Places:
    belongs = plant.belongs(organ.name)
    return Places(points=plant.mesh.vertices[belongs], s=plant.along[belongs], y=plant.across[belongs])


def bent(organ: Organ, turns: Float[np.ndarray, "stations 3"]) -> Sections:
    """The centreline whose sections are turned so: every piece keeps its length."""
    middle = Rotation.from_rotvec((turns[1:] + turns[:-1]) / 2)
    pieces = middle.apply(np.diff(organ.line, axis=0))
    line = organ.line[0] + np.concatenate([np.zeros((1, 3)), np.cumsum(pieces, axis=0)])
    return Sections(line=line, turns=turns)


def bent_vertices(plant: Plant, organ: Organ, sections: Sections) -> Float[np.ndarray, "vertices 3"]:
    """The organ's vertices on its turned sections, which stay plane."""
    belongs = plant.belongs(organ.name)
    s = plant.along[belongs]
    off = plant.mesh.vertices[belongs] - along_line(organ.line, s)
    return along_line(sections.line, s) + Rotation.from_rotvec(along_line(sections.turns, s)).apply(off)
