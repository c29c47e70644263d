"""The ground below a plant: a flat, wide, nearly level layer with nothing below it. It is no organ.

The lowest points of columns over the whole area are fitted with a plane; it is ground if most columns stand on it,
hardly anything lies below, and what is above rises from it. A level leaf alone has nothing above: it is no ground.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

COLUMNS = 24
"""Columns along the longer side, seen from above."""
LOWEST = 0.05
"""Quantile of a column's heights that counts as its lowest."""
FLAT = 0.012
"""Of the extent: how far from the plane a column's lowest point may be."""
CLEAR = 0.025
"""Of the extent: what is higher above the plane stands on the ground."""
STANDING = 0.5
"""Share of the columns that stand on the plane."""
BELOW = 0.03
RISES = 0.25
"""Of the extent: how high the rest must rise; and the share of the points that it holds."""
STEEPEST = 0.35
"""Slope of the ground."""
ITERATIONS = 12


def without_ground(frames: Sequence[Float[np.ndarray, "_ 3"]]) -> list[Float[np.ndarray, "_ 3"]]:
    """The frames without the points of the ground; as they are where there is none."""
    pooled = np.concatenate(frames)
    low, high = np.quantile(pooled, [0.005, 0.995], axis=0)
    extent = float((high - low).max())
    plane = _plane_below(pooled, low, extent) if extent > 0 else None
    if plane is None:
        return list(frames)
    above = _over(plane, pooled)
    standing = above[above > CLEAR * extent]
    rises = len(standing) and np.quantile(standing, 0.9) > RISES * extent
    if not rises or len(standing) < RISES * len(pooled) or np.mean(above < -CLEAR * extent) > BELOW:
        return list(frames)
    return [points[_over(plane, points) > CLEAR * extent] for points in frames]


def _plane_below(pooled: np.ndarray, low: np.ndarray, extent: float) -> np.ndarray | None:
    """(a, b, c) of z = a x + b y + c through the columns' lowest points, if most of them lie on it."""
    columns = np.floor((pooled[:, :2] - low[:2]) / (extent / COLUMNS)).astype(int)
    _, numbers, counts = np.unique(columns, axis=0, return_inverse=True, return_counts=True)
    order = np.lexsort((pooled[:, 2], numbers.ravel()))
    starts = np.concatenate([[0], np.cumsum(counts)[:-1]])
    usual = counts >= 0.1 * np.median(counts)
    lowest = pooled[order[(starts + (LOWEST * counts).astype(int))[usual]]]
    if len(lowest) < COLUMNS:
        return None
    design = np.column_stack([lowest[:, :2], np.ones(len(lowest))])
    plane = np.array([0.0, 0.0, np.quantile(lowest[:, 2], 0.2)])
    for _ in range(ITERATIONS):
        off = lowest[:, 2] - design @ plane
        near = np.abs(off) <= max(FLAT * extent, 2 * float(np.quantile(np.abs(off), 0.3)))
        plane = np.linalg.lstsq(design[near], lowest[near, 2], rcond=None)[0]
    on = np.abs(lowest[:, 2] - design @ plane) <= FLAT * extent
    return plane if on.mean() >= STANDING and np.hypot(*plane[:2]) <= STEEPEST else None


def _over(plane: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Heights over the plane."""
    return points[:, 2] - points[:, :2] @ plane[:2] - plane[2]
