"""Imposed modes: what the simulated plant does, and so the truth that identification is compared with.

Shapes live on organ coordinates (s along, y across); a modal coordinate is a free decay of an underdamped
oscillator, q(t) = A exp(-zeta w t) cos(w sqrt(1 - zeta^2) t + phase). Kinematics are linear: x(t) = x0 + sum shape q.
Leaves do not ride on the stem (the paper imposes them independently).
"""

import numpy as np
from jaxtyping import Float

from nerfmodal.errors import InvalidSpec
from nerfmodal.simulate.plants import OrganKind, Plant, acai
from nerfmodal.spec import ImposedMode, SimulationSource, modes_of
from nerfmodal.types import TrueMode

BEAM_ROOTS = (1.8751040687119611, 4.694091132974175)
"""Roots of cos(b) cosh(b) = -1: the clamped-free beam's eigenvalues."""
DEFAULT_DIRECTIONS: dict[OrganKind, tuple[float, float, float]] = {"leaf": (0.0, 0.0, 1.0), "stem": (1.0, 0.0, 0.0)}


def plant_of(source: SimulationSource) -> Plant:
    """The structure that the source films, at rest."""
    return {"acai": acai}[source.structure]()


def frame_times(source: SimulationSource) -> Float[np.ndarray, " frames"]:
    """Instants of all frames, seconds."""
    return np.arange(source.frames) / source.frame_rate_hz


def cantilever_shape(s: Float[np.ndarray, " points"], order: int) -> Float[np.ndarray, " points"]:
    """Bending shape `order` (1 or 2) of a clamped-free uniform beam, 1 at its tip s = 1."""
    b = BEAM_ROOTS[order - 1]
    ratio = (np.cosh(b) + np.cos(b)) / (np.sinh(b) + np.sin(b))

    def raw(x: Float[np.ndarray, " points"]) -> Float[np.ndarray, " points"]:
        return np.cosh(b * x) - np.cos(b * x) - ratio * (np.sinh(b * x) - np.sin(b * x))

    return raw(s) / raw(np.ones(1))[0]


def torsion_shape(s: Float[np.ndarray, " points"], y: Float[np.ndarray, " points"]) -> Float[np.ndarray, " points"]:
    """First torsion of a clamped-free strip, y sin(pi s / 2), with its largest absolute value 1."""
    raw = y * np.sin(np.pi * s / 2)
    return raw / np.abs(raw).max()


def modal_coordinate(mode: ImposedMode, times: Float[np.ndarray, " times"]) -> Float[np.ndarray, " times"]:
    """Free decay of the mode, metres, from t = 0."""
    w, zeta = 2 * np.pi * mode.frequency_hz, mode.damping_ratio
    phase = np.radians(mode.phase_deg)
    return mode.amplitude_m * np.exp(-zeta * w * times) * np.cos(w * np.sqrt(1 - zeta**2) * times + phase)


def true_modes(source: SimulationSource, times: Float[np.ndarray, " times"]) -> tuple[TrueMode, ...]:
    """Every imposed mode of every organ it matches, at all vertices of the organ.

    Raises `InvalidSpec` where a mode's organ matches none.
    """
    plant = plant_of(source)
    check_organs(source, plant)
    return tuple(
        _true_mode(plant, organ.name, organ.kind, mode, times)
        for organ in plant.organs
        for mode in modes_of(source.motion, organ.name)
    )


def vertices_at(plant: Plant, source: SimulationSource, time: float) -> Float[np.ndarray, "vertices 3"]:
    """Positions of all vertices of the plant at `time` seconds, metres."""
    moved = plant.mesh.vertices.copy()
    for mode in true_modes(source, np.array([time])):
        moved[plant.belongs(mode.organ)] += mode.shape * mode.coordinates[0]
    return moved


def check_organs(source: SimulationSource, plant: Plant) -> None:
    """Refuse a mode whose organ matches nothing. Raises `InvalidSpec`."""
    names = [organ.name for organ in plant.organs]
    for index, mode in enumerate(source.motion):
        if not any(modes_of((mode,), name) for name in names):
            raise InvalidSpec(
                f"'{mode.organ}' matches no organ of '{source.structure}'.",
                where=f"/source/motion/{index}/organ",
                hint=f"Its organs are {', '.join(names)}; a glob such as 'leaf_*' names several.",
            )


def _true_mode(
    plant: Plant, organ: str, kind: OrganKind, mode: ImposedMode, times: Float[np.ndarray, " times"]
) -> TrueMode:
    belongs = plant.belongs(organ)
    direction = np.asarray(mode.direction or DEFAULT_DIRECTIONS[kind], dtype=float)
    size = np.linalg.norm(direction)
    shape = _shape(mode, plant.along[belongs], plant.across[belongs])
    return TrueMode(
        organ=organ,
        name=mode.shape,
        frequency=mode.frequency_hz,
        damping_ratio=mode.damping_ratio,
        points=plant.mesh.vertices[belongs],
        shape=shape[:, None] * direction / size,
        coordinates=modal_coordinate(mode, times),
    )


def _shape(
    mode: ImposedMode, s: Float[np.ndarray, " points"], y: Float[np.ndarray, " points"]
) -> Float[np.ndarray, " points"]:
    if mode.shape == "torsion_1":
        return torsion_shape(s, y)
    return cantilever_shape(s, 1 if mode.shape == "bending_1" else 2)
