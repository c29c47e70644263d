"""One look for every picture: Okabe-Ito colours, cividis maps, labels with units, white paper.

Figures are made through matplotlib's object interface (`Figure`, Agg); nothing here touches global state, so that
pictures can be drawn in any thread. Colours: Okabe & Ito, "Color Universal Design" (2008). Sequential and signed
values use cividis, whose lightness rises monotonically: a grey print keeps the order.
"""

from pathlib import Path

import numpy as np
from jaxtyping import Int
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

BLUE, VERMILLION, GREEN, PURPLE = "#0072B2", "#D55E00", "#009E73", "#CC79A7"
ORANGE, SKY, YELLOW, BLACK = "#E69F00", "#56B4E9", "#F0E442", "#000000"
CYCLE = (BLUE, ORANGE, GREEN, PURPLE, BLACK, SKY, VERMILLION, YELLOW)
"""Neighbours differ in lightness too, for grey prints."""
GREY = "#6b6b6b"
SIGNED_MAP = "cividis"

FULL_WIDTH = 7.2
"""Inches: the text width of a paper."""
DOTS_PER_INCH = 150
TITLE, LABEL, TICK = 9.5, 8.5, 7.5


def new_figure(height: float, *, width: float = FULL_WIDTH) -> Figure:
    """An empty figure of `width` by `height` inches, laid out so that no label is cut."""
    figure = Figure(figsize=(width, height), layout="constrained", facecolor="white")
    FigureCanvasAgg(figure)
    return figure


def save(figure: Figure, path: Path) -> None:
    """Write the figure as the file's suffix says (.png, .svg, .pdf)."""
    figure.savefig(path, dpi=DOTS_PER_INCH, facecolor="white", metadata=_undated(path.suffix))


def _undated(suffix: str) -> dict[str, None]:
    """Equal results give equal bytes: no date in the file."""
    return {".svg": {"Date": None}, ".pdf": {"CreationDate": None}}.get(suffix, {})


def label(axes: Axes, *, title: str = "", x: str = "", y: str = "") -> None:
    """Title left of centre, axis labels, quiet frame and ticks."""
    axes.set_title(title, fontsize=TITLE, loc="left")
    axes.set_xlabel(x, fontsize=LABEL)
    axes.set_ylabel(y, fontsize=LABEL)
    axes.tick_params(labelsize=TICK)
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(visible=True, color="#e4e4e4", linewidth=0.6)
    axes.set_axisbelow(True)


def say(figure: Figure, sentence: str) -> Figure:
    """Write a sentence where a picture has nothing to show."""
    figure.text(0.5, 0.5, sentence, ha="center", va="center", fontsize=TITLE, color=GREY)
    return figure


def evenly(count: int, most: int) -> Int[np.ndarray, " kept"]:
    """Indices of at most `most` of `count` things, evenly spread and always the same."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).round()).astype(int)


def measured(value: float, std: float) -> str:
    """Value ± standard deviation, both to the second digit of the latter: 2.1700 ± 0.0031."""
    if not (np.isfinite(std) and std > 0):
        return f"{value:.4g}"
    decimals = int(np.clip(1 - np.floor(np.log10(std)), 0, 9))
    return f"{value:.{decimals}f} ± {std:.{decimals}f}"
