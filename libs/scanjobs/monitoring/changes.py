"""Where a series changed its level, and whether it has a trend: for people to look at beside the charts.

Change points: PELT (Killick, Fearnhead & Eckley 2012) with a squared-error cost, by `ruptures`; the penalty is that of
the Bayesian information criterion, 2 σ² ln n for the two parameters of a segment. Trend: Mann-Kendall with Hamed &
Rao's (1998) correction for serial correlation, and Sen's slope, by `pymannkendall`.
"""

import warnings
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np

DAY_S: Final = 24 * 3600.0
FEWEST: Final = 8
"""Scans below which neither question is asked."""
SHORTEST: Final = 3
"""Scans of a segment at least."""
SMALLEST: Final = 1.0
"""A step that is smaller than the scatter about the segments, times this, is not told."""


@dataclass(frozen=True, slots=True)
class ChangePoint:
    """The first scan of a new level, and the levels before and after."""

    scan: int
    before: float
    after: float


@dataclass(frozen=True, slots=True)
class Trend:
    """Sen's slope per day and the probability of as much by chance."""

    per_day: float
    p_value: float
    word: str
    """`increasing`, `decreasing` or `no trend` (p > 0.05)."""


def change_points(values: np.ndarray) -> tuple[ChangePoint, ...]:
    """Level changes of a series without gaps."""
    if len(values) < FEWEST:
        return ()
    import ruptures  # here: it takes long to import, and only who computes charts needs it

    sigma = scatter(values)
    if sigma <= 0.0:
        return ()
    search = ruptures.Pelt(model="l2", min_size=SHORTEST, jump=1).fit(values)
    ends = search.predict(pen=2.0 * sigma**2 * np.log(len(values)) + sigma**2 * np.log(len(values)))
    bounds = [0, *ends]
    levels = [float(values[a:b].mean()) for a, b in pairwise(bounds)]
    found = (ChangePoint(b, levels[k], levels[k + 1]) for k, b in enumerate(bounds[1:-1]))
    return tuple(point for point in found if abs(point.after - point.before) > SMALLEST * sigma)


def scatter(values: np.ndarray) -> float:
    """Standard deviation from scan to scan, whatever the level does: by the median of differences, for normal noise."""
    differences = np.abs(np.diff(values))
    return float(np.median(differences)) / (0.6745 * np.sqrt(2.0))


def trend(at: np.ndarray, values: np.ndarray) -> Trend | None:
    """The trend of a series, times in seconds; None for too few scans."""
    if len(values) < FEWEST or np.ptp(values) == 0.0:
        return None
    import pymannkendall  # here, as above

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = pymannkendall.hamed_rao_modification_test(values)
    slope = sen_slope(at / DAY_S, values)
    return Trend(per_day=slope, p_value=float(found.p), word=str(found.trend))


def sen_slope(days: np.ndarray, values: np.ndarray) -> float:
    """Median slope of all pairs; times need not be even (which `pymannkendall` assumes)."""
    chosen = np.unique(np.linspace(0, len(days) - 1, min(len(days), 400)).round().astype(int))
    first, second = np.triu_indices(len(chosen), k=1)
    apart = days[chosen][second] - days[chosen][first]
    rise = values[chosen][second] - values[chosen][first]
    return float(np.median(rise[apart > 0] / apart[apart > 0]))
