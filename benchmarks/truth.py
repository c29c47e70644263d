"""What a simulation knows of its surface and of its motion, at the places where a reconstruction is asked."""

from collections.abc import Iterable

import numpy as np
import open3d as o3d
from jaxtyping import Bool, Float
from nerfmodal.geometry.cameras import unproject
from nerfmodal.simulate import Plant
from nerfmodal.simulate.excitation import modal_coordinate
from nerfmodal.spec import modes_of
from nerfmodal.types import DisplacementMatrix, Rig
from numpy.polynomial import legendre
from scipy.spatial import cKDTree

from benchmarks.films import Film

TRUTH_DEGREE = 7
"""Of the polynomial through a leaf's true vertices: higher than that of any fit that is compared with it."""


class TrueSurface:
    """The plant's triangles at one instant."""

    def __init__(self, plant: Plant, vertices: Float[np.ndarray, "vertices 3"]) -> None:
        self._scene = o3d.t.geometry.RaycastingScene()
        self._scene.add_triangles(vertices.astype(np.float32), plant.mesh.triangles.astype(np.uint32))

    def distances(self, points: Float[np.ndarray, "points 3"]) -> Float[np.ndarray, " points"]:
        """Distance of each point to the nearest triangle, metres."""
        return np.asarray(self._scene.compute_distance(points.astype(np.float32)).numpy(), dtype=float)

    def seen_by(self, rig: Rig) -> tuple[Float[np.ndarray, "points 3"], Bool[np.ndarray, "cameras height width"]]:
        """Where the centres of all pixels meet the surface, and which pixels do."""
        points, masks = [], []
        for camera in rig.cameras:
            columns, rows = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
            directions = unproject(camera, np.stack([columns, rows], axis=-1).reshape(-1, 2))
            origin = camera.camera_to_world[:3, 3]
            rays = np.hstack([np.broadcast_to(origin, directions.shape), directions]).astype(np.float32)
            distance = self._scene.cast_rays(rays)["t_hit"].numpy().astype(float)
            hit = np.isfinite(distance)
            points.append(origin + distance[hit, None] * directions[hit])
            masks.append(hit.reshape(camera.height, camera.width))
        return np.concatenate(points), np.stack(masks)


def share_covered(surface: Float[np.ndarray, "points 3"], cloud: Float[np.ndarray, "cloud 3"], reach: float) -> float:
    """Part of the surface's points that have a point of the cloud within `reach`."""
    return float(np.mean(cKDTree(cloud).query(surface, distance_upper_bound=reach)[0] <= reach))


def true_displacement(
    film: Film, organ: str, displacement: DisplacementMatrix, indices: Iterable[int]
) -> Float[np.ndarray, "frames sensors"]:
    """What the leaf's sensors should have seen along their normal (eq 11, from the mean over time), metres.

    A smooth surface through the true vertices of every frame, read where the sensors are fixed.
    """
    normal = displacement.directions[0]
    across = _plane(normal)
    sensors = displacement.sensors.positions
    origin = sensors.mean(axis=0)
    belongs = film.plant.belongs(organ)
    scale = 1.3 * np.abs((sensors - origin) @ across.T).max(axis=0)
    heights = []
    for index in indices:
        vertices = film.vertices(index)[belongs] - origin
        flat = vertices @ across.T / scale
        near = np.all(np.abs(flat) <= 1, axis=1)
        fit, *_ = np.linalg.lstsq(_basis(flat[near]), vertices[near] @ normal, rcond=None)
        heights.append(_basis((sensors - origin) @ across.T / scale) @ fit)
    return np.stack(heights) - np.mean(heights, axis=0)


def false_harmonic(film: Film, organ: str, values: Float[np.ndarray, "frames sensors"]) -> float:
    """Motion at twice the first mode's frequency against that at its own, dB, over all sensors of a leaf."""
    modes = modes_of(film.source.motion, organ)
    first = modes[0]
    twice = first.model_copy(update={"frequency_hz": 2 * first.frequency_hz})
    columns = [
        modal_coordinate(mode.model_copy(update={"phase_deg": phase, "amplitude_m": 1.0}), film.times)
        for mode in (first, twice, *modes[1:])
        for phase in (0.0, 90.0)
    ]
    model = np.column_stack([*columns, np.ones(len(film.times))])
    found, *_ = np.linalg.lstsq(model, values, rcond=None)
    return float(20 * np.log10(np.linalg.norm(found[2:4]) / np.linalg.norm(found[0:2])))


def _plane(normal: Float[np.ndarray, " 3"]) -> Float[np.ndarray, "2 3"]:
    return np.linalg.svd(normal[None])[2][1:]


def _basis(flat: Float[np.ndarray, "points 2"]) -> Float[np.ndarray, "points terms"]:
    x, y = (legendre.legvander(flat[:, axis], TRUTH_DEGREE) for axis in range(2))
    return np.column_stack([x[:, i] * y[:, j] for i in range(TRUTH_DEGREE + 1) for j in range(TRUTH_DEGREE + 1 - i)])
