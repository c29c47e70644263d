"""Which camera sees a place most closely, of those that see nothing before it.

The projection is that of `geometry.cameras.project`, one place at a time: of a million places and fifty cameras nearly
all pairs are passed over before anything is projected.
"""

import math
from typing import no_type_check

import numba
import numpy as np
from jaxtyping import Bool, Float, Int

from nerfmodal.field.marching import inverse
from nerfmodal.geometry.lenses import brown, fold
from nerfmodal.types import Rig

MARGIN = 1.0
"""Pixels along a picture's edge that are not asked: a spline needs neighbours."""
_brown = numba.njit(cache=True)(brown)


def closest_cameras(
    rig: Rig, points: Float[np.ndarray, "points 3"], clear: Bool[np.ndarray, "cameras height width"]
) -> tuple[Int[np.ndarray, " points"], Float[np.ndarray, "points 2"]]:
    """Of each place the camera that shows it with the most pixels a metre, or -1, and its pixel there (column, row).

    Only cameras above a place, to whose pixel nothing stands before it (`clear`), count.
    """
    closest, places = np.full(len(points), -1, np.int32), np.empty((len(points), 2))
    cameras = rig.cameras
    _find(
        points,
        np.stack([one.camera_to_world for one in cameras]),
        np.array([[one.focal_x, one.focal_y, one.center_x, one.center_y] for one in cameras]),
        np.array([one.distortion for one in cameras]),
        np.array([fold(one) for one in cameras]),
        np.array([one.model == "fisheye" for one in cameras]),
        clear,
        closest,
        places,
    )
    return closest, places


@numba.njit(cache=True, parallel=True, nogil=True)
@no_type_check
def _find(points, poses, lenses, distortions, folds, fisheyes, clear, closest, places):
    _, height, width = clear.shape
    for index in numba.prange(len(points)):
        nearest = 0.0
        for camera in range(len(poses)):
            x = points[index, 0] - poses[camera, 0, 3]
            y = points[index, 1] - poses[camera, 1, 3]
            z = points[index, 2] - poses[camera, 2, 3]
            nearness = -z / (x * x + y * y + z * z)  # sine of the angle over the distance
            if nearness <= nearest:
                continue
            u, v = _image_point(x, y, z, poses[camera], distortions[camera], folds[camera], fisheyes[camera])
            column, row = u * lenses[camera, 0] + lenses[camera, 2], v * lenses[camera, 1] + lenses[camera, 3]
            if not (MARGIN < column < width - MARGIN and MARGIN < row < height - MARGIN):
                continue
            if clear[camera, int(row), int(column)]:
                nearest, closest[index] = nearness, camera
                places[index, 0], places[index, 1] = column, row


@numba.njit(cache=True)
@no_type_check
def _image_point(x, y, z, pose, distortion, limit, fisheye):
    """Image point (focal length 1, y down) of a direction in the world; not a number where the lens sees nothing."""
    across = pose[0, 0] * x + pose[1, 0] * y + pose[2, 0] * z
    up = pose[0, 1] * x + pose[1, 1] * y + pose[2, 1] * z
    ahead = -(pose[0, 2] * x + pose[1, 2] * y + pose[2, 2] * z)
    k1, k2, k3, k4 = distortion[0], distortion[1], distortion[2], distortion[3]
    if fisheye:
        r = math.hypot(across, up)
        angle = math.atan2(r, ahead)
        bent, _ = _brown(angle, 0.0, k1, k2, k3, k4, 0.0, 0.0)
        ratio = bent * inverse(r)
        return (across * ratio, -up * ratio) if ahead > 0 and angle < limit else (math.nan, math.nan)
    a, b = across / max(ahead, 1e-12), -up / max(ahead, 1e-12)
    if ahead <= 0 or a * a + b * b >= limit * limit:
        return math.nan, math.nan
    return _brown(a, b, k1, k2, k3, k4, distortion[4], distortion[5])
