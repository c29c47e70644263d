"""Eigenvalues of the covariance of the displacements (the paper's Figure 5)."""

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from nerfmodal.figures.style import BLUE, GREY, LABEL, TICK, VERMILLION, label, new_figure, say
from nerfmodal.types import OrganResult

MOST_SHOWN = 21


def eigenvalues(organ: OrganResult) -> Figure:
    """Eigenvalues per sensor in mm² on a logarithmic scale, those kept filled, and their cumulative share."""
    figure = new_figure(2.6)
    if organ.reduction is None or not organ.reduction.singular_values.any():
        return say(figure, organ.model.outcome.value)
    values = covariance_eigenvalues(organ)
    rank = organ.reduction.scores.shape[1]
    _stems(figure, organ.organ, values[:MOST_SHOWN], rank)
    _shares(figure, values[:MOST_SHOWN], float(values.sum()), rank)
    return figure


def covariance_eigenvalues(organ: OrganResult) -> np.ndarray:
    """s² / (frames - 1) / dofs in mm²: the mean-square displacement that each component carries, (components,)."""
    assert organ.reduction is not None
    frames = max(2, int(organ.displacement.valid.sum()))
    dofs = len(organ.reduction.mean)
    return 1e6 * organ.reduction.singular_values**2 / ((frames - 1) * dofs)


def _stems(figure: Figure, name: str, values: np.ndarray, rank: int) -> None:
    axes = figure.add_subplot(1, 2, 1)
    order = np.arange(1, len(values) + 1)
    shown = np.maximum(values, values[0] * 1e-12)
    axes.vlines(order, shown.min() / 3, shown, color="#c9c9c9", linewidth=1)
    axes.plot(order[:rank], shown[:rank], "o", color=BLUE, markersize=5, label=f"kept ({rank})")
    axes.plot(order[rank:], shown[rank:], "o", mfc="white", mec=GREY, markersize=4, label="left out")
    axes.set_yscale("log")
    axes.set_ylim(shown.min() / 3, shown.max() * 3)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    label(axes, title=f"{name}: eigenvalues", x="component", y="mean square (mm²)")
    axes.legend(fontsize=TICK, frameon=False)


def _shares(figure: Figure, values: np.ndarray, total: float, rank: int) -> None:
    axes = figure.add_subplot(1, 2, 2)
    order = np.arange(1, len(values) + 1)
    share = 100 * np.cumsum(values) / total
    axes.plot(order, share, ".-", color=BLUE, linewidth=1, markersize=4)
    axes.plot(rank, share[rank - 1], "D", color=VERMILLION, markersize=5)
    axes.annotate(
        f"{share[rank - 1]:.2f} % in {rank}",
        (rank, share[rank - 1]),
        (8, -12),
        textcoords="offset points",
        fontsize=LABEL,
    )
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    label(axes, title="cumulative energy", x="components", y="share (%)")
