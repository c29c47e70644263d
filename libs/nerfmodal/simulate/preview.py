"""Pictures of a simulated plant by casting rays (Open3D's Embree scene): fast, and the same on every machine.

Shading is Lambert's under one sun, with a shadow ray, plus a sky that is brighter above; the sky is a gradient.
Each pixel is the mean of `samples` rays on a fixed pattern, so pictures have no noise.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, UInt8

from nerfmodal.errors import MissingExtra
from nerfmodal.geometry.cameras import unproject
from nerfmodal.geometry.rays import pixel_centers
from nerfmodal.simulate.light import to_srgb
from nerfmodal.simulate.stage import CHECKER_SIDE, CHECKER_TONES, GROUND_HALF, subpixels
from nerfmodal.types import Camera, Mesh

SUN = np.array([0.45, -0.30, 0.84]) / np.linalg.norm([0.45, -0.30, 0.84])
SUNLIGHT = np.array([1.05, 1.00, 0.90])
ZENITH, HORIZON = np.array([0.18, 0.36, 0.75]), np.array([0.75, 0.82, 0.90])
AMBIENT = 0.45
SHADOW_BIAS = 1e-3
"""Shadow rays start this far (m) off the surface, beyond its own rounding."""


@contextmanager
def open_studio(mesh: Mesh, vertices: Float[np.ndarray, "vertices 3"], seed: int) -> Iterator["PreviewStudio"]:  # noqa: ARG001
    """A studio of `mesh` with its vertices at `vertices` (metres). There is no chance in it: `seed` changes nothing.

    Raises `MissingExtra` without open3d.
    """
    yield PreviewStudio(mesh, vertices)


class PreviewStudio:
    """A ray-cast structure under one sun."""

    def __init__(self, mesh: Mesh, vertices: Float[np.ndarray, "vertices 3"]) -> None:
        self._mesh = mesh
        self._scene = _Scene(mesh, vertices)

    def move(self, vertices: Float[np.ndarray, "vertices 3"]) -> None:
        """Put the vertices there (metres)."""
        self._scene = _Scene(self._mesh, vertices)

    def shoot(self, camera: Camera, samples: int) -> UInt8[np.ndarray, "height width 3"]:
        """What the camera sees; each pixel is the mean of `samples` rays."""
        total = np.zeros((camera.width * camera.height, 3))
        origins = np.tile(camera.camera_to_world[:3, 3], (len(total), 1))
        for offset in subpixels(samples):
            total += self._scene.shade(origins, unproject(camera, pixel_centers(camera) + offset))
        return to_srgb(total / samples).reshape(camera.height, camera.width, 3)


def depth_maps(
    mesh: Mesh, vertices: Float[np.ndarray, "vertices 3"], cameras: tuple[Camera, ...]
) -> Float[np.ndarray, "cameras height width"]:
    """Metres along the optical axis to the plant or the ground behind each pixel's centre, infinite in the sky.

    Raises `MissingExtra`.
    """
    scene = _Scene(mesh, vertices)
    return np.stack([_depths(scene, camera) for camera in cameras])


def _depths(scene: "_Scene", camera: Camera) -> Float[np.ndarray, "height width"]:
    directions = unproject(camera, pixel_centers(camera))
    origins = np.tile(camera.camera_to_world[:3, 3], (len(directions), 1))
    ahead = directions @ -camera.camera_to_world[:3, 2]
    return np.asarray(scene.distances(origins, directions) * ahead).reshape(camera.height, camera.width)


class _Scene:
    """The plant in Embree's tree; the ground and the sky are formulas."""

    def __init__(self, mesh: Mesh, vertices: Float[np.ndarray, "vertices 3"]) -> None:
        self._o3d = _import_open3d()
        self._triangles, self._colors = mesh.triangles, mesh.colors
        self._normals = vertex_normals(vertices, mesh.triangles)
        self._tree = self._o3d.t.geometry.RaycastingScene(nthreads=1)
        self._tree.add_triangles(
            self._o3d.core.Tensor(vertices.astype(np.float32)), self._o3d.core.Tensor(mesh.triangles.astype(np.uint32))
        )

    def shade(
        self, origins: Float[np.ndarray, "rays 3"], directions: Float[np.ndarray, "rays 3"]
    ) -> Float[np.ndarray, "rays 3"]:
        """Linear colours that the rays see."""
        hit = self._cast(origins, directions)
        plant_depth = hit["t_hit"].numpy().astype(float)
        on_ground, ground_depth = _meet_ground(origins, directions)
        ground_first = on_ground & (ground_depth < plant_depth)
        plant_first = np.isfinite(plant_depth) & ~ground_first
        colors = _sky(directions)
        spots = origins[ground_first] + directions[ground_first] * ground_depth[ground_first, None]
        up = np.tile([0.0, 0.0, 1.0], (len(spots), 1))
        colors[ground_first] = _checker(spots)[:, None] * self._light(spots, up)
        faces, uv = hit["primitive_ids"].numpy()[plant_first], hit["primitive_uvs"].numpy()[plant_first]
        weights = np.column_stack([1 - uv.sum(axis=1), uv]).astype(float)[:, :, None]
        corners = self._triangles[faces]
        normals = (self._normals[corners] * weights).sum(axis=1)
        seen = directions[plant_first]
        normals *= -np.sign((normals * seen).sum(axis=1, keepdims=True))
        spots = origins[plant_first] + seen * plant_depth[plant_first, None]
        colors[plant_first] = (self._colors[corners] * weights).sum(axis=1) * self._light(spots, normals)
        return colors

    def distances(
        self, origins: Float[np.ndarray, "rays 3"], directions: Float[np.ndarray, "rays 3"]
    ) -> Float[np.ndarray, " rays"]:
        """Metres to the plant or the ground, infinite where rays meet neither."""
        plant = self._cast(origins, directions)["t_hit"].numpy().astype(float)
        on_ground, ground = _meet_ground(origins, directions)
        return np.minimum(plant, np.where(on_ground, ground, np.inf))

    def _light(
        self, spots: Float[np.ndarray, "rays 3"], normals: Float[np.ndarray, "rays 3"]
    ) -> Float[np.ndarray, "rays 3"]:
        """Light that surface spots receive: the sky's half above them and the sun where nothing stands before it."""
        facing = np.maximum(normals @ SUN, 0.0)
        towards = np.tile(SUN, (len(spots), 1))
        blocked = np.isfinite(self._cast(spots + SHADOW_BIAS * normals, towards)["t_hit"].numpy())
        sky = AMBIENT * (0.75 + 0.25 * normals[:, 2])
        return np.asarray(sky[:, None] + (facing * ~blocked)[:, None] * SUNLIGHT)

    def _cast(self, origins: Float[np.ndarray, "rays 3"], directions: Float[np.ndarray, "rays 3"]) -> Any:
        rays = np.concatenate([origins, directions], axis=1).astype(np.float32)
        return self._tree.cast_rays(self._o3d.core.Tensor(rays), nthreads=1)


