"""What the API says of treatments side by side."""

from pydantic import BaseModel, Field
from scanjobs.fleet.treatments import Box


class BoxDetail(BaseModel):
    """Five numbers of f/f0, of `n` plants."""

    n: int
    min: float
    q1: float
    median: float
    q3: float
    max: float


class DayBox(BoxDetail):
    """The box of a day."""

    day: str = Field(description="UTC, such as 2026-01-03.")


class TreatmentDetail(BaseModel):
    """A treatment; the empty word is that of plants without one."""

    treatment: str
    plants: int
    by_day: list[DayBox]
    latest: BoxDetail = Field(description="Each plant on the last day it was scanned.")


class TreatmentList(BaseModel):
    """All treatments."""

    items: list[TreatmentDetail]


def treatment_of(name: str, days: dict[str, Box], latest: Box, plants: int) -> TreatmentDetail:
    """A treatment as the API tells it."""
    by_day = [DayBox(day=day, **_numbers(box)) for day, box in days.items()]
    return TreatmentDetail(treatment=name, plants=plants, by_day=by_day, latest=BoxDetail(**_numbers(latest)))


def _numbers(box: Box) -> dict[str, float]:
    names = ("n", "min", "q1", "median", "q3", "max")
    return dict(zip(names, (box.n, box.lowest, box.first, box.median, box.third, box.highest), strict=True))
