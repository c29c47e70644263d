"""What changed since frame 0: pixels first, then the part of space that they carve out.

The rig stands still, so a pixel that did not change says nothing new. A place can have changed only if nearly every
camera that sees it sees a change there: the intersection of the changed silhouettes, as in a visual hull
(Laurentini 1994).
"""

from typing import no_type_check

import numba
import numpy as np
from jaxtyping import Bool, UInt8

from nerfmodal.field.bricks import BLOCKS, Bricks, Occupancy, grown
from nerfmodal.field.masks import largest, widened
from nerfmodal.geometry.cameras import project
from nerfmodal.types import Rig

CHANGE = 10
"""A pixel has changed when one of its channels differs by more than this (of 255)."""


def changed_pixels(
    first: UInt8[np.ndarray, "cameras height width 3"], images: UInt8[np.ndarray, "cameras height width 3"]
) -> Bool[np.ndarray, "cameras height width"]:
    """Pixels that differ from frame 0, and their neighbours."""
    changed = [largest(np.abs(was.astype(np.int16) - now)) > CHANGE for was, now in zip(first, images, strict=True)]
    return widened(np.stack(changed), 1)


def carved_blocks(
    bricks: Bricks,
    rig: Rig,
    marked: Bool[np.ndarray, "cameras height width"],
    agreement: float,
    *,
    voters: Bool[np.ndarray, "cameras height width"] | None = None,
    within: Occupancy | None = None,
) -> Occupancy:
    """Blocks of the grid's whole box that nearly every camera sees in a marked pixel, and their neighbours.

    `agreement` is the share of the cameras that must see it marked (some see only what stands before it). Pixels
    outside `voters` (by default none) say neither yes nor no. Only blocks of `within` are asked for.
    """
    shape = tuple(BLOCKS * n for n in bricks.slots.shape)
    asked_for = np.ones(shape, dtype=bool) if within is None else within
    side = 2 * bricks.voxel
    centers = bricks.low + side * (np.argwhere(asked_for) + 0.5)
    votes, seen = np.zeros(len(centers), np.float32), np.zeros(len(centers), np.float32)
    opinions = np.ones_like(marked) if voters is None else voters
    for camera, mask, asked in zip(rig.cameras, marked, opinions, strict=True):
        pixels, depths = project(camera, centers)
        radius = 0.5 * side * camera.focal_x / max(float(np.median(np.abs(depths))), 1e-6)
        _vote(pixels, depths, widened(mask, round(radius)), asked, votes, seen)
    hull = np.zeros(shape, dtype=bool)
    hull[asked_for] = votes >= agreement * np.maximum(seen, 1.0)
    return grown(hull)


@numba.njit(cache=True)
@no_type_check
def _vote(pixels, depths, mask, asked, votes, seen):
    height, width = mask.shape
    for index in range(len(pixels)):
        column, row = pixels[index]
        if depths[index] > 0 and 0 <= column < width and 0 <= row < height and asked[int(row), int(column)]:
            seen[index] += 1
            votes[index] += mask[int(row), int(column)]
