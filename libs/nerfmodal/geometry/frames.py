"""Local frames of organs: where its x, y and normal point in the world."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from nerfmodal.spec import OrientedBox


@dataclass(frozen=True, slots=True, kw_only=True)
class LocalFrame:
    """A right-handed frame: `axes` are unit columns (along, across, normal) in the world, `origin` in metres."""

    origin: Float[np.ndarray, " 3"]
    axes: Float[np.ndarray, "3 3"]

    def to_local(self, points: Float[np.ndarray, "points 3"]) -> Float[np.ndarray, "points 3"]:
        """World to local coordinates."""
        return (points - self.origin) @ self.axes

    def to_world(self, points: Float[np.ndarray, "points 3"]) -> Float[np.ndarray, "points 3"]:
        """Local to world coordinates."""
        return points @ self.axes.T + self.origin


def frame_of_box(box: OrientedBox) -> LocalFrame:
    """The frame of an oriented box: x along it (after yaw and pitch), z its upper side."""
    yaw, pitch = np.radians(box.yaw_deg), np.radians(box.pitch_deg)
    turn = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1.0]])
    raise_end = np.array([[np.cos(pitch), 0, -np.sin(pitch)], [0, 1.0, 0], [np.sin(pitch), 0, np.cos(pitch)]])
    return LocalFrame(origin=np.asarray(box.center_m, dtype=float), axes=turn @ raise_end)


def inside_box(box: OrientedBox, points: Float[np.ndarray, "points 3"]) -> Bool[np.ndarray, " points"]:
    """Which world points lie in the box."""
    half = np.asarray(box.size_m) / 2
    return np.asarray(np.all(np.abs(frame_of_box(box).to_local(points)) <= half, axis=1))
