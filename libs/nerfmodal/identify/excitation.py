"""What set the structure in motion: a pull that was let go, the wind, or a steady shaker; recognised or given.

Free decay and steady harmonic motion are sums of damped sinusoids, ambient motion is not: the share of the modal
coordinates' energy that a damped sinusoid at the mode's own frequency and damping explains tells them apart. What is
not explained must vibrate too: a weak decay drowned in noise is still a decay.
"""

from collections.abc import Sequence
from typing import Literal

import numpy as np
from jaxtyping import Float

from nerfmodal.identify.lines import damped_columns
from nerfmodal.types import OrganResult, Verdict

Excitation = Literal["free_decay", "ambient", "harmonic"]
EXPLAINED = 0.9
"""Share of the energy from which a record is a sum of damped sinusoids."""
MEMORY = 0.5
MEMORY_LAGS = 6
FALL = 0.1
"""ζ ω T from which a coordinate decays visibly over the record."""


def recognise(
    times: Float[np.ndarray, " frames"],
    coordinates: Float[np.ndarray, "frames modes"],
    frequencies: Float[np.ndarray, " modes"],
    damping_ratios: Float[np.ndarray, " modes"],
) -> Excitation:
    """The kind of excitation, from the modes found; without modes it is called a free decay."""
    energy = ((coordinates - coordinates.mean(axis=0)) ** 2).sum(axis=0) if coordinates.size else np.zeros(0)
    if energy.sum() == 0:
        return "free_decay"
    left = [
        _unexplained(times, series, line)
        for series, line in zip(coordinates.T, np.column_stack([frequencies, damping_ratios]), strict=True)
    ]
    if is_ambient(np.stack(left, axis=1), float(energy.sum())):
        return "ambient"
    fall = np.abs(damping_ratios) * 2 * np.pi * frequencies * (times[-1] - times[0])
    return "free_decay" if (energy * fall).sum() / energy.sum() > FALL else "harmonic"


def is_ambient(residuals: Float[np.ndarray, "frames channels"], energy: float) -> bool:
    """Whether what damped sinusoids leave of a record of this energy is much, and vibrates."""
    sizes = (residuals**2).sum(axis=0)
    memory = float((sizes * [_memory(series) for series in residuals.T]).sum() / max(float(sizes.sum()), 1e-300))
    return 1 - float(sizes.sum()) / max(energy, 1e-300) < EXPLAINED and memory > MEMORY


def excitation_of(
    organs: Sequence[OrganResult], given: Literal["auto", "free_decay", "ambient", "harmonic"]
) -> Excitation:
    """The excitation of a scan: the given one, or what most of its organs with accepted modes show."""
    if given != "auto":
        return given
    votes = [_vote(organ) for organ in organs if len(organ.model.frequencies)]
    return max(sorted(set(votes)), key=votes.count) if votes else "free_decay"


def _vote(organ: OrganResult) -> Excitation:
    model = organ.model
    accepted = np.array([quality.verdict is Verdict.ACCEPTED for quality in model.quality])
    chosen = accepted if accepted.any() else np.ones(len(accepted), dtype=bool)
    return recognise(
        organ.displacement.times, model.coordinates[:, chosen], model.frequencies[chosen], model.damping_ratios[chosen]
    )


def _unexplained(times: np.ndarray, series: np.ndarray, line: np.ndarray) -> np.ndarray:
    columns = damped_columns(times, line[None])
    solution = np.linalg.lstsq(columns, series, rcond=None)[0]
    return np.asarray(series - columns @ solution)


def _memory(series: np.ndarray) -> float:
    """The largest correlation with itself at the first lags: near 0 for noise, near 1 for a vibration."""
    total = float((series**2).sum())
    if total == 0:
        return 0.0
    return max(abs(float(series[lag:] @ series[:-lag])) / total for lag in range(1, MEMORY_LAGS + 1))
