"""What the cameras see: the plant from two sides (the paper's Figure 4), and a mosaic of the views of one frame."""

import numpy as np
from matplotlib.figure import Figure

from nerfmodal.figures.style import FULL_WIDTH, TICK, evenly, new_figure
from nerfmodal.types import Frame

MOST_VIEWS = 12


def camera_views(frame: Frame) -> Figure:
    """Up to twelve views of `frame`, spread evenly over the rig, each with its camera's name."""
    shown = evenly(len(frame.images), MOST_VIEWS)
    columns = min(6 if len(shown) > 8 else 4, len(shown))
    rows = int(np.ceil(len(shown) / columns))
    side = FULL_WIDTH / columns
    figure = new_figure(rows * (side * _aspect(frame) + 0.2) + 0.3)
    for place, view in enumerate(shown):
        axes = figure.add_subplot(rows, columns, place + 1)
        axes.imshow(frame.images[view])
        axes.set_title(frame.rig.cameras[view].name, fontsize=TICK)
        axes.set_axis_off()
    figure.suptitle(
        f"{len(shown)} of {len(frame.images)} views at t = {frame.time:g} s", fontsize=TICK + 2, x=0.01, ha="left"
    )
    return figure


def plant_views(frame: Frame) -> Figure:
    """Two large views of `frame`, as nearly at right angles as the rig has (the paper's Figure 4)."""
    shown = sides(frame)
    figure = new_figure(FULL_WIDTH / len(shown) * _aspect(frame) + 0.3)
    for place, view in enumerate(shown):
        axes = figure.add_subplot(1, len(shown), place + 1)
        axes.imshow(frame.images[view])
        axes.set_title(frame.rig.cameras[view].name, fontsize=TICK)
        axes.set_axis_off()
    return figure


def sides(frame: Frame) -> tuple[int, ...]:
    """The view nearest to level, and the one that looks most nearly across it among those as level."""
    looking = np.stack([-camera.camera_to_world[:3, 2] for camera in frame.rig.cameras])
    first = int(np.argmin(np.abs(looking[:, 2])))
    across = np.abs(looking[:, :2] @ looking[first, :2]) + np.abs(looking[:, 2])
    across[first] = np.inf
    return (first, int(np.argmin(across))) if len(looking) > 1 else (first,)


def _aspect(frame: Frame) -> float:
    return frame.images.shape[1] / frame.images.shape[2]
