"""Mode shapes in space (the paper's Figure 8) and frames of each magnified mode (Figure 9).

Displacement of a sensor = sum over axes of shape value times direction; shapes have a largest component of 1. A leaf is
drawn as a surface over its outline at rest, a branch as a tube over its centreline. Colour is the displacement along
the mode's main direction, from -1 to 1.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d import Axes3D
from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection

from nerfmodal.figures.space import Panels, frame_points, look_across, space_panels
from nerfmodal.figures.style import LABEL, SIGNED_MAP, TICK, TITLE, measured, new_figure, say
from nerfmodal.geometry.skins import outline, skin_of
from nerfmodal.types import OrganResult

MOST_SENSORS = 900
MOST_COLUMNS = 3
PANEL, SMALL_PANEL = (2.2, 2.15), (1.3, 1.2)
"""Inches."""
SWING = 0.16
"""Largest drawn displacement, as a share of the organ's length."""
FLAT = 0.7
"""An organ lower than this share of its largest side is flat."""
PHASES = (0.0, 0.125, 0.25, 0.375, 0.5)
"""Of a period, from the largest swing one way to the other (Figure 9)."""
RANGE = Normalize(-1, 1)


@dataclass(frozen=True, slots=True, kw_only=True)
class DrawnMode:
    """One mode as it is drawn: rest positions, world displacement of a unit coordinate, and its signed size."""

    rest: Float[np.ndarray, "sensors 3"]
    motion: Float[np.ndarray, "sensors 3"]
    signed: Float[np.ndarray, " sensors"]
    direction: Float[np.ndarray, " 3"]
    triangles: Int[np.ndarray, "triangles 3"]
    magnification: float


def mode_shapes(organ: OrganResult) -> Figure:
    """Every mode of the organ at its largest swing, over the rest position (Figure 8)."""
    count = len(organ.model.frequencies)
    if not count:
        return say(new_figure(2.0), organ.model.outcome.value)
    modes = [drawn_mode(organ, k) for k in range(count)]
    panels = space_panels(count, min(MOST_COLUMNS, count), PANEL, title=f"{organ.organ}: mode shapes, magnified")
    for k, (axes, mode) in enumerate(zip(panels.axes, modes, strict=True)):
        axes.set_title(_measured(organ, k), fontsize=TITLE, y=1.0)
        _draw(axes, mode, 1.0)
        frame_points(axes, reach_of(modes), zoom=0.85)
    _color_bar(panels)
    return panels.figure


def magnified_frames(organ: OrganResult) -> Figure:
    """Half a period of each mode alone (the others suppressed, eq 17 with beta = 0), magnified (Figure 9)."""
    count = len(organ.model.frequencies)
    if not count:
        return say(new_figure(2.0), organ.model.outcome.value)
    modes = [drawn_mode(organ, k) for k in range(count)]
    title = f"{organ.organ}: each mode alone, magnified, from its largest swing through half a period"
    panels = space_panels(count * len(PHASES), len(PHASES), SMALL_PANEL, title=title)
    moments = [(k, phase) for k in range(count) for phase in PHASES]
    for axes, (k, phase) in zip(panels.axes, moments, strict=True):
        axes.set_title(_moment(organ, k, phase), fontsize=LABEL, y=0.98)
        _draw(axes, modes[k], float(np.cos(2 * np.pi * phase)))
        frame_points(axes, reach_of(modes), zoom=_closeness(modes))
        axes.set_axis_off()
    _color_bar(panels)
    return panels.figure


def drawn_mode(organ: OrganResult, k: int) -> DrawnMode:
    """Mode `k` of the organ, thinned to what a picture can show."""
    positions = organ.displacement.sensors.positions
    skin = skin_of(positions, organ.surface, most=MOST_SENSORS)
    motion = organ.model.mode_shapes[:, :, k] @ organ.displacement.directions
    direction = _main_direction(motion)
    length = float(np.linalg.norm(np.ptp(positions, axis=0)))
    moved = motion[skin.sensor]
    return DrawnMode(
        rest=skin.vertices,
        motion=moved,
        signed=moved @ direction,
        direction=direction,
        triangles=skin.triangles,
        magnification=SWING * length / max(float(np.linalg.norm(motion, axis=1).max()), 1e-12),
    )


def _main_direction(motion: Float[np.ndarray, "sensors 3"]) -> Float[np.ndarray, " 3"]:
    """Unit vector that most of the motion is along, with the largest displacement positive."""
    direction = np.linalg.svd(motion, full_matrices=False)[2][0]
    largest = motion[np.argmax(np.linalg.norm(motion, axis=1))]
    return direction if largest @ direction >= 0 else -direction


def reach_of(modes: list[DrawnMode]) -> Float[np.ndarray, "points 3"]:
    """Every position that any of the modes reaches: one box for all panels, so that swings compare."""
    return np.concatenate([mode.rest + sign * mode.magnification * mode.motion for mode in modes for sign in (-1, 1)])


def _closeness(modes: list[DrawnMode]) -> float:
    """A flat organ leaves its panel half empty: go nearer."""
    span = np.ptp(reach_of(modes), axis=0)
    return 1.0 if span[2] > FLAT * span.max() else 1.2


def _measured(organ: OrganResult, k: int) -> str:
    return f"{measured(float(organ.model.frequencies[k]), float(organ.model.frequency_stds[k]))} Hz"


def _moment(organ: OrganResult, k: int, phase: float) -> str:
    frequency = float(organ.model.frequencies[k])
    return f"{frequency:.4g} Hz: 0 ms" if phase == 0 else f"{1e3 * phase / frequency:.0f} ms"


def _draw(axes: Axes3D, mode: DrawnMode, coordinate: float) -> None:
    moved = mode.rest + coordinate * mode.magnification * mode.motion
    if len(mode.triangles):
        _sheet(axes, moved, coordinate * mode.signed, mode.triangles)
        axes.add_collection3d(Line3DCollection(mode.rest[outline(mode.triangles)], colors="#555555", linewidths=0.7))
    else:
        axes.scatter(*mode.rest.T, s=1.0, c="#bdbdbd", linewidths=0, depthshade=False)
        axes.scatter(
            *moved.T, c=coordinate * mode.signed, cmap=SIGNED_MAP, norm=RANGE, s=5, linewidths=0, depthshade=False
        )
    look_across(axes, mode.rest, mode.direction)


def _sheet(
    axes: Axes3D,
    moved: Float[np.ndarray, "sensors 3"],
    signed: Float[np.ndarray, " sensors"],
    triangles: Int[np.ndarray, "triangles 3"],
) -> None:
    colors = ScalarMappable(RANGE, SIGNED_MAP).to_rgba(signed[triangles].mean(axis=1))
    faces = Poly3DCollection(moved[triangles], linewidths=0.3, facecolors=colors, edgecolors=colors)
    axes.add_collection3d(faces)


def _color_bar(panels: Panels) -> None:
    bar = panels.figure.colorbar(ScalarMappable(RANGE, SIGNED_MAP), cax=panels.bar, ticks=[-1, -0.5, 0, 0.5, 1])
    bar.set_label("displacement / largest", fontsize=LABEL - 1.5)
    bar.ax.tick_params(labelsize=TICK)
