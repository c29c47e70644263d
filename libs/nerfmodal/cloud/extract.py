"""A point cloud from a field (eq 10): rays of the cameras, kept where they are opaque and inside the box.

Knows no field: what a ray meets is asked of a function.
"""

import math
from collections.abc import Callable

import numpy as np
from jaxtyping import Float, Int

from nerfmodal.geometry.cameras import unproject
from nerfmodal.types import Frame, Look, Outcome, PointCloud, Rig

GOLDEN = 0.6180339887498949
BLOCK = 65_536
"""Rays asked at a time."""


def extract(
    look: Look,
    frame: Frame,
    low: Float[np.ndarray, " 3"],
    high: Float[np.ndarray, " 3"],
    *,
    threshold: float,
    spread: float,
    count: int,
    rng: np.random.Generator,
    report: Callable[[int, int], None],
) -> PointCloud:
    """Draw pixels without repetition until `count` points are kept or no pixel is left: it always ends.

    Parameters
    ----------
    look
        (rays, 3) pixels as (camera, row, column) to colours (rays, 3), opacities (rays,), distances (rays,) m, and
        the spread of the place along the ray (rays,) m.
    threshold
        Rays less opaque than this are discarded (eq 10).
    spread
        Rays whose place is less sure than this (metres) are discarded: they end in fog, not on a surface.
    report
        Called with (rays tried, of at most).
    """
    shape = frame.images.shape[:3]
    total = int(np.prod(shape))
    first, step = int(rng.integers(total)), stride(total)
    points, colors, kept = [np.empty((0, 3))], [np.empty((0, 3))], 0
    for start in range(0, total, BLOCK):
        order = (first + step * np.arange(start, min(start + BLOCK, total))) % total
        pixels = np.stack(np.unravel_index(order, shape), axis=1).astype(np.int32)
        seen, opacity, distance, unsure = look(pixels)
        opaque = (opacity > threshold) & (distance > 0) & (unsure <= spread)  # eq 10
        places = _places(frame.rig, pixels[opaque], distance[opaque])
        inside = np.all((places >= low) & (places <= high), axis=1)
        points.append(places[inside])
        colors.append(np.clip(seen[opaque][inside], 0.0, 1.0))
        kept += int(inside.sum())
        report(min(start + BLOCK, total), total)
        if kept >= count:
            break
    outcome = Outcome.EMPTY_FIELD if kept == 0 else Outcome.FEW_POINTS if kept < count else Outcome.OK
    return PointCloud(
        points=np.concatenate(points)[:count],
        colors=np.concatenate(colors)[:count].astype(float),
        time=frame.time,
        outcome=outcome,
    )


def stride(total: int) -> int:
    """A step that visits every one of `total` pixels once, evenly all the while: near the golden section, coprime."""
    step = max(round(total * GOLDEN), 1)
    while math.gcd(step, total) > 1:
        step += 1
    return step


def _places(
    rig: Rig, pixels: Int[np.ndarray, "rays 3"], distance: Float[np.ndarray, " rays"]
) -> Float[np.ndarray, "rays 3"]:
    places = np.empty((len(pixels), 3))
    for index, camera in enumerate(rig.cameras):
        mine = pixels[:, 0] == index
        centers = pixels[mine][:, [2, 1]] + 0.5
        places[mine] = camera.camera_to_world[:3, 3] + distance[mine, None] * unproject(camera, centers)
    return places
