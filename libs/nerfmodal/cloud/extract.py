"""A point cloud from a field (eq 10): rays of the cameras, kept where they are opaque and inside the box.

Knows no field: what a ray meets is asked of a function.
"""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float, Int

from nerfmodal.geometry.cameras import unproject
from nerfmodal.types import Frame, Outcome, PointCloud, Rig

Look = Callable[[Int[np.ndarray, "rays 3"]], tuple[np.ndarray, np.ndarray, np.ndarray]]
BLOCK = 65_536
"""Rays asked at a time."""


def extract(
    look: Look,
    frame: Frame,
    low: Float[np.ndarray, " 3"],
    high: Float[np.ndarray, " 3"],
    *,
    threshold: float,
    count: int,
    rng: np.random.Generator,
    report: Callable[[int, int], None],
) -> PointCloud:
    """Draw pixels without repetition until `count` points are kept or no pixel is left: it always ends.

    Parameters
    ----------
    look
        (rays, 3) pixels as (camera, row, column) to colours (rays, 3), opacities (rays,) and distances (rays,) m.
    threshold
        Rays less opaque than this are discarded (eq 10).
    report
        Called with (rays tried, of at most).
    """
    shape = frame.images.shape[:3]
    order = rng.permutation(int(np.prod(shape)))
    points, colors, kept = [np.empty((0, 3))], [np.empty((0, 3))], 0
    for start in range(0, len(order), BLOCK):
        pixels = np.stack(np.unravel_index(order[start : start + BLOCK], shape), axis=1).astype(np.int32)
        seen, opacity, distance = look(pixels)
        opaque = (opacity > threshold) & (distance > 0)  # eq 10
        places = _places(frame.rig, pixels[opaque], distance[opaque])
        inside = np.all((places >= low) & (places <= high), axis=1)
        points.append(places[inside])
        colors.append(np.clip(seen[opaque][inside], 0.0, 1.0))
        kept += int(inside.sum())
        report(min(start + BLOCK, len(order)), len(order))
        if kept >= count:
            break
    outcome = Outcome.EMPTY_FIELD if kept == 0 else Outcome.FEW_POINTS if kept < count else Outcome.OK
    return PointCloud(
        points=np.concatenate(points)[:count],
        colors=np.concatenate(colors)[:count].astype(float),
        time=frame.time,
        outcome=outcome,
    )


def _places(
    rig: Rig, pixels: Int[np.ndarray, "rays 3"], distance: Float[np.ndarray, " rays"]
) -> Float[np.ndarray, "rays 3"]:
    places = np.empty((len(pixels), 3))
    for index, camera in enumerate(rig.cameras):
        mine = pixels[:, 0] == index
        centers = pixels[mine][:, [2, 1]] + 0.5
        places[mine] = camera.camera_to_world[:3, 3] + distance[mine, None] * unproject(camera, centers)
    return places
