"""Lenses: how far from the axis a direction falls in the picture, and back.

Image points are normalised (focal length 1, y down). `opencv` is Brown-Conrady, D. C. Brown, "Close-range camera
calibration", 1971, with four radial coefficients as in nerfstudio; `fisheye` is the equidistant model with four
coefficients of J. Kannala and S. Brandt, 2006, as OpenCV and COLMAP have it.

A radial polynomial turns back at some radius: directions beyond that fold would fall into the picture a second time.
No lens does that, so such directions are put far outside, and pixels beyond the fold see along it.
"""

from typing import no_type_check

import numpy as np
from jaxtyping import Float

from nerfmodal.types import Camera

OUTSIDE = 1e6
"""Where directions beyond the fold are put, in focal lengths from the centre: outside of every picture."""
WIDEST_PLANE_ANGLE = np.radians(89.0)
"""A plane before the camera holds no direction further from its axis than this (rad)."""
STEPS = 2048
NEWTON_STEPS = 8
TINY = 1e-12

Points = Float[np.ndarray, "points 2"]


def fold(camera: Camera) -> float:
    """Radius (tangent for `opencv`, angle in radians for `fisheye`) at which the radial polynomial turns back.

    Infinite where it never does; at most pi for a fisheye.
    """
    k1, k2, k3, k4, _, _ = camera.distortion
    slope = np.array([9 * k4, 7 * k3, 5 * k2, 3 * k1, 1.0])  # d/dr of r (1 + k1 r^2 + ...), in r^2
    roots = np.roots(np.where(np.abs(slope) < TINY, 0.0, slope))
    real = roots[np.abs(roots.imag) < 1e-9].real
    turning = float(np.sqrt(real[real > 0].min())) if (real > 0).any() else np.inf
    return min(turning, np.pi) if camera.model == "fisheye" else turning


def distort(camera: Camera, ideal: Points) -> Points:
    """Where the lens puts the ideal image points."""
    if camera.model == "pinhole":
        return ideal
    if camera.model == "fisheye":
        return bend(camera, np.append(ideal, -np.ones((len(ideal), 1)), axis=1) * np.array([1.0, -1.0, 1.0]))
    beyond = np.hypot(*ideal.T) >= fold(camera)
    return np.where(beyond[:, None], _far(ideal), _brown(camera, ideal))


def bend(camera: Camera, local: Float[np.ndarray, "points 3"]) -> Points:
    """Where a fisheye puts directions of its own frame (OpenGL); also those beside and behind it."""
    across = np.hypot(local[:, 0], local[:, 1])
    angle = np.arctan2(across, -local[:, 2])
    ratio = _radial(camera, angle) / np.maximum(across, TINY)
    image = np.stack([local[:, 0], -local[:, 1]], axis=1)
    return np.where((angle >= fold(camera))[:, None], _far(image), image * ratio[:, None])


def undistort(camera: Camera, observed: Points) -> Points:
    """The ideal image points that the lens puts at `observed`: what `distort` undoes."""
    if camera.model == "pinhole":
        return observed
    if camera.model == "fisheye":
        angle, unit = _unbent(camera, observed)
        return unit * np.tan(np.minimum(angle, WIDEST_PLANE_ANGLE))[:, None]
    return _newton(camera, observed)


def straighten(camera: Camera, observed: Points) -> Float[np.ndarray, "points 3"]:
    """Unit directions in the camera's frame (OpenGL) of observed image points, also beyond a right angle."""
    if camera.model == "fisheye":
        angle, unit = _unbent(camera, observed)
        across = unit * np.sin(angle)[:, None]
        return np.stack([across[:, 0], -across[:, 1], -np.cos(angle)], axis=1)
    ideal = undistort(camera, observed)
    local = np.stack([ideal[:, 0], -ideal[:, 1], -np.ones(len(ideal))], axis=1)
    return np.asarray(local / np.linalg.norm(local, axis=1, keepdims=True))


def _radial(camera: Camera, r: np.ndarray) -> np.ndarray:
    k1, k2, k3, k4, _, _ = camera.distortion
    r2 = r * r
    return np.asarray(r * (1 + r2 * (k1 + r2 * (k2 + r2 * (k3 + r2 * k4)))))


