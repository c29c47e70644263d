"""What tells size and direction in a picture without axes: a bar of a round length, and arrows along x, y and z."""

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes

from nerfmodal.figures.style import TICK
from nerfmodal.figures.view import View, nice_length

ROOM = 0.42
"""Height of the corner for the landmarks in a small panel, as a share of the panel's shorter side."""
ARROW = 1 / 3
"""Length of the arrows as a share of that height."""
MARGIN = 0.04
THINNEST = 0.25
"""No side of a panel is shorter than this share of the other."""


def limits_around(
    seen: Float[np.ndarray, "points 2"], *, room: float = ROOM
) -> tuple[Float[np.ndarray, " 2"], Float[np.ndarray, " 2"]]:
    """The corners, metres to the right and up, around everything that is drawn and a corner for the landmarks."""
    low, high = seen.min(axis=0), seen.max(axis=0)
    span = np.maximum(high - low, THINNEST * (high - low).max() + 1e-9)
    middle = (low + high) / 2
    low, high = middle - (0.5 + MARGIN) * span, middle + (0.5 + MARGIN) * span
    low[1] -= room * (high - low).min()
    return low, high


def draw_landmarks(
    axes: Axes, view: View, low: Float[np.ndarray, " 2"], high: Float[np.ndarray, " 2"], *, room: float = ROOM
) -> None:
    """Below what is drawn: arrows along x, y, z at the left, a length at the right."""
    across, up = high - low
    arrow = ARROW * room * min(across, up)
    foot = low + np.array([1.3 * arrow, 1.0 * arrow])
    for name, tip in zip("xyz", arrow * view.project(np.eye(3))[:, :2], strict=True):
        axes.plot(*zip(foot, foot + tip, strict=True), color="#444444", linewidth=0.8)
        x, y = foot + 1.45 * tip
        axes.text(x, y, name, fontsize=TICK - 1, ha="center", va="center")
    length = nice_length(0.4 * across)
    right = high[0] - MARGIN * across
    axes.plot((right - length, right), (foot[1], foot[1]), color="#222222", linewidth=1.6, solid_capstyle="butt")
    axes.text(
        right - length / 2, foot[1] + 0.25 * arrow, f"{length:g} m", fontsize=TICK - 0.5, ha="center", va="bottom"
    )
