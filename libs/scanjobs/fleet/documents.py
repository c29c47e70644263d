"""What was computed of a plant's drift as plain JSON, kept in its row: charts, effects, change points, trends."""

from typing import Any

import numpy as np

from scanjobs.fleet.findings import Findings
from scanjobs.monitoring.changes import change_points, trend
from scanjobs.monitoring.charts import COMMON
from scanjobs.monitoring.drift import Drift

MOST_POINTS = 2000
"""Of a chart; the newest are kept."""


def drift_document(found: Findings) -> dict[str, Any]:
    """Charts over time, what covariates explain, change points and trends; times are seconds since 1970."""
    watched = found.drift
    assert watched is not None
    reference = np.flatnonzero(watched.in_reference.any(axis=1))
    at = found.history.at
    return {
        "reference": {
            "from": float(at[reference[0]]) if len(reference) else None,
            "until": float(at[reference[-1]]) if len(reference) else None,
            "scans": len(reference),
        },
        "covariates": list(watched.covariates),
        "charts": [_chart(found, watched, key) for key in watched.charts.charts],
        "effects": [
            {
                "track": found.tracks[one.track].id,
                "covariate": one.covariate,
                "per_unit": one.per_unit,
                "std": one.std,
            }
            for one in watched.effects
        ],
        "change_points": _change_points(found, watched),
        "trends": _trends(found, watched),
        "compensated": {row.id: _column(watched.compensated[:, k]) for k, row in enumerate(found.tracks)},
        "scans": [scan.scan_id for scan in found.scans],
    }


def _chart(found: Findings, watched: Drift, key: tuple[str, int]) -> dict[str, Any]:
    chart = watched.charts.charts[key]
    newest = slice(-MOST_POINTS, None)
    return {
        "chart": chart.name,
        "track": None if chart.track == COMMON else found.tracks[chart.track].id,
        "at": [float(found.history.at[scan]) for scan in chart.scans[newest]],
        "value": [round(value, 4) for value in chart.values[newest]],
        "limit": round(chart.limits[-1], 4),
        "signal": chart.signals[newest],
    }


def _change_points(found: Findings, watched: Drift) -> list[dict[str, Any]]:
    rows = []
    for k, row in enumerate(found.tracks):
        known = np.flatnonzero(np.isfinite(watched.compensated[:, k]))
        for point in change_points(watched.compensated[known, k]):
            at = float(found.history.at[known[point.scan]])
            rows.append({"track": row.id, "at": at, "before": point.before, "after": point.after})
    return rows


def _trends(found: Findings, watched: Drift) -> list[dict[str, Any]]:
    rows = []
    for k, row in enumerate(found.tracks):
        known = np.flatnonzero(np.isfinite(watched.compensated[:, k]))
        told = trend(found.history.at[known], watched.compensated[known, k])
        if told is not None:
            rows.append({"track": row.id, "per_day": told.per_day, "p_value": told.p_value, "trend": told.word})
    return rows


def _column(values: np.ndarray) -> list[float | None]:
    return [round(float(value), 6) if np.isfinite(value) else None for value in values]
