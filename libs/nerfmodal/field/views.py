"""Pictures and rays in the form that the grid's kernels read.

Any lens becomes a table of undistorted image points every few pixels; between them it is interpolated linearly.
"""

from dataclasses import dataclass
from typing import no_type_check

import numba
import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from nerfmodal.field.marching import ray_of
from nerfmodal.geometry.cameras import focus_of, undistort
from nerfmodal.types import Camera, Frame, Rig

CELL = 8
"""Pixels between two entries of the table: a lens bends by less than 0.02 pixels over them, a fisheye by more."""

NEAR = 0.3
"""Share of a camera's distance to what the rig looks at within which nothing stands."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Views:
    """What the kernels know of a frame: `table` of image points, poses (camera to world) and pictures."""

    table: Float[np.ndarray, "cameras rows columns 2"]
    poses: Float[np.ndarray, "cameras 4 4"]
    nears: Float[np.ndarray, " cameras"]
    """Distance (m) before which nothing is expected: a grain of fog before a lens would explain its picture alone."""
    images: UInt8[np.ndarray, "cameras height width 3"]
    counts: Bool[np.ndarray, "cameras height width"] | None = None
    """Pixels that say something; None: all."""

    @property
    def pixels(self) -> int:
        """Pixels of all pictures together."""
        return int(np.prod(self.images.shape[:3]))

    def drawn(self, rays: int, rng: np.random.Generator) -> Int[np.ndarray, " rays"]:
        """Flat numbers of pixels anywhere, of those that count."""
        if self.counts is None:
            return rng.integers(0, self.pixels, rays)
        return _some_of(self.counts, rays, rng)

    def pixels_of(self, camera: int) -> Int[np.ndarray, "pixels 3"]:
        """All pixels (camera, row, column) of one camera."""
        each = int(np.prod(self.images.shape[1:3]))
        return pixels_at(np.arange(camera * each, (camera + 1) * each), self.images.shape)


def views_of(frame: Frame) -> Views:
    """The views of a frame."""
    return Views(
        table=np.stack([_table(camera) for camera in frame.rig.cameras]),
        poses=poses_of(frame.rig),
        nears=NEAR * np.linalg.norm(poses_of(frame.rig)[:, :3, 3] - focus_of(frame.rig)[0], axis=1),
        images=np.ascontiguousarray(frame.images),
        counts=frame.counts,
    )


def _some_of(
    counts: Bool[np.ndarray, "cameras height width"], rays: int, rng: np.random.Generator
) -> Int[np.ndarray, " rays"]:
    """Pixels that count, each as likely as any other: drawn from all, again until all that were drawn count."""
    flat = counts.reshape(-1)
    if not flat.any():
        return rng.integers(0, flat.size, rays)
    drawn = rng.integers(0, flat.size, rays)
    while not flat[drawn].all():
        wrong = np.flatnonzero(~flat[drawn])
        drawn[wrong] = rng.integers(0, flat.size, len(wrong))
    return drawn


def poses_of(rig: Rig) -> Float[np.ndarray, "cameras 4 4"]:
    """Camera-to-world matrices."""
    return np.stack([camera.camera_to_world for camera in rig.cameras])


def _table(camera: Camera) -> Float[np.ndarray, "rows columns 2"]:
    rows, columns = -(-camera.height // CELL) + 1, -(-camera.width // CELL) + 1
    grid = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1).reshape(-1, 2) * float(CELL)
    center, focal = np.array([camera.center_x, camera.center_y]), np.array([camera.focal_x, camera.focal_y])
    return undistort(camera, (grid - center) / focal).reshape(rows, columns, 2)


def pixels_at(flat: Int[np.ndarray, " rays"], shape: tuple[int, ...]) -> Int[np.ndarray, "rays 3"]:
    """(camera, row, column) of flat pixel numbers in pictures of `shape` (cameras, height, width, …)."""
    return np.stack(np.unravel_index(flat, shape[:3]), axis=1).astype(np.int32)


def directions_of(views: Views, pixels: Int[np.ndarray, "rays 3"]) -> Float[np.ndarray, "rays 3"]:
    """Unit world directions of the rays through the centres of `pixels` (camera, row, column)."""
    directions = np.empty((len(pixels), 3))
    _directions(views.table, views.poses, pixels, directions)
    return directions


@numba.njit(cache=True, parallel=True, nogil=True)
@no_type_check
def _directions(table, poses, pixels, directions):
    for ray in numba.prange(len(pixels)):
        x, y, z = ray_of(table, poses, pixels[ray, 0], pixels[ray, 1], pixels[ray, 2], CELL)
        directions[ray, 0], directions[ray, 1], directions[ray, 2] = x, y, z
