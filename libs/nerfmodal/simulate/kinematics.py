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

from nerfmodal.simulate.plants import Organ, Plant
from nerfmodal.simulate.plates import cantilever_plate
from nerfmodal.simulate.shapes import cantilever_shape, cantilever_slope, shaft_twist, torsion_shape
from nerfmodal.spec import ImposedMode


@dataclass(frozen=True, slots=True, kw_only=True)
class Sway:
    """What one metre of a mode's coordinate does, to first order.

    `points` are displacements of the organ's vertices, the largest of length 1; `shifts` (m) and `turns` (rotation
    vectors, radians) are those of the sections at the stations of its centreline.
    """

    points: Float[np.ndarray, "vertices 3"]
    shifts: Float[np.ndarray, "stations 3"]
    turns: Float[np.ndarray, "stations 3"]


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


def along_line(
    values: Float[np.ndarray, "stations 3"], s: Float[np.ndarray, " points"]
) -> Float[np.ndarray, "points 3"]:
    """Values at equal steps of s in 0..1, at any s between."""
    stations = np.linspace(0, 1, len(values))
    return np.stack([np.interp(s, stations, values[:, axis]) for axis in range(3)], axis=1)


def direction_of(organ: Organ, mode: ImposedMode) -> Float[np.ndarray, " 3"]:
    """Unit vector (world) that a positive coordinate moves along."""
    direction = np.asarray(mode.direction or organ.direction, dtype=float)
    return direction / np.linalg.norm(direction)


def shifted(plant: Plant, organ: Organ, mode: ImposedMode) -> Sway:
    """Linear kinematics: the shape times one direction; riders turn with the slope."""
    belongs, direction = plant.belongs(organ.name), direction_of(organ, mode)
    s, y = plant.along[belongs], plant.across[belongs]
    stations, order = np.linspace(0, 1, len(organ.line)), int(mode.shape[-1])
    middle = np.zeros(len(stations))
    turns = np.zeros_like(organ.line)
    if mode.shape.startswith("bending"):
        shape, middle = cantilever_shape(s, order), cantilever_shape(stations, order)
        turns = np.outer(cantilever_slope(stations, order) / organ.length, np.cross(organ.chord, direction))
    elif mode.shape.startswith("torsion"):
        shape = torsion_shape(s, y, order)
        turns = np.outer(shaft_twist(stations, order) / np.abs(y).max(), organ.chord)
    else:
        half = np.abs(y).max()
        plate = cantilever_plate(round(2 * half / organ.length, 9))
        shape = plate.shape(s, y / half, order)
        turns = np.outer(np.gradient(plate.shape(stations, np.ones_like(stations), order), stations), organ.chord)
        turns /= organ.length
    return Sway(points=np.outer(shape, direction), shifts=np.outer(middle, direction), turns=turns)


def turned(plant: Plant, organ: Organ, mode: ImposedMode) -> Sway:
    """Rotation to first order: sections turn about the axis across the member and the direction, or about itself."""
    belongs = plant.belongs(organ.name)
    s, vertices = plant.along[belongs], plant.mesh.vertices[belongs]
    stations, order = np.linspace(0, 1, len(organ.line)), int(mode.shape[-1])
    if mode.shape.startswith("torsion"):
        turns = shaft_twist(stations, order)[:, None] * organ.tangents
    else:
        axis = np.cross(organ.chord, direction_of(organ, mode))
        turns = np.outer(cantilever_slope(stations, order) / organ.length, axis / np.linalg.norm(axis))
    steps = np.cross((turns[1:] + turns[:-1]) / 2, np.diff(organ.line, axis=0))
    shifts = np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])
    points = along_line(shifts, s) + np.cross(along_line(turns, s), vertices - along_line(organ.line, s))
    size = np.linalg.norm(points, axis=1).max()
    return Sway(points=points / size, shifts=shifts / size, turns=turns / size)


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
