"""Mode shapes in space (the paper's Figure 8) and frames of each magnified mode (Figure 9).

Displacement of a sensor = sum over axes of shape value times direction; shapes have a largest component of 1. A leaf is
drawn as a surface over its outline at rest, a branch as a tube over its centreline. Colour is the displacement along
the mode's main direction, from -1 to 1. A bar says how long a metre is, arrows where x, y and z point.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from nerfmodal.figures.landmarks import draw_landmarks, limits_around
from nerfmodal.figures.style import FULL_WIDTH, LABEL, SIGNED_MAP, TICK, TITLE, measured, new_figure, say
from nerfmodal.figures.view import View, far_to_near, light, view_across
from nerfmodal.geometry.skins import Skin, outline, skin_of
from nerfmodal.types import OrganResult, Verdict

MOST_SENSORS = 900
MOST_COLUMNS = 3
SWING = 0.16
"""Largest drawn displacement, as a share of the organ's length."""
HIGHEST, LOWEST = 2.6, 0.55
"""Inches of a panel's height."""
BAR_WIDTH = 0.75
"""Inches that the colour bar takes."""
PHASES = (0.0, 0.125, 0.25, 0.375, 0.5)
"""Of a period, from the largest swing one way to the other (Figure 9)."""
RANGE = Normalize(-1, 1)


@dataclass(frozen=True, slots=True, kw_only=True)
class DrawnMode:
    """One mode as it is drawn: vertices at rest, world displacement of a unit coordinate, and its signed size.

    `rest_lines` show the rest position: a sheet's outline, a rod's centreline.
    """

    rest: Float[np.ndarray, "vertices 3"]
    rest_lines: Float[np.ndarray, "lines 2 3"]
    motion: Float[np.ndarray, "vertices 3"]
    signed: Float[np.ndarray, " vertices"]
    direction: Float[np.ndarray, " 3"]
    triangles: Int[np.ndarray, "triangles 3"]
    magnification: float


def mode_shapes(organ: OrganResult) -> Figure:
    """Every mode of the organ at its largest swing, over the rest position (Figure 8)."""
    count = len(organ.model.frequencies)
    if not count:
        return say(new_figure(2.0), organ.model.outcome.value)
    modes = [drawn_mode(organ, k) for k in range(count)]
    figure, panels = panels_of(modes, count, min(MOST_COLUMNS, max(count, 2)), f"{organ.organ}: mode shapes, magnified")
    for k, (axes, mode) in enumerate(zip(panels, modes, strict=True)):
        axes.set_title(_measured(organ, k), fontsize=LABEL)
        draw_mode(axes, mode, 1.0)
    return figure


def magnified_frames(organ: OrganResult) -> Figure:
    """Half a period of each mode alone (the others suppressed, eq 17 with beta = 0), magnified (Figure 9)."""
    count = len(organ.model.frequencies)
    if not count:
        return say(new_figure(2.0), organ.model.outcome.value)
    modes = [drawn_mode(organ, k) for k in range(count)]
    title = f"{organ.organ}: each mode alone, magnified, from its largest swing through half a period"
    figure, panels = panels_of(modes, count * len(PHASES), len(PHASES), title)
    moments = [(k, phase) for k in range(count) for phase in PHASES]
    for axes, (k, phase) in zip(panels, moments, strict=True):
        axes.set_title(_moment(organ, k, phase), fontsize=TICK)
        draw_mode(axes, modes[k], float(np.cos(2 * np.pi * phase)))
    return figure


