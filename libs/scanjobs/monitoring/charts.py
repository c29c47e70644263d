"""Control charts over a plant's scans: EWMA of what all tracks do together, CUSUM of each track, T² of all at once.

Scores come from `learning` and are standard normals while nothing changes; limits come from `limits` and the rate of
false alarms that is wanted, shared among the charts. Scans of the reference are learned and not charted. Later scans
are learned until a chart signals: stopping at half a limit was seen to freeze an unlucky mean, which then signals by
itself (ten times the false alarms). A score counts at most `CLIP`, and T² needs two scans: one bad scan is no alarm.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from scanjobs.monitoring.learning import Normal
from scanjobs.monitoring.limits import cusum_limit, ewma_limit, t2_limit, twice_in_a_row

WEIGHT: Final = 0.25
"""Of the newest scan in the EWMA: best for shifts of one to two standard deviations (Lucas & Saccucci 1990)."""
SLACK: Final = 0.5
"""Of the CUSUM: best for a shift of one standard deviation."""
CLIP: Final = 3.0
OUTLIERS: Final = 0.02
"""Share of scans that are wrong for reasons of their own: a gust, a camera that was touched."""
SHRUNK: Final = 8.0
"""Correlations of scores are estimated as if so many uncorrelated scans had been seen besides."""
COMMON: Final = -1
"""In the place of a track: all of them together."""


@dataclass(frozen=True, slots=True)
class Record:
    """What was measured: `values` (scans, tracks) are ln(f/f0), `stds` theirs; NaN where a track was not seen.

    `regressors` (scans, covariates) are finite and centred; `in_reference` (scans, tracks) says which scans tell what
    is normal; `charted` (scans,) which are in the charts.
    """

    values: np.ndarray
    stds: np.ndarray
    regressors: np.ndarray
    in_reference: np.ndarray
    charted: np.ndarray


@dataclass(slots=True)
class Chart:
    """One chart: `values[k]` at scan `scans[k]`, signalling where it is beyond `limits[k]`."""

    name: str
    track: int
    scans: list[int] = field(default_factory=list)
    values: list[float] = field(default_factory=list)
    limits: list[float] = field(default_factory=list)
    signals: list[bool] = field(default_factory=list)

    def add(self, scan: int, value: float, limit: float, signal: bool) -> None:
        """The next point."""
        self.scans.append(scan)
        self.values.append(value)
        self.limits.append(limit)
        self.signals.append(bool(signal))


@dataclass(frozen=True, slots=True)
class Watch:
    """The charts, the models they rest on (`COMMON` first), and the scores (scans, 1 + tracks) with the common first.

    `residuals` and `deviations` (scans, 1 + tracks) are ln(f/f0) beyond what is explained, and how well it is known.
    """

    charts: Mapping[tuple[str, int], Chart]
    models: tuple[Normal, ...]
    scores: np.ndarray
    residuals: np.ndarray
    deviations: np.ndarray
    signals: tuple[int, ...]
    """Scans at which some chart was beyond its limit."""


def watch(record: Record, run_length: float) -> Watch:
    """Chart a record so that a plant that does not change signals every `run_length` scans on average."""
    return _Watching(record, run_length).run()


class _Watching:
    """The state of `watch` between two scans."""

    def __init__(self, record: Record, run_length: float) -> None:
        tracks = record.values.shape[1]
        self._record = record
        self._run_length = run_length
        self._models = tuple(Normal(1 + record.regressors.shape[1]) for _ in range(1 + tracks))
        self._typical = np.array([_median(column) for column in record.stds.T] or [0.0])
        self._ewma = 0.0
        self._sums = np.zeros((tracks, 2))
        self._before = False
        self._products = np.zeros((tracks, tracks))
        self._counts = np.zeros((tracks, tracks))
        self._charts: dict[tuple[str, int], Chart] = {}

    def run(self) -> Watch:
        """All scans, one after the other."""
        count, tracks = self._record.values.shape
        scores, residuals, deviations = (np.full((count, 1 + tracks), np.nan) for _ in range(3))
        signals: list[int] = []
        for scan in range(count):
            values, weights, in_reference = self._of_scan(scan)
            row = np.concatenate([[1.0], self._record.regressors[scan]])
            for k, model in enumerate(self._models):
                if math.isfinite(values[k]) and model.is_ready:
                    residuals[scan, k], deviations[scan, k] = model.residual(row, values[k], weights[k])
                    scores[scan, k] = model.score(row, values[k], weights[k])
            worst = self._chart(scan, scores[scan], in_reference) if self._record.charted[scan] else 0.0
            if worst > 1.0:
                signals.append(scan)
            self._learn(row, values, weights, scores[scan], in_reference, trusted=worst <= 1.0)
        return Watch(self._charts, self._models, scores, residuals, deviations, tuple(signals))

    def _of_scan(self, scan: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Values, weights and whether they are the reference's, of all together and of each track."""
        values, reference = self._record.values[scan], self._record.in_reference[scan]
        seen = np.isfinite(values)
        if not seen.any():
            return np.full(1 + len(values), np.nan), np.ones(1 + len(values)), np.zeros(1 + len(values), bool)
        ratio = self._record.stds[scan] / np.maximum(self._typical, 1e-12)
        weights = 1.0 / np.maximum(1.0, np.where(np.isfinite(ratio), ratio, 1.0) ** 2)
        return (
            np.append(values[seen].mean(), values),
            np.append(weights[seen].mean(), weights),
            np.append(reference[seen].all(), reference),
        )

    def _chart(self, scan: int, scores: np.ndarray, in_reference: np.ndarray) -> float:
        """Move every chart on; the largest share of its limit that one has reached."""
        ready = np.isfinite(scores) & ~in_reference
        shares = [0.0]
        if ready[0]:
            shares.append(self._move_ewma(scan, scores[0]))
        for track in np.flatnonzero(ready[1:]):
            shares.append(self._move_cusum(scan, int(track), scores[1 + track]))
        if ready[1:].sum() >= 2:
            shares.append(self._move_t2(scan, scores[1:], np.flatnonzero(ready[1:])))
        return max(shares)

    def _move_ewma(self, scan: int, score: float) -> float:
        limit = ewma_limit(3.0 * self._run_length, WEIGHT)
        self._ewma += WEIGHT * (float(np.clip(score, -CLIP, CLIP)) - self._ewma)
        value = self._ewma / math.sqrt(WEIGHT / (2.0 - WEIGHT))
        self._chart_of("ewma", COMMON).add(scan, value, limit, abs(value) > limit)
        return abs(value) / limit

    def _move_cusum(self, scan: int, track: int, score: float) -> float:
        limit = cusum_limit(3.0 * self._run_length * len(self._sums), SLACK)
        step = float(np.clip(score, -CLIP, CLIP))
        up, down = self._sums[track]
        self._sums[track] = max(0.0, up + step - SLACK), max(0.0, down - step - SLACK)
        for name, value in zip(("cusum_up", "cusum_down"), self._sums[track], strict=True):
            self._chart_of(name, track).add(scan, float(value), limit, value > limit)
        return float(self._sums[track].max()) / limit

    def _move_t2(self, scan: int, scores: np.ndarray, ready: np.ndarray) -> float:
        counts = self._counts[np.ix_(ready, ready)]
        learned = int(counts.min())
        probability = twice_in_a_row(3.0 * self._run_length, OUTLIERS)
        limit = t2_limit(probability, len(ready), learned)
        if not math.isfinite(limit) or learned < len(ready) + 4:
            return 0.0
        correlations = self._correlations(ready, counts)
        value = float(scores[ready] @ np.linalg.solve(correlations, scores[ready]))
        beyond = value > limit
        self._chart_of("t2", COMMON).add(scan, value, limit, beyond and self._before)
        share = value / limit if beyond and self._before else min(value / limit, 1.0)
        self._before = beyond
        return share

    def _correlations(self, ready: np.ndarray, counts: np.ndarray) -> np.ndarray:
        """Correlations of the tracks' scores, drawn towards none as long as few scans are known."""
        products = self._products[np.ix_(ready, ready)] / (counts + SHRUNK)
        np.fill_diagonal(products, 1.0)
        return products

    def _learn(
        self,
        row: np.ndarray,
        values: np.ndarray,
        weights: np.ndarray,
        scores: np.ndarray,
        in_reference: np.ndarray,
        *,
        trusted: bool,
    ) -> None:
        learns = np.isfinite(values) & (in_reference | trusted)
        for k in np.flatnonzero(learns):
            self._models[k].learn(row, values[k], weights[k])
        known = np.isfinite(scores[1:]) & learns[1:]
        clipped = np.where(known, np.clip(scores[1:], -CLIP, CLIP), 0.0)
        self._products += np.outer(clipped, clipped)
        self._counts += np.outer(known, known)

    def _chart_of(self, name: str, track: int) -> Chart:
        return self._charts.setdefault((name, track), Chart(name, track))


def run_length_of(false_alarms_per_year: float, scans_per_year: float) -> float:
    """Scans between false alarms, where there may be so many a year."""
    return max(scans_per_year / false_alarms_per_year, 20.0)


def _median(column: np.ndarray) -> float:
    known: Sequence[float] = column[np.isfinite(column)].tolist()
    return float(np.median(known)) if known else 0.0
