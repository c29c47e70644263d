"""Rays of pictures and their meeting with boxes."""

import numpy as np
from jaxtyping import Float

from nerfmodal.geometry.cameras import unproject
from nerfmodal.types import Camera, Rig


def pixel_centers(camera: Camera) -> Float[np.ndarray, "pixels 2"]:
    """Centres of all pixels, row by row, in pixels."""
    columns, rows = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
    return np.stack([columns.ravel(), rows.ravel()], axis=1)


def rig_directions(rig: Rig) -> Float[np.ndarray, "cameras pixels 3"]:
    """Unit directions of every pixel's ray; all cameras must have one picture size."""
    return np.stack([unproject(camera, pixel_centers(camera)) for camera in rig.cameras])


def rig_positions(rig: Rig) -> Float[np.ndarray, "cameras 3"]:
    """Positions of the cameras, metres."""
    return np.stack([camera.camera_to_world[:3, 3] for camera in rig.cameras])


def meet_box(
    origins: Float[np.ndarray, "rays 3"],
    directions: Float[np.ndarray, "rays 3"],
    low: Float[np.ndarray, " 3"],
    high: Float[np.ndarray, " 3"],
) -> tuple[Float[np.ndarray, " rays"], Float[np.ndarray, " rays"]]:
    """Distances at which rays enter and leave a box (slab method); a miss has near >= far."""
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = 1.0 / directions
        first, second = (low - origins) * inverse, (high - origins) * inverse
    nears = np.nanmax(np.minimum(first, second), axis=1)
    fars = np.nanmin(np.maximum(first, second), axis=1)
    return np.maximum(nears, 0.0), fars
