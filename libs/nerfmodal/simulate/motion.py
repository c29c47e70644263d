"""Imposed modes: what the simulated plant does, and so the truth that identification is compared with.

Every organ moves in its own modes (see `shapes`, `kinematics`), each with a coordinate of its own (see `excitation`).
Uncoupled, organs stand on a ground that stands still, as in the paper; coupled, they ride on what they grow from.
"""

import math
from collections.abc import Callable, Iterator

import numpy as np
from jaxtyping import Float

from nerfmodal.simulate.excitation import coordinate_of, largest_swing
from nerfmodal.simulate.kinematics import Places, Sway, bent, bent_vertices, shifted, turned
from nerfmodal.simulate.plants import Organ, Plant, along_line
from nerfmodal.simulate.refusals import check_organs
from nerfmodal.simulate.structures import plant_of
from nerfmodal.spec import ImposedMode, SimulationSource, modes_of
from nerfmodal.types import TrueMode


def frame_times(source: SimulationSource) -> Float[np.ndarray, " frames"]:
    """Instants of all frames, seconds."""
    return np.arange(source.frames) / source.frame_rate_hz


def true_modes(source: SimulationSource, times: Float[np.ndarray, " times"]) -> tuple[TrueMode, ...]:
    """Every mode of every organ at all of its vertices: its own, and those of what it rides on.

    Of a rotation, shapes are those of a small motion. Raises `InvalidSpec` where a mode's organ matches none.
    """
    plant = plant_of(source)
    check_organs(source, plant)
    return tuple(mode for organ in plant.organs for mode in _modes_on(source, plant, organ, times))


def vertices_at(plant: Plant, source: SimulationSource, time: float) -> Float[np.ndarray, "vertices 3"]:
    """Positions of all vertices of the plant at `time` seconds, metres."""
    moved = plant.mesh.vertices.copy()
    now = np.array([time])
    if source.kinematics == "rotation":
        for organ in plant.organs:
            moved[plant.belongs(organ.name)] = _rotated(source, plant, organ, now)
        return moved
    for mode in true_modes(source, now):
        moved[plant.belongs(mode.organ)] += mode.shape * mode.coordinates[0]
    return moved


def reach(source: SimulationSource, organ: str) -> float:
    """How far (m) a point of the organ may go: its own modes and those of what it rides on, all at once."""
    plant = plant_of(source)
    chosen = plant.organ(organ)
    far = math.fsum(largest_swing(mode, source.excitation) for mode in modes_of(source.motion, organ))
    points = plant.mesh.vertices[plant.belongs(organ)]
    for parent, at in carriers(source, plant, chosen):
        for mode, sway in sways(source, plant, parent):
            moved = np.linalg.norm(carried(points, parent, sway, at), axis=1).max()
            far += float(moved) * largest_swing(mode, source.excitation)
    return far


def shape_at(
    source: SimulationSource, organ: str, points: Float[np.ndarray, "points 3"]
) -> tuple[Float[np.ndarray, "points 3"], ...]:
    """The shapes of the organ's own modes, in the order of `motion`, at any `points` of its surface.

    Points are at rest (world, metres). Scaled as `true_modes` are: the largest displacement of a vertex is 1.
    """
    plant = plant_of(source)
    chosen = plant.organ(organ)
    s, y = chosen.locate(points)
    places = Places(points=points, s=s, y=y)
    sway = _sway(source)
    return tuple(sway(plant, chosen, mode, places).points for mode in modes_of(source.motion, organ))


def modal_masses(source: SimulationSource) -> Float[np.ndarray, " modes"]:
    """Kilograms that move in each of `true_modes` where the largest displacement is 1: the sum of m |shape|²."""
    plant = plant_of(source)
    return np.array(
        [
            plant.masses[plant.belongs(mode.organ)] @ (mode.shape**2).sum(axis=1)
            for mode in true_modes(source, np.zeros(1))
        ]
    )


def sways(source: SimulationSource, plant: Plant, organ: Organ) -> Iterator[tuple[ImposedMode, Sway]]:
    """The organ's own modes and what they do."""
    sway = _sway(source)
    for mode in modes_of(source.motion, organ.name):
        yield mode, sway(plant, organ, mode, None)


def _sway(source: SimulationSource) -> Callable[[Plant, Organ, ImposedMode, Places | None], Sway]:
    return turned if source.kinematics == "rotation" else shifted


def carriers(source: SimulationSource, plant: Plant, organ: Organ) -> Iterator[tuple[Organ, float]]:
    """What the organ rides on, nearest first, and where along it; nothing unless the source is coupled."""
    while source.coupled and organ.parent is not None:
        parent = plant.organ(organ.parent)
        yield parent, organ.at
        organ = parent


def _modes_on(
    source: SimulationSource, plant: Plant, organ: Organ, times: Float[np.ndarray, " times"]
) -> Iterator[TrueMode]:
    points = plant.mesh.vertices[plant.belongs(organ.name)]
    for mode, sway in sways(source, plant, organ):
        yield _true_mode(
            organ.name, mode.shape, mode, points, sway.points, coordinate_of(source, organ.name, mode, times)
        )
    for parent, at in carriers(source, plant, organ):
        for mode, sway in sways(source, plant, parent):
            shape = carried(points, parent, sway, at)
            coordinate = coordinate_of(source, parent.name, mode, times)
            yield _true_mode(organ.name, f"{parent.name} {mode.shape}", mode, points, shape, coordinate)


def carried(
    points: Float[np.ndarray, "points 3"], parent: Organ, sway: Sway, at: float
) -> Float[np.ndarray, "points 3"]:
    """Displacement of points that ride on `parent` at s = `at`, for a metre of its coordinate and a small motion."""
    place = np.array([at])
    arms = points - along_line(parent.line, place)
    return along_line(sway.shifts, place) + np.cross(along_line(sway.turns, place), arms)


def _true_mode(
    organ: str,
    name: str,
    mode: ImposedMode,
    points: Float[np.ndarray, "points 3"],
    shape: Float[np.ndarray, "points 3"],
    coordinates: Float[np.ndarray, " times"],
) -> TrueMode:
    size = np.linalg.norm(shape, axis=1).max()
    return TrueMode(
        organ=organ,
        name=name,
        frequency=mode.frequency_hz,
        damping_ratio=mode.damping_ratio,
        points=points,
        shape=shape / size,
        coordinates=coordinates * size,
    )


def _rotated(
    source: SimulationSource, plant: Plant, organ: Organ, now: Float[np.ndarray, " one"]
) -> Float[np.ndarray, "vertices 3"]:
    """The organ's vertices, bent by itself, then carried by what it rides on."""
    points = bent_vertices(plant, organ, bent(organ, _turns(source, plant, organ, now)))
    for parent, at in carriers(source, plant, organ):
        points = bent(parent, _turns(source, plant, parent, now)).carry(points, parent.line, at)
    return points


def _turns(
    source: SimulationSource, plant: Plant, organ: Organ, now: Float[np.ndarray, " one"]
) -> Float[np.ndarray, "stations 3"]:
    """Rotation vectors of the organ's sections: those of its modes add up."""
    turns = np.zeros_like(organ.line)
    for mode, sway in sways(source, plant, organ):
        turns += sway.turns * coordinate_of(source, organ.name, mode, now)[0]
    return turns
