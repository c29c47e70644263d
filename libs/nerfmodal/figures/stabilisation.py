"""Stabilisation diagram: the poles of models of rising order, over the spectrum of what they were read from.

A pole that the next order finds again is a filled dot, any other a small cross; the identified modes are upright lines,
dashed where the mode is doubtful or rejected. So a line through a column of dots is what a mode should look like.
"""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from nerfmodal.figures.spectrum import power_spectral_density
from nerfmodal.figures.style import BLUE, GREY, LABEL, TICK, VERMILLION, label, new_figure, say
from nerfmodal.types import Diagram, OrganResult, Verdict

DECADES = 6
"""Of the spectrum that are shown below its peak."""


def stabilisation(organ: OrganResult) -> Figure:
    """The diagram of the organ's first method that has one."""
    figure = new_figure(3.0)
    diagram = diagram_of(organ)
    if diagram is None or not len(diagram.orders):
        return say(figure, "No model of rising order was fitted to this organ.")
    axes = figure.add_subplot()
    _spectrum(axes.twinx(), organ)
    axes.set_zorder(2)
    axes.patch.set_visible(False)
    _poles(axes, diagram)
    _modes(axes, organ)
    axes.set_xlim(0, organ.displacement.frame_rate / 2)
    axes.set_ylim(0, diagram.orders.max() + 2)
    axes.yaxis.set_major_locator(MaxNLocator(integer=True))
    label(axes, title=f"{organ.organ}: stabilisation diagram", x="frequency (Hz)", y="model order")
    figure.legend(loc="outside lower center", ncols=4, fontsize=TICK, frameon=False)
    return figure


def diagram_of(organ: OrganResult) -> Diagram | None:
    """The first opinion's diagram, if any has one."""
    return next((opinion.diagram for opinion in organ.opinions if opinion.diagram is not None), None)


def _poles(axes: Axes, diagram: Diagram) -> None:
    stable = diagram.stable
    axes.plot(
        diagram.frequencies[~stable], diagram.orders[~stable], "x", color=GREY, markersize=4, label="pole, not stable"
    )
    axes.plot(diagram.frequencies[stable], diagram.orders[stable], "o", color=BLUE, markersize=4, label="stable pole")


def _modes(axes: Axes, organ: OrganResult) -> None:
    styles = {True: ("-", "accepted mode"), False: ((0, (4, 2)), "doubtful or rejected mode")}
    named: set[bool] = set()
    for frequency, quality in zip(organ.model.frequencies, organ.model.quality, strict=True):
        accepted = quality.verdict is Verdict.ACCEPTED
        style, name = styles[accepted]
        axes.axvline(
            float(frequency),
            color=VERMILLION,
            linewidth=1.1,
            linestyle=style,
            zorder=1,
            label="_" if accepted in named else name,
        )
        named.add(accepted)


def _spectrum(axes: Axes, organ: OrganResult) -> None:
    """Sum of the components' densities: all that moves, per sensor, in mm²/Hz."""
    reduction, displacement = organ.reduction, organ.displacement
    if reduction is None or displacement.valid.sum() < 2:
        return
    scores = np.where(displacement.valid[:, None], reduction.scores, np.nan)
    densities = [power_spectral_density(displacement.times, score, displacement.frame_rate) for score in scores.T]
    total = 1e6 * np.sum([density for _, density in densities], axis=0) / max(len(reduction.mean), 1)
    peak = max(float(total.max()), 1e-12)
    axes.set_yscale("log")
    axes.set_ylim(peak * 10.0**-DECADES, peak * 4)
    axes.fill_between(densities[0][0], peak * 10.0**-DECADES, total, color="#e3e3e0", linewidth=0)
    axes.set_ylabel("mm²/Hz", fontsize=LABEL)
    axes.tick_params(labelsize=TICK)
    axes.spines[["top"]].set_visible(False)
