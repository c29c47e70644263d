"""What both renderers share: the ground, where rays of a pixel go, and which cameras cannot film a plant."""

import numpy as np
from jaxtyping import Float

from nerfmodal.errors import InvalidSpec
from nerfmodal.simulate.plants import Plant
from nerfmodal.types import Rig

CHECKER_SIDE = 0.25
"""Side of the ground's squares, metres."""
CHECKER_TONES = (0.20, 0.55)
"""Reflectance of dark and light squares."""
GROUND_HALF = 12.0
"""Half the side of the ground, metres."""


def subpixels(samples: int) -> Float[np.ndarray, "samples 2"]:
    """Offsets of a pixel's rays from its centre: the R2 sequence, even for any number, with mean near zero."""
    golden = 1.32471795724474602596
    steps = np.arange(1, samples + 1)[:, None] * np.array([1 / golden, 1 / golden**2])
    offsets = steps % 1.0
    return offsets - offsets.mean(axis=0)


def check_rig(rig: Rig, plant: Plant) -> None:
    """Refuse cameras inside the plant's region or under the ground. Raises `InvalidSpec`."""
    low, high = np.asarray(plant.region.min_m), np.asarray(plant.region.max_m)
    for camera in rig.cameras:
        position = camera.camera_to_world[:3, 3]
        if np.all((position > low) & (position < high)):
            raise InvalidSpec(
                f"camera {camera.name} stands inside the plant's region.",
                where="/source/rig/radius_m",
                hint=f"The plant fills {low.tolist()} to {high.tolist()} m: use a larger radius_m.",
            )
        if position[2] <= 0:
            raise InvalidSpec(
                f"camera {camera.name} stands below the ground (z = {position[2]:.2f} m).",
                where="/source/rig/lowest_deg",
                hint="Raise lowest_deg or target_m, or use a smaller radius_m.",
            )