def _slope(camera: Camera, r: np.ndarray) -> np.ndarray:
    k1, k2, k3, k4, _, _ = camera.distortion
    r2 = r * r
    return np.asarray(1 + r2 * (3 * k1 + r2 * (5 * k2 + r2 * (7 * k3 + r2 * 9 * k4))))


@no_type_check
def brown(
    x: np.ndarray, y: np.ndarray, k1: float, k2: float, k3: float, k4: float, p1: float, p2: float
) -> tuple[np.ndarray, np.ndarray]:
    """Where Brown's lens puts ideal image points; arithmetic alone, so that it is compiled for single ones as well."""
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * (k3 + r2 * k4)))
    return (
        x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
        y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
    )


def _brown(camera: Camera, ideal: np.ndarray) -> np.ndarray:
    return np.stack(brown(ideal[:, 0], ideal[:, 1], *camera.distortion), axis=1)


def _newton(camera: Camera, observed: np.ndarray) -> np.ndarray:
    """Invert `_brown`: the radial part by its inverse on a table, then Newton's steps for all of it.

    Steps are not taken past the fold, where the Jacobian is singular.
    """
    limit = fold(camera)
    ideal = _inverse_radial(camera, observed, limit)
    for _ in range(NEWTON_STEPS):
        error = _brown(camera, ideal) - observed
        a, b, d = _jacobian(camera, ideal)
        determinant = a * d - b * b
        determinant = np.where(np.abs(determinant) < TINY, TINY, determinant)
        step = np.stack([d * error[:, 0] - b * error[:, 1], a * error[:, 1] - b * error[:, 0]], axis=1)
        ideal = _within(ideal - step / determinant[:, None], limit)
    return ideal


def _jacobian(camera: Camera, ideal: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """d x'/dx, d x'/dy (= d y'/dx) and d y'/dy of `_brown`."""
    k1, k2, k3, k4, p1, p2 = camera.distortion
    x, y = ideal[:, 0], ideal[:, 1]
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * (k3 + r2 * k4)))
    growth = 2 * (k1 + r2 * (2 * k2 + r2 * (3 * k3 + r2 * 4 * k4)))  # d radial / dx = growth x
    return (
        radial + growth * x * x + 2 * p1 * y + 6 * p2 * x,
        growth * x * y + 2 * p1 * x + 2 * p2 * y,
        radial + growth * y * y + 6 * p1 * y + 2 * p2 * x,
    )


def _inverse_radial(camera: Camera, observed: np.ndarray, limit: float) -> np.ndarray:
    seen = np.hypot(*observed.T)
    reach = min(limit, 4.0 * max(float(seen.max(initial=0.0)), 1.0))
    radii = np.linspace(0.0, reach, STEPS)
    found = np.interp(seen, _radial(camera, radii), radii)
    return np.asarray(observed * (found / np.maximum(seen, TINY))[:, None])


def _within(ideal: np.ndarray, limit: float) -> np.ndarray:
    radius = np.hypot(*ideal.T)
    return np.asarray(ideal * np.minimum(1.0, limit / np.maximum(radius, TINY))[:, None])


def _unbent(camera: Camera, observed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Angles from the axis (rad) and unit vectors across it of a fisheye's image points."""
    seen = np.hypot(*observed.T)
    limit = fold(camera)
    angles = np.linspace(0.0, limit, STEPS)
    angle = np.interp(seen, _radial(camera, angles), angles)
    inside = seen < _radial(camera, np.array(limit))
    for _ in range(NEWTON_STEPS):
        slope = np.maximum(_slope(camera, angle), 1e-6)
        step = (_radial(camera, angle) - seen) / slope
        angle = np.where(inside, np.clip(angle - step, 0.0, limit), angle)
    return angle, observed / np.maximum(seen, TINY)[:, None]


def _far(image: np.ndarray) -> np.ndarray:
    radius = np.maximum(np.hypot(*image.T), TINY)
    return np.asarray(OUTSIDE * image / radius[:, None])