def panels_of(modes: list[DrawnMode], count: int, columns: int, title: str) -> tuple[Figure, list[Axes]]:
    """`count` panels, as many for each mode, with one scale; a mode's first says the scale and the directions."""
    low, high = limits_around(np.concatenate([view_of(mode).project(reach_of([mode]))[:, :2] for mode in modes]))
    across, up = high - low
    width = (FULL_WIDTH - BAR_WIDTH) / columns
    height = float(np.clip(width * up / across, LOWEST, HIGHEST))
    rows = -(-count // columns)
    figure = new_figure(rows * (height + 0.3) + 0.5)
    figure.suptitle(title, fontsize=TITLE + 0.5, x=0.01, ha="left")
    grid = figure.subplots(rows, columns, squeeze=False).ravel().tolist()
    for axes in grid:
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal", anchor="C")
        axes.set_axis_off()
    for axes, mode in zip(grid[:: count // len(modes)], modes, strict=False):
        draw_landmarks(axes, view_of(mode), low, high)
    bar = figure.colorbar(ScalarMappable(RANGE, SIGNED_MAP), ax=grid, ticks=[-1, 0, 1], shrink=0.6, aspect=18)
    bar.set_label("displacement / largest", fontsize=TICK)
    bar.ax.tick_params(labelsize=TICK)
    return figure, grid[:count]


def view_of(mode: DrawnMode) -> View:
    """The view across a mode's motion."""
    return view_across(mode.rest, mode.direction)


def drawn_mode(organ: OrganResult, k: int) -> DrawnMode:
    """Mode `k` of the organ, thinned to what a picture can show."""
    positions = organ.displacement.sensors.positions
    skin = skin_of(positions, organ.surface, most=MOST_SENSORS)
    motion = organ.model.mode_shapes[:, :, k] @ organ.displacement.directions
    direction = main_direction(motion)
    length = float(np.linalg.norm(np.ptp(positions, axis=0)))
    moved = motion[skin.sensor]
    return DrawnMode(
        rest=skin.vertices,
        rest_lines=rest_lines_of(organ, skin),
        motion=moved,
        signed=moved @ direction,
        direction=direction,
        triangles=skin.triangles,
        magnification=SWING * length / max(float(np.linalg.norm(motion, axis=1).max()), 1e-12),
    )


def rest_lines_of(organ: OrganResult, skin: Skin) -> Float[np.ndarray, "lines 2 3"]:
    """The outline of a sheet, the centreline of a rod."""
    if organ.surface != "cylinder":
        return skin.vertices[outline(skin.triangles)]
    sensors = organ.displacement.sensors.positions[list(dict.fromkeys(skin.sensor.tolist()))]
    return np.stack([sensors[:-1], sensors[1:]], axis=1)


def main_direction(motion: Float[np.ndarray, "sensors 3"]) -> Float[np.ndarray, " 3"]:
    """Unit vector that most of the motion is along, with the largest displacement positive."""
    direction = np.linalg.svd(motion, full_matrices=False)[2][0]
    largest = motion[np.argmax(np.linalg.norm(motion, axis=1))]
    return direction if largest @ direction >= 0 else -direction


def reach_of(modes: list[DrawnMode]) -> Float[np.ndarray, "points 3"]:
    """Every position that any of the modes reaches: one box for all panels, so that swings compare."""
    return np.concatenate([mode.rest + sign * mode.magnification * mode.motion for mode in modes for sign in (-1, 1)])


def _measured(organ: OrganResult, k: int) -> str:
    words = f"{measured(float(organ.model.frequencies[k]), float(organ.model.frequency_stds[k]))} Hz"
    verdict = organ.model.quality[k].verdict
    return words if verdict is Verdict.ACCEPTED else f"{words} [{verdict.value}]"


def _moment(organ: OrganResult, k: int, phase: float) -> str:
    frequency = float(organ.model.frequencies[k])
    return f"{frequency:.4g} Hz: 0 ms" if phase == 0 else f"{1e3 * phase / frequency:.0f} ms"


def draw_mode(axes: Axes, mode: DrawnMode, coordinate: float) -> None:
    """Paint a mode at this value of its coordinate, from -1 to 1, over its rest position."""
    view = view_of(mode)
    places = view.project(mode.rest + coordinate * mode.magnification * mode.motion)
    signed = coordinate * mode.signed
    axes.add_collection(
        LineCollection(list(view.project(mode.rest_lines)[:, :, :2]), colors="#8a8a8a", linewidths=0.7, zorder=3)
    )
    if not len(mode.triangles):
        axes.scatter(places[:, 0], places[:, 1], c=signed, cmap=SIGNED_MAP, norm=RANGE, s=4, linewidths=0)
        return
    corners = places[mode.triangles]
    order = far_to_near(corners)
    colors = ScalarMappable(RANGE, SIGNED_MAP).to_rgba(signed[mode.triangles].mean(axis=1))
    colors[:, :3] *= light(corners, mode.triangles)[:, None]
    faces = PolyCollection(
        list(corners[order, :, :2]), facecolors=colors[order], edgecolors=colors[order], linewidths=0.3, zorder=2
    )
    axes.add_collection(faces)
