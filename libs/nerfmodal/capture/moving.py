"""The part of a scene that moves: the box to reconstruct, found from how the pictures differ over the record.

A pixel moves when its grey value spreads over the looked-at instants by more than noise does. A place moves when
nearly every camera that sees it sees motion there: the intersection of silhouettes (Laurentini 1994) on a coarse grid.
"""

import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import binary_dilation, binary_opening

from nerfmodal.capture.record import Capture
from nerfmodal.errors import InvalidCapture
from nerfmodal.geometry.cameras import focus_of, project
from nerfmodal.types import Camera, Frame

INSTANTS = 24
"""Looked at, spread evenly over the record."""
PIXELS = 200
"""Pictures are shrunk to about so many along their shorter side."""
CELLS = 96
REACH = 0.75
"""Half the side of the box that is searched, in mean distances from the cameras to what they look at."""
AGREEMENT = 0.85
FEWEST_SEEING = 3
LEAST_CHANGE = 10
"""Grey levels (of 255) that a moving pixel spreads over, at the least."""
ABOVE_NOISE = 4.0
MARGIN = 0.06
"""Added to every side of the box, in its longest side."""


def moving_box(capture: Capture) -> Float[np.ndarray, "2 3"]:
    """Lowest and highest corner (m) of what moves.

    Raises
    ------
    InvalidCapture
        When nothing moves, or nothing that the cameras agree on.
    """
    if len(capture) < 2:
        raise _refusal(capture, "it has one frame")
    camera = capture.rig.cameras[0]
    shrink = max(1, min(camera.width, camera.height) // PIXELS)
    chosen = np.unique(np.linspace(0, len(capture) - 1, INSTANTS).round().astype(int))
    moving = moving_pixels([capture.read(int(k), shrink) for k in chosen])
    if not any(mask.any() for _, mask in moving):
        raise _refusal(capture, "no pixel changes by more than noise")
    center, distance = focus_of(capture.rig)
    side = 2 * REACH * distance / CELLS
    cells = np.argwhere(np.ones((CELLS,) * 3, dtype=bool))
    places = center - REACH * distance + side * (cells + 0.5)
    agreed = _agreed(moving, places, side).reshape((CELLS,) * 3)
    if not agreed.any():
        raise _refusal(capture, "no place moves in enough pictures")
    cells = np.argwhere(agreed)
    low = center - REACH * distance + side * cells.min(axis=0)
    high = center - REACH * distance + side * (cells.max(axis=0) + 1)
    margin = MARGIN * float((high - low).max())
    return np.stack([low - margin, high + margin])


def moving_pixels(frames: list[Frame]) -> list[tuple[Camera, Bool[np.ndarray, "height width"]]]:
    """For each camera, the pixels whose grey value spreads over the frames; lone ones are noise."""
    grey: dict[str, list[np.ndarray]] = {}
    cameras: dict[str, Camera] = {}
    for frame in frames:
        for camera, image in zip(frame.rig.cameras, frame.images, strict=True):
            cameras[camera.name] = camera
            grey.setdefault(camera.name, []).append(image.mean(axis=-1))
    masks = []
    for name, pictures in grey.items():
        spread = np.ptp(np.stack(pictures), axis=0)
        level = max(LEAST_CHANGE, ABOVE_NOISE * float(np.median(spread)))
        masks.append((cameras[name], np.asarray(binary_opening(spread > level, np.ones((2, 2), dtype=bool)))))
    return masks


def _agreed(
    moving: list[tuple[Camera, Bool[np.ndarray, "height width"]]], places: Float[np.ndarray, "places 3"], side: float
) -> Bool[np.ndarray, " places"]:
    votes, seen = np.zeros(len(places)), np.zeros(len(places))
    for camera, mask in moving:
        pixels, depths = project(camera, places)
        inside = (depths > 0) & (pixels >= 0).all(axis=1) & (pixels < [camera.width, camera.height]).all(axis=1)
        radius = round(0.5 * side * camera.focal_x / max(float(np.median(np.abs(depths))), 1e-9))
        grown = binary_dilation(mask, np.ones((2 * radius + 1,) * 2, dtype=bool)) if radius else mask
        columns, rows = pixels[inside].astype(int).T
        votes[inside] += grown[rows, columns]
        seen[inside] += 1
    return (seen >= FEWEST_SEEING) & (votes >= AGREEMENT * seen)


def _refusal(capture: Capture, reason: str) -> InvalidCapture:
    return InvalidCapture(
        f"the part that moves cannot be found: {reason}.",
        where=capture.where,
        hint="Give reconstruction.region, the box in metres.",
    )