def vertex_normals(vertices: Float[np.ndarray, "vertices 3"], triangles: Any) -> Float[np.ndarray, "vertices 3"]:
    """Unit normals of vertices, the mean of their triangles' weighted by area."""
    a, b, c = (vertices[triangles[:, corner]] for corner in range(3))
    faces = np.cross(b - a, c - a)
    sums = np.zeros_like(vertices)
    for corner in range(3):
        np.add.at(sums, triangles[:, corner], faces)
    return np.asarray(sums / np.maximum(np.linalg.norm(sums, axis=1, keepdims=True), 1e-12))


def _meet_ground(
    origins: Float[np.ndarray, "rays 3"], directions: Float[np.ndarray, "rays 3"]
) -> tuple[Bool[np.ndarray, " rays"], Float[np.ndarray, " rays"]]:
    """Which rays meet the ground's square, and how far away."""
    down = directions[:, 2] < -1e-9
    depth = np.where(down, -origins[:, 2] / np.where(down, directions[:, 2], -1.0), np.inf)
    reach = np.where(down, depth, 0.0)[:, None]
    return down & np.all(np.abs(origins + directions * reach)[:, :2] < GROUND_HALF, axis=1), depth


def _checker(spots: Float[np.ndarray, "rays 3"]) -> Float[np.ndarray, " rays"]:
    squares = np.floor(spots[:, :2] / CHECKER_SIDE).astype(int).sum(axis=1)
    return np.asarray(CHECKER_TONES)[squares % 2]


def _sky(directions: Float[np.ndarray, "rays 3"]) -> Float[np.ndarray, "rays 3"]:
    height = np.clip(directions[:, 2:], 0.0, 1.0) ** 0.6
    return (1 - height) * HORIZON + height * ZENITH


def _import_open3d() -> Any:
    try:
        import open3d
    except ImportError as missing:
        raise MissingExtra("open3d-cpu", "vision") from missing
    return open3d
