"""Treatments side by side: f/f0 of plants as boxes, by day."""

from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Final

import numpy as np
from sqlalchemy import func, select
from sqlalchemy.orm import Session

from scanjobs.fleet.tables import Observation, Plant, Track

DAY_S: Final = 24 * 3600.0
NO_TREATMENT: Final = ""
Boxes = tuple[dict[str, "Box"], "Box", int]
"""By day (ISO), the last day of each plant, and how many plants there are."""


@dataclass(frozen=True, slots=True)
class Box:
    """Five numbers of a box plot, of `n` plants."""

    n: int
    lowest: float
    first: float
    median: float
    third: float
    highest: float


def boxes_by_treatment(
    session: Session,
    *,
    owner: str,
    study: str | None = None,
    since: float | None = None,
    until: float | None = None,
) -> dict[str, Boxes]:
    """Treatment → boxes; a plant counts once a day, with the mean of ln(f/f0) over its tracks and scans."""
    day = func.floor(Observation.at / DAY_S)
    ratio = func.avg(func.ln(Observation.frequency_hz / Track.reference_hz))
    query = (
        select(Plant.treatment, Plant.key, day, ratio)
        .join(Track, Track.plant_key == Plant.key)
        .join(Observation, Observation.track_id == Track.id)
        .where(Plant.owner == owner, Track.reference_hz > 0)
        .group_by(Plant.treatment, Plant.key, day)
        .order_by(day)
    )
    if study is not None:
        query = query.where(Plant.study == study)
    if since is not None:
        query = query.where(Observation.at >= since)
    if until is not None:
        query = query.where(Observation.at <= until)
    by_day: dict[str, dict[str, list[float]]] = {}
    last: dict[str, dict[str, float]] = {}
    for treatment, key, number, mean in session.execute(query):
        name = treatment or NO_TREATMENT
        date = f"{datetime.fromtimestamp(float(number) * DAY_S, UTC):%Y-%m-%d}"
        by_day.setdefault(name, {}).setdefault(date, []).append(float(np.exp(mean)))
        last.setdefault(name, {})[key] = float(np.exp(mean))
    return {
        name: (
            {date: box_of(values) for date, values in days.items()},
            box_of(list(last[name].values())),
            len(last[name]),
        )
        for name, days in sorted(by_day.items())
    }


def box_of(values: list[float]) -> Box:
    """The box of some values."""
    return Box(len(values), *(float(number) for number in np.percentile(values, [0, 25, 50, 75, 100])))
