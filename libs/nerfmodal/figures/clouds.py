"""The point cloud of one frame, in its own colours and by organ (the paper's Figures 3 and 4)."""

import numpy as np
from jaxtyping import Float, Int
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.spatial import cKDTree

from nerfmodal.figures.landmarks import draw_landmarks, limits_around
from nerfmodal.figures.style import CYCLE, FULL_WIDTH, LABEL, TITLE, evenly, new_figure, say
from nerfmodal.figures.view import view_from
from nerfmodal.types import PointCloud, ScanResult, SensorGrid

MOST_POINTS = 12_000
REACH = 4.0
"""A point belongs to an organ within this many sensor spacings of one of its sensors …"""
LEAST_REACH = 0.06
"""… or within this many metres, whichever is larger."""

VIEW = view_from(-60.0, 22.0)
ROOM = 0.2
LOWEST, HIGHEST = 1.2, 4.2
"""Inches of the panels' height."""
OUTWARDS = 0.08
"""How far beyond its organ a name stands, as a share of the way from the middle."""


def cloud(points: PointCloud, result: ScanResult) -> Figure:
    """Two panels: the cloud in its own colours, and coloured by the organ whose sensors are near."""
    if not len(points.points):
        return say(new_figure(2.0), points.outcome.value)
    kept = evenly(len(points.points), MOST_POINTS)
    near_last = kept[np.argsort(VIEW.project(points.points[kept])[:, 2], kind="stable")]
    low, high = limits_around(VIEW.project(points.points[kept])[:, :2], room=ROOM)
    across, up = high - low
    figure = new_figure(float(np.clip(FULL_WIDTH / 2 * up / across, LOWEST, HIGHEST)) + 0.7)
    title = f"Point cloud at t = {points.time:g} s: {len(points.points):,} points"
    figure.suptitle(title, fontsize=TITLE + 0.5, x=0.01, ha="left")
    panels = figure.subplots(1, 2)
    for axes in panels:
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
        axes.set_axis_off()
    draw_landmarks(panels[0], VIEW, low, high, room=ROOM)
    _by_color(panels[0], points, near_last)
    _by_organ(panels[1], points.points[near_last], result)
    return figure


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


def _by_color(axes: Axes, points: PointCloud, kept: Int[np.ndarray, " kept"]) -> None:
    x, y, _ = VIEW.project(points.points[kept]).T
    axes.scatter(x, y, c=np.clip(points.colors[kept], 0, 1), s=1.6, linewidths=0)
    axes.set_title("in its own colours", fontsize=LABEL)


def _by_organ(axes: Axes, shown: Float[np.ndarray, "points 3"], result: ScanResult) -> None:
    grids = tuple(organ.displacement.sensors for organ in result.organs)
    labels = organ_labels(shown, grids)
    x, y, _ = VIEW.project(shown).T
    axes.scatter(x[labels < 0], y[labels < 0], c="#c4c4c4", s=1.0, linewidths=0)
    for index, grid in enumerate(grids):
        mine = labels == index
        axes.scatter(x[mine], y[mine], color=CYCLE[index % len(CYCLE)], s=1.8, linewidths=0)
        _name(axes, grid, shown.mean(axis=0))
    axes.set_title("by organ (grey: none)", fontsize=LABEL)


def _name(axes: Axes, grid: SensorGrid, middle: Float[np.ndarray, " 3"]) -> None:
    """The organ's name at its end that is farthest from the cloud's middle: colours alone do not survive grey."""
    end = grid.positions[np.argmax(np.linalg.norm(grid.positions - middle, axis=1))]
    paper = {"boxstyle": "round,pad=0.15", "facecolor": "white", "edgecolor": "none", "alpha": 0.75}
    x, y, _ = VIEW.project(end + OUTWARDS * (end - middle))
    axes.text(x, y, grid.organ, fontsize=LABEL - 1, ha="center", va="center", bbox=paper, zorder=1000)
