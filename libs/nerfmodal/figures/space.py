"""Axes in three dimensions: equal scales in metres."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from mpl_toolkits.mplot3d import Axes3D

from nerfmodal.figures.style import LABEL, TICK, TITLE, new_figure

BAR, HEAD, FOOT = 1.0, 0.4, 0.12
"""Inches kept free for the colour bar at the right, for the title, and below each panel."""
THINNEST = 0.3
"""No side of a box is drawn shorter than this share of its longest, or its ticks collide."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Panels:
    """A figure filled with three-dimensional panels, and the place of its colour bar."""

    figure: Figure
    axes: list[Axes3D]
    bar: Axes


def space_panels(count: int, columns: int, size: tuple[float, float], *, title: str) -> Panels:
    """`count` panels of `size` inches in rows of `columns`, placed by hand: layout engines leave 3D axes small."""
    rows = -(-count // columns)
    width, height = max(columns * size[0] + BAR, 3.6), rows * size[1] + HEAD
    figure = new_figure(height, width=width)
    figure.set_layout_engine("none")
    figure.text(0.06 / width, 1 - 0.08 / height, title, fontsize=TITLE + 0.5, va="top")
    left = (width - BAR - columns * size[0]) / 2
    axes = []
    for place in range(count):
        corner = (left + (place % columns) * size[0], height - HEAD - (place // columns + 1) * size[1])
        axes.append(
            _space(
                figure,
                (corner[0] / width, (corner[1] + FOOT) / height, size[0] / width, (0.92 * size[1] - FOOT) / height),
            )
        )
    length = min(1.6, 0.7 * (height - HEAD))
    bar = figure.add_axes(
        ((width - BAR + 0.3) / width, (height - HEAD - length) / 2 / height, 0.11 / width, length / height)
    )
    return Panels(figure=figure, axes=axes, bar=bar)


def _space(figure: Figure, place: tuple[float, float, float, float]) -> Axes3D:
    """A three-dimensional panel with quiet walls."""
    axes = figure.add_axes(place, projection="3d")
    assert isinstance(axes, Axes3D)
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.set_pane_color((0.97, 0.97, 0.97, 1.0))
        axis.line.set_color("#9a9a9a")
        axis._axinfo["grid"].update(color="#dddddd", linewidth=0.5)
    axes.tick_params(labelsize=TICK - 1, pad=-3)
    return axes


def frame_points(axes: Axes3D, points: Float[np.ndarray, "points 3"], *, zoom: float = 1.0) -> None:
    """Limits around the points with one scale on all three axes; few ticks, labels in metres."""
    low, high = points.min(axis=0), points.max(axis=0)
    span = np.maximum(high - low, THINNEST * (high - low).max() + 1e-9)
    middle = (low + high) / 2
    for name, centre, extent in zip("xyz", middle, span, strict=True):
        getattr(axes, f"set_{name}lim")(centre - 0.52 * extent, centre + 0.52 * extent)
        getattr(axes, f"set_{name}label")(f"{name} (m)", fontsize=LABEL - 1, labelpad=-6)
        ticks = MaxNLocator(int(np.clip(4 * extent / span.max(), 1, 4)) + 1, prune="both")  # ends of two axes collide
        getattr(axes, f"{name}axis").set_major_locator(ticks)
    axes.set_box_aspect(span, zoom=zoom)
