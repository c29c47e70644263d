"""How an organ in motion is looked at: orthographic, across its length and its motion, from a little above.

Metres along three directions: to the right, up, and towards the eye. Faces are painted from far to near, a little
darker where they are seen edge-on, so that form shows without hiding the colour.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

ELEVATION, ASIDE = 28.0, 28.0
"""Degrees that the eye stands above the ground, and beside the direction across the organ."""
DARKEST = 0.78
"""Light on a face that is seen edge-on, as a share of one seen flat."""


@dataclass(frozen=True, slots=True, kw_only=True)
class View:
    """Unit rows: to the right, up, and towards the eye, in the world."""

    axes: Float[np.ndarray, "3 3"]

    def project(self, points: Float[np.ndarray, "*points 3"]) -> Float[np.ndarray, "*points 3"]:
        """Metres to the right, up and towards the eye."""
        return np.asarray(points @ self.axes.T)


def view_across(points: Float[np.ndarray, "points 3"], direction: Float[np.ndarray, " 3"]) -> View:
    """The view at right angles to the length of `points` and to a motion along `direction`."""
    return view_from(_azimuth(points, direction), ELEVATION)


def view_from(azimuth_deg: float, elevation_deg: float) -> View:
    """The view of an eye in this direction from x towards y, and above the ground."""
    azimuth, elevation = np.radians(azimuth_deg), np.radians(elevation_deg)
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    toward = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
    return View(axes=np.stack([right, np.cross(toward, right), toward]))


def far_to_near(corners: Float[np.ndarray, "faces 3 3"]) -> Int[np.ndarray, " faces"]:
    """The order in which projected faces are painted."""
    return np.argsort(corners[:, :, 2].mean(axis=1), kind="stable")


def light(
    corners: Float[np.ndarray, "faces 3 3"], triangles: Int[np.ndarray, "faces 3"]
) -> Float[np.ndarray, " faces"]:
    """Brightness of projected faces from `DARKEST` to 1, smoothed over neighbours."""
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals *= np.where(normals[:, 2:] < 0, -1, 1)
    smooth = np.zeros((int(triangles.max(initial=-1)) + 1, 3))
    np.add.at(smooth, triangles.ravel(), np.repeat(normals, 3, axis=0))
    faces = smooth[triangles].sum(axis=1)
    facing = faces[:, 2] / np.maximum(np.linalg.norm(faces, axis=1), 1e-12)
    return np.asarray(DARKEST + (1 - DARKEST) * facing)


def nice_length(longest: float) -> float:
    """The largest of 1, 2, 5 × 10ⁿ that is not above `longest`."""
    power = 10.0 ** np.floor(np.log10(longest))
    return float(max(step * power for step in (1, 2, 5) if step * power <= longest * (1 + 1e-9)))


def _azimuth(points: np.ndarray, direction: np.ndarray) -> float:
    """Where the eye stands, in degrees from x to y."""
    length = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2][0]
    sideways = np.cross(length, direction)
    if np.linalg.norm(sideways) < 1e-6:
        sideways = np.array([1.0, -1.0, 0.0])
    return float(np.degrees(np.arctan2(sideways[1], sideways[0]))) + ASIDE
