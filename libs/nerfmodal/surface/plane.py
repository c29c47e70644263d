"""The frame of an organ: the robust best-fit plane of its pooled points, or the axis of a rod.

Leaf: x along the longest direction of the plane, the normal towards positive world z. Measured along the world's z, a
leaf that hangs steeply shows four times its motion and its second harmonic; in its own plane it does not. A leaf that
lies within 10° of level keeps the vertical, so that there the measured direction is exactly the paper's z.
"""

import numpy as np
from jaxtyping import Float

from nerfmodal.errors import InvalidClouds
from nerfmodal.geometry.frames import LocalFrame
from nerfmodal.surface.robust import robust_scale

LEVEL_DEG = 10.0
INLIER_SDS = 3.0
ITERATIONS = 12
THINNEST = 1e-3
"""Ratio of the second to the first extent below which points are called collinear."""
THINNEST_ROD = 1e-4


def plane_frame(points: Float[np.ndarray, "points 3"]) -> LocalFrame:
    """The frame of a sheet. Raises `InvalidClouds` if the points are all on one line."""
    kept = np.ones(len(points), dtype=bool)
    _refuse_line(_principal_axes(points)[1])
    for _ in range(ITERATIONS):
        center, extents, axes = _principal_axes(points[kept])
        distances = (points - center) @ axes[:, 2]
        kept = np.abs(distances) <= INLIER_SDS * robust_scale(distances)
    _refuse_line(extents)
    normal = _upwards(axes[:, 2])
    if np.degrees(np.arccos(min(normal[2], 1.0))) <= LEVEL_DEG:
        normal = np.array([0.0, 0.0, 1.0])
    return LocalFrame(origin=center, axes=_axes_from(axes[:, 0], normal))


def rod_frame(points: Float[np.ndarray, "points 3"]) -> LocalFrame:
    """The frame of a rod: its *third* axis runs along it, upwards; the first is the world's x turned across it."""
    center = np.median(points, axis=0)
    kept = np.ones(len(points), dtype=bool)
    for _ in range(ITERATIONS):
        mean, extents, axes = _principal_axes(points[kept])
        center, along = mean, _upwards(axes[:, 0])
        offsets = points - center
        radii = np.linalg.norm(offsets - np.outer(offsets @ along, along), axis=1)
        kept = radii <= INLIER_SDS * robust_scale(radii)
    if extents[0] < 1e-9:
        raise InvalidClouds("all points of the organ are one point.", hint="Check the unit and the region.")
    if extents[1] < THINNEST_ROD * extents[0]:
        raise InvalidClouds(
            "all points of the organ lie on one line.",
            hint="A line has no surface to measure: write the points of the surface, not of its middle.",
        )
    first = np.array([1.0, 0.0, 0.0]) if abs(along[0]) < 0.9 else np.array([0.0, 1.0, 0.0])
    return LocalFrame(origin=center, axes=_axes_from(first, along))


def _principal_axes(points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Centre, extents (standard deviations) and unit axes (columns), longest first."""
    center = points.mean(axis=0)
    values, vectors = np.linalg.eigh(np.cov(points - center, rowvar=False))
    return center, np.sqrt(np.maximum(values[::-1], 0.0)), vectors[:, ::-1]


def _upwards(direction: np.ndarray) -> np.ndarray:
    """The direction or its opposite: towards positive world z, then y, then x."""
    for axis in (2, 1, 0):
        if abs(direction[axis]) > 1e-6:
            return np.asarray(direction * np.sign(direction[axis]))
    return direction


def _axes_from(along: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Right-handed columns (along made perpendicular to the normal, across, normal)."""
    first = along - (along @ normal) * normal
    first = first / np.linalg.norm(first)
    leading = int(np.argmax(np.abs(first)))
    first = first * np.sign(first[leading])
    return np.stack([first, np.cross(normal, first), normal], axis=1)


def _refuse_line(extents: np.ndarray) -> None:
    if extents[0] < 1e-12:
        raise InvalidClouds("all points of the organ are one point.", hint="Check the unit and the region.")
    if extents[1] <= THINNEST * extents[0]:
        raise InvalidClouds(
            "all points of the organ lie on one line.",
            hint="Use surface: cylinder for a thin branch, or a larger region.",
        )
