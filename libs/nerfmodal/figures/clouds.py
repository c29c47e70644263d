"""The point cloud of one frame, in its own colours and by organ (the paper's Figures 3 and 4)."""

import numpy as np
from jaxtyping import Float, Int
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d import Axes3D
from scipy.spatial import cKDTree

from nerfmodal.figures.space import frame_points, space_panels
from nerfmodal.figures.style import CYCLE, LABEL, TITLE, evenly, new_figure, say
from nerfmodal.types import PointCloud, ScanResult, SensorGrid

MOST_POINTS = 12_000
REACH = 4.0
"""A point belongs to an organ within this many sensor spacings of one of its sensors …"""
LEAST_REACH = 0.06
"""… or within this many metres, whichever is larger."""

OUTWARDS = 0.08
"""How far beyond its organ a name stands, as a share of the way from the middle."""


def cloud(points: PointCloud, result: ScanResult) -> Figure:
    """Two panels: the cloud in its own colours, and coloured by the organ whose sensors are near."""
    if not len(points.points):
        return say(new_figure(2.0), points.outcome.value)
    kept = evenly(len(points.points), MOST_POINTS)
    title = f"Point cloud at t = {points.time:g} s: {len(points.points):,} points"
    panels = space_panels(2, 2, (3.4, 3.1), title=title)
    _by_color(panels.axes[0], points, kept)
    _by_organ(panels.axes[1], points.points[kept], result)
    panels.bar.remove()
    return panels.figure


def organ_labels(points: Float[np.ndarray, "points 3"], organs: tuple[SensorGrid, ...]) -> Int[np.ndarray, " points"]:
    """Index of the organ whose sensors are nearest and within reach; -1 for none."""
    best = np.full(len(points), np.inf)
    labels = np.full(len(points), -1)
    for index, organ in enumerate(organs):
        distance = np.asarray(cKDTree(organ.positions).query(points)[0])
        closer = (distance < best) & (distance < _reach(organ))
        labels[closer], best[closer] = index, distance[closer]
    return labels


def _reach(organ: SensorGrid) -> float:
    if len(organ.positions) < 2:
        return LEAST_REACH
    spacing = np.median(np.asarray(cKDTree(organ.positions).query(organ.positions, k=2)[0])[:, 1])
    return max(LEAST_REACH, REACH * float(spacing))


def _by_color(axes: Axes3D, points: PointCloud, kept: Int[np.ndarray, " kept"]) -> None:
    shown = points.points[kept]
    axes.scatter(*shown.T, c=np.clip(points.colors[kept], 0, 1), s=1.2, linewidths=0, depthshade=False)
    axes.set_title("in its own colours", fontsize=TITLE, y=0.97)
    frame_points(axes, shown, zoom=0.95)


def _by_organ(axes: Axes3D, shown: Float[np.ndarray, "points 3"], result: ScanResult) -> None:
    grids = tuple(organ.displacement.sensors for organ in result.organs)
    labels = organ_labels(shown, grids)
    axes.scatter(*shown[labels < 0].T, c="#c4c4c4", s=0.8, linewidths=0, depthshade=False)
    for index, grid in enumerate(grids):
        mine = shown[labels == index]
        axes.scatter(*mine.T, color=CYCLE[index % len(CYCLE)], s=1.5, linewidths=0, depthshade=False)
        _name(axes, grid, shown.mean(axis=0))
    axes.set_title("by organ (grey: none)", fontsize=TITLE, y=0.97)
    frame_points(axes, shown, zoom=0.95)


def _name(axes: Axes3D, grid: SensorGrid, middle: Float[np.ndarray, " 3"]) -> None:
    """The organ's name at its end that is farthest from the cloud's middle: colours alone do not survive grey."""
    end = grid.positions[np.argmax(np.linalg.norm(grid.positions - middle, axis=1))]
    paper = {"boxstyle": "round,pad=0.15", "facecolor": "white", "edgecolor": "none", "alpha": 0.75}
    place = end + OUTWARDS * (end - middle)
    axes.text(*place, grid.organ, fontsize=LABEL - 1, ha="center", va="center", bbox=paper, zorder=1000)
