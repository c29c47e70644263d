"""From a plant's tracks and its surroundings to charts and one finding: what changed, since when, how sure.

y of a track is ln(f/f0); f0 is its mean over the reference scans. Covariates (temperature …) that were measured at the
scans and vary in the reference are regressors, centred there; with `growth` the time is one more. What they explain is
taken away before anything is charted, with the uncertainty of how well they are known (`learning`).
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from scanjobs.monitoring.charts import COMMON, WEIGHT, Record, Watch, run_length_of, watch
from scanjobs.monitoring.limits import cusum_run_length, ewma_run_length

DAY_S: Final = 24 * 3600.0
YEAR_S: Final = 365.25 * DAY_S
EXPLAINING: Final = ("temperature_c", "light_umol_m2_s", "humidity_percent")
"""Covariates that are used unless others are asked for. Soil water and mass are no nuisance: they are what dries."""
SCANS_PER_COVARIATE: Final = 6
"""Reference scans for each covariate at least; those at the end of the list are left out."""
COVERED: Final = 0.8
"""Share of the scans at which a covariate must be known."""
RECOVERED: Final = 6
"""Scans within the limits after which a plant counts as back to normal."""
SURE: Final = 0.95
LARGE: Final = 0.05
"""Changes of f beyond this are critical: 5 % of f is 10 % of stiffness, or of mass."""
SMALL: Final = 0.02


@dataclass(frozen=True, slots=True)
class History:
    """A plant's tracks at its scans: `frequencies` and `stds` (scans, tracks) Hz, NaN where not seen; `at` seconds."""

    at: np.ndarray
    frequencies: np.ndarray
    stds: np.ndarray
    covariates: Mapping[str, np.ndarray]


@dataclass(frozen=True, slots=True, kw_only=True)
class Wish:
    """How a plant is watched."""

    reference_from: float | None = None
    reference_until: float | None = None
    reference_scans: int = 12
    false_alarms_per_year: float = 0.1
    covariates: Sequence[str] | None = None
    growth: bool = False
    charts_from: float | None = None


@dataclass(frozen=True, slots=True)
class Effect:
    """How much a covariate changes ln f of a track per unit."""

    track: int
    covariate: str
    per_unit: float
    std: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """A drift. Scans are indices; `change` is relative (-0.03 is 3 % lower)."""

    onset: int
    detected: int
    delay_scans: int
    delay_s: float
    change: float
    change_std: float
    confidence: float
    charts: tuple[str, ...]
    tracks: tuple[int, ...]
    recovered: int | None

    @property
    def severity(self) -> str:
        """`notice`, `warning` or `critical`, by the size of the change."""
        size = abs(self.change)
        return "critical" if size >= LARGE else "warning" if size >= SMALL else "notice"


@dataclass(frozen=True, slots=True)
class Drift:
    """All that is known of a plant's drift: `references` (tracks,) Hz with stds, `in_reference` (scans, tracks) …"""

    references: np.ndarray
    reference_stds: np.ndarray
    in_reference: np.ndarray
    compensated: np.ndarray
    """f/f0 (scans, tracks) at the reference's mean surroundings."""
    covariates: tuple[str, ...]
    effects: tuple[Effect, ...]
    charts: Watch
    finding: Finding | None


def drift(history: History, wish: Wish) -> Drift:
    """Charts and finding of a plant's history."""
    in_reference = _reference(history, wish)
    references, reference_stds = _means(history, in_reference)
    values = np.log(history.frequencies) - np.log(references)
    names, regressors = _regressors(history, wish, in_reference)
    charted = np.ones(len(history.at), bool) if wish.charts_from is None else history.at > wish.charts_from
    record = Record(values, history.stds / history.frequencies, regressors, in_reference, charted)
    run_length = run_length_of(wish.false_alarms_per_year, scans_per_year(history.at))
    found = watch(record, run_length)
    return Drift(
        references=references,
        reference_stds=reference_stds,
        in_reference=in_reference,
        compensated=np.exp(values - _explained(found, regressors)),
        covariates=names,
        effects=_effects(found, names),
        charts=found,
        finding=_finding(history, found),
    )


def scans_per_year(at: np.ndarray) -> float:
    """By the median pause between scans; two a day where that is not known."""
    pauses = np.diff(at)
    pauses = pauses[pauses > 0]
    return YEAR_S / float(np.median(pauses)) if len(pauses) else 730.0


def _reference(history: History, wish: Wish) -> np.ndarray:
    """The first so many scans of each track within the reference period."""
    within = np.ones(len(history.at), bool)
    if wish.reference_from is not None:
        within &= history.at >= wish.reference_from
    if wish.reference_until is not None:
        within &= history.at <= wish.reference_until
    seen = np.isfinite(history.frequencies) & within[:, None]
    return seen & (np.cumsum(seen, axis=0) <= wish.reference_scans)


