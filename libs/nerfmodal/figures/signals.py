"""Histories and spectra: principal components (the paper's Figure 6) and modal coordinates (Figure 7)."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from nerfmodal.figures.spectrum import power_spectral_density
from nerfmodal.figures.style import BLUE, GREY, LABEL, TICK, TITLE, VERMILLION, label, measured, new_figure, say
from nerfmodal.types import DisplacementMatrix, OrganResult, Verdict

NORMAL_95 = 1.96
DECADES = 6
"""Of a spectrum that are shown below its peak."""
FAINTEST = 1e-12
"""Peak in mm²/Hz below which a spectrum is drawn as nothing."""
MOST_COMPONENTS = 6
MOST_FRAMES = 300
"""Of a history that are drawn: more are one block of ink. The spectrum is always that of the whole record."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """One line of panels: a history in mm and, where it is a mode, what was identified of it."""

    title: str
    values: Float[np.ndarray, " frames"]
    frequency: float | None = None
    frequency_std: float = 0.0
    damping: float | None = None


def principal_components(organ: OrganResult) -> Figure:
    """Score of each principal component over time and its power spectral density (Figure 6)."""
    reduction = organ.reduction
    if reduction is None or not reduction.singular_values.any():
        return say(new_figure(2.0), organ.model.outcome.value)
    spread = np.sqrt(len(reduction.mean))
    energy = reduction.singular_values**2
    rows = [
        Row(
            title=f"component {k + 1}: {100 * energy[k] / energy.sum():.3g} % of energy",
            values=1e3 * score / spread,
        )
        for k, score in enumerate(reduction.scores.T[:MOST_COMPONENTS])
    ]
    return _draw(organ.displacement, rows, f"{organ.organ}: principal components (rms over the organ)")


def modal_coordinates(organ: OrganResult, excitation: str) -> Figure:
    """Each modal coordinate over time and its power spectral density with the identified frequency (Figure 7).

    The dashed envelope is the identified decay, drawn for a free decay alone; the band is the 95 % interval.
    """
    model = organ.model
    if not model.frequencies.size:
        return say(new_figure(2.0), model.outcome.value)
    rows = [
        Row(
            values=1e3 * model.coordinates[:, k],
            title=_remark(organ, k),
            frequency=float(model.frequencies[k]),
            frequency_std=float(model.frequency_stds[k]),
            damping=float(model.damping_ratios[k]) if excitation == "free_decay" else None,
        )
        for k in range(len(model.frequencies))
    ]
    return _draw(organ.displacement, rows, f"{organ.organ}: modal coordinates (largest displacement)")


def _remark(organ: OrganResult, k: int) -> str:
    model, quality = organ.model, organ.model.quality[k]
    frequency = measured(float(model.frequencies[k]), float(model.frequency_stds[k]))
    damping = measured(100 * float(model.damping_ratios[k]), 100 * float(model.damping_stds[k]))
    words = f"{frequency} Hz,  ζ = {damping} %"
    return words if quality.verdict is Verdict.ACCEPTED else f"{words}  [{quality.verdict.value}]"


def _draw(displacement: DisplacementMatrix, rows: list[Row], title: str) -> Figure:
    figure = new_figure(0.75 + 1.15 * len(rows))
    figure.suptitle(title, fontsize=TITLE + 0.5, x=0.01, ha="left")
    panels = figure.subplots(len(rows), 2, sharex="col", squeeze=False, width_ratios=(1.25, 1))
    for row, (left, right) in zip(rows, panels, strict=True):
        values = np.where(displacement.valid, row.values, np.nan)
        _history(left, displacement.times, values, row)
        _spectrum(right, displacement, values, row)
    panels[-1, 0].set_xlabel(_time_label(displacement.times), fontsize=LABEL)
    panels[-1, 1].set_xlabel("frequency (Hz)", fontsize=LABEL)
    return figure


def _time_label(times: Float[np.ndarray, " frames"]) -> str:
    if len(times) <= MOST_FRAMES:
        return "time (s)"
    first, whole = times[MOST_FRAMES - 1] - times[0], times[-1] - times[0]
    return f"time (s), the first {first:.3g} of {whole:.3g} s"


def _history(axes: Axes, times: Float[np.ndarray, " frames"], values: Float[np.ndarray, " frames"], row: Row) -> None:
    shown = times[:MOST_FRAMES]
    axes.plot(shown, values[:MOST_FRAMES], color=BLUE, linewidth=1.0, marker=".", markersize=2.5)
    if row.frequency is not None and row.damping is not None:
        envelope = _envelope(times, values, row.frequency, row.damping)[:MOST_FRAMES]
        axes.plot(shown, envelope, "--", shown, -envelope, "--", color=GREY, linewidth=0.9)
    label(axes, y="mm")
    axes.set_title(row.title, fontsize=LABEL, loc="left")


def _envelope(
    times: Float[np.ndarray, " frames"], values: Float[np.ndarray, " frames"], frequency: float, damping: float
) -> Float[np.ndarray, " frames"]:
    """Amplitude of the decaying sinusoid of known frequency and damping that fits best."""
    seen = np.isfinite(values)
    since = times - times[0]
    decay = np.exp(-2 * np.pi * frequency * damping * since)
    angle = 2 * np.pi * frequency * np.sqrt(max(0.0, 1 - damping**2)) * since
    waves = np.stack([decay * np.cos(angle), decay * np.sin(angle)], axis=1)
    amplitude = np.linalg.lstsq(waves[seen], values[seen], rcond=None)[0]
    return float(np.hypot(*amplitude)) * decay


def _spectrum(axes: Axes, displacement: DisplacementMatrix, values: Float[np.ndarray, " frames"], row: Row) -> None:
    if np.isfinite(values).sum() < 2:
        return
    frequencies, density = power_spectral_density(displacement.times, values, displacement.frame_rate)
    peak = max(float(density.max()), FAINTEST)
    axes.set_yscale("log")
    axes.set_xlim(0, displacement.frame_rate / 2)
    axes.set_ylim(peak * 10.0**-DECADES, peak * 4)
    axes.plot(frequencies, np.maximum(density, peak * 10.0**-DECADES), color=BLUE, linewidth=1.0)
    if row.frequency is not None:
        half = NORMAL_95 * row.frequency_std
        axes.axvspan(row.frequency - half, row.frequency + half, color=VERMILLION, alpha=0.25, linewidth=0)
        axes.axvline(row.frequency, color=VERMILLION, linewidth=0.9, linestyle=(0, (4, 2)))
    label(axes, y="mm²/Hz")
    axes.tick_params(axis="y", labelsize=TICK - 0.5)