def _means(history: History, in_reference: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """f0 of each track and its standard deviation, Hz; NaN where no reference scan shows the track."""
    logs = np.where(in_reference, np.log(history.frequencies), np.nan)
    counts = in_reference.sum(axis=0)
    references = np.full(logs.shape[1], np.nan)
    stds = np.full(logs.shape[1], np.nan)
    for k in np.flatnonzero(counts):
        known = logs[in_reference[:, k], k]
        references[k] = math.exp(float(known.mean()))
        if len(known) > 1:
            stds[k] = references[k] * float(known.std(ddof=1)) / math.sqrt(len(known))
    return references, stds


def _regressors(history: History, wish: Wish, in_reference: np.ndarray) -> tuple[tuple[str, ...], np.ndarray]:
    """Names and columns (scans, covariates), centred on the reference; what is not known there is no regressor."""
    reference = in_reference.any(axis=1)
    most = max(int(reference.sum()) // SCANS_PER_COVARIATE - 1, 0)
    wanted = EXPLAINING if wish.covariates is None else wish.covariates
    columns = {name: history.covariates[name] for name in wanted if name in history.covariates}
    if wish.growth:
        columns = {"days": history.at / DAY_S} | columns
    usable = {name: column for name, column in columns.items() if _is_usable(column, reference)}
    names = tuple(usable)[:most]
    centred = [usable[name] - usable[name][reference & np.isfinite(usable[name])].mean() for name in names]
    filled = [np.where(np.isfinite(column), column, 0.0) for column in centred]
    return names, np.column_stack(filled) if filled else np.zeros((len(history.at), 0))


def _is_usable(column: np.ndarray, reference: np.ndarray) -> bool:
    known = np.isfinite(column)
    varied = column[known & reference]
    return bool(known.mean() >= COVERED and len(varied) >= SCANS_PER_COVARIATE and varied.std() > 1e-9)


def _explained(found: Watch, regressors: np.ndarray) -> np.ndarray:
    """What the covariates explain of ln(f/f0) (scans, tracks)."""
    slopes = [model.coefficients[1:] for model in found.models[1:]]
    return np.column_stack([regressors @ slope for slope in slopes]) if slopes else np.zeros((len(regressors), 0))


def _effects(found: Watch, names: tuple[str, ...]) -> tuple[Effect, ...]:
    return tuple(
        Effect(track, name, float(model.coefficients[1 + k]), float(model.coefficient_stds[1 + k]))
        for track, model in enumerate(found.models[1:])
        if model.is_ready
        for k, name in enumerate(names)
    )


def _finding(history: History, found: Watch) -> Finding | None:
    """The first signal, and what followed; None without one."""
    if not found.signals:
        return None
    detected = found.signals[0]
    scores = found.scores[:, 0]
    charted = [scan for scan in _charted(found) if np.isfinite(scores[scan])]
    onset = _onset(scores, [scan for scan in charted if scan <= detected])
    last = found.signals[-1]
    later = [scan for scan in charted if scan > last]
    after = [scan for scan in charted if onset <= scan <= last]
    change, change_std = _shift(found, after)
    return Finding(
        onset=onset,
        detected=detected,
        delay_scans=sum(1 for scan in charted if onset < scan <= detected) + 1,
        delay_s=float(history.at[detected] - history.at[onset]),
        change=change,
        change_std=change_std,
        confidence=_confidence(found, len([scan for scan in charted if scan <= detected])),
        charts=tuple(dict.fromkeys(chart.name for chart in found.charts.values() if any(chart.signals))),
        tracks=_moved(found, after),
        recovered=later[0] if len(later) >= RECOVERED else None,
    )


def _charted(found: Watch) -> list[int]:
    """Scans that are in a chart."""
    return sorted({scan for chart in found.charts.values() for scan in chart.scans})


def _onset(scores: np.ndarray, charted: list[int]) -> int:
    """The scan that a step of the mean most likely began with: Hinkley 1970, the largest (sum of scores)² / scans."""
    backwards = np.cumsum(scores[charted][::-1])
    likelihoods = backwards**2 / np.arange(1, len(backwards) + 1)
    return charted[len(charted) - 1 - int(np.argmax(likelihoods))]


def _shift(found: Watch, after: list[int]) -> tuple[float, float]:
    """Mean relative change of all tracks since the onset, and its standard deviation, that of the normal included."""
    model, residuals = found.models[0], found.residuals[after, 0]
    scan_std = model.deviation / math.sqrt(len(after))
    normal_std = model.deviation / math.sqrt(max(model.learned, 1))
    change = math.expm1(float(residuals.mean()))
    return change, (1.0 + change) * math.hypot(scan_std, normal_std)


def _moved(found: Watch, after: list[int]) -> tuple[int, ...]:
    """Tracks whose own mean score since the onset is more than two standard deviations away."""
    moved = []
    for track in range(found.scores.shape[1] - 1):
        known = found.scores[after, 1 + track]
        known = known[np.isfinite(known)]
        if len(known) and abs(known.mean()) * math.sqrt(len(known)) > 2.0:
            moved.append(track)
    return tuple(moved)


def _confidence(found: Watch, scans: int) -> float:
    """Probability that no plant that does not change would have reached these levels in so many scans."""
    lengths = [1.0]
    for (name, track), chart in found.charts.items():
        if not any(chart.signals):
            continue
        highest = max(abs(value) for value, on in zip(chart.values, chart.signals, strict=True) if on)
        if name == "ewma" and track == COMMON:
            lengths.append(ewma_run_length(min(highest, 6.0), WEIGHT))
        elif name.startswith("cusum"):
            lengths.append(cusum_run_length(highest, 0.5) / max(found.scores.shape[1] - 1, 1))
    if len(lengths) == 1:  # T² alone
        return SURE
    return math.exp(-scans / max(lengths))
