"""What the API says of schedules."""

from datetime import datetime
from typing import Annotated, Any, Literal

from nerfmodal.spec import ScanSpec
from pydantic import BaseModel, Field, StrictBool, StringConstraints, model_validator
from scanjobs.fleet.schedules import next_of_cron, zone_of
from scanjobs.fleet.tables import Plant, Schedule, ScheduleRun

from services.api.schemas import instant
from services.api.schemas_access import Asked
from services.api.schemas_plants import LINE, PlantName

Hours = Annotated[float, Field(strict=True, ge=0.1, le=8760, allow_inf_nan=False)]
Cron = Annotated[
    str,
    StringConstraints(min_length=9, max_length=120, pattern=LINE),
    Field(description="Minute, hour, day, month, weekday, such as `0 6,18 * * *`."),
]
Zone = Annotated[
    str, StringConstraints(min_length=1, max_length=64, pattern=LINE), Field(description="Such as `America/Belem`.")
]
Minutes = Annotated[float, Field(strict=True, ge=0, le=10_080, allow_inf_nan=False)]


class ScheduleChange(Asked):
    """What is to be another way; what is not given stays."""

    every_hours: Hours | None = None
    cron: Cron | None = None
    time_zone: Zone | None = None
    spec: ScanSpec | None = Field(default=None, description="`source.path` may hold {plant}, {date} and {time}.")
    grace_minutes: Minutes | None = None
    enabled: StrictBool | None = None

    @model_validator(mode="after")
    def _one_rhythm(self) -> "ScheduleChange":
        if self.every_hours is not None and self.cron is not None:
            raise ValueError("every_hours and cron cannot both be given")
        return self

    def columns(self) -> dict[str, Any]:
        """What was given, as columns. Raises `InvalidInput` for times that never come."""
        given = self.model_dump(mode="json", exclude_none=True, exclude={"plant", "spec"})
        if self.time_zone is not None:
            zone_of(self.time_zone)
        if self.cron is not None:
            next_of_cron(self.cron, self.time_zone or "UTC", 0.0)
            given["every_hours"] = None
        if self.every_hours is not None:
            given["cron"] = None
        if self.spec is not None:
            given["spec"] = self.spec.model_dump(mode="json")
        return given


class NewSchedule(ScheduleChange):
    """A plant, when it is to be scanned, and from what."""

    plant: PlantName
    spec: ScanSpec = Field(description="`source.path` may hold {plant}, {date} and {time}; the plant is filled in.")
    time_zone: Zone = "UTC"
    grace_minutes: Minutes = Field(default=60.0, description="How long a source may be late before the scan is missed.")
    enabled: StrictBool = True

    @model_validator(mode="after")
    def _some_rhythm(self) -> "NewSchedule":
        if self.every_hours is None and self.cron is None:
            raise ValueError("every_hours or cron must be given")
        return self


class RunDetail(BaseModel):
    """What became of one time of a schedule."""

    due_at: datetime
    state: Literal["submitted", "missed"]
    scan: str | None
    reason: str

    @classmethod
    def of(cls, row: ScheduleRun) -> "RunDetail":
        values = {"due_at": instant(row.due_at), "state": row.state, "scan": row.scan_id, "reason": row.reason}
        return cls.model_validate(values)


class RunList(BaseModel):
    """The times of a schedule, the newest first."""

    items: list[RunDetail]


class ScheduleDetail(BaseModel):
    """When a plant is scanned, and from what."""

    id: str
    plant: str
    every_hours: float | None
    cron: str | None
    time_zone: str
    spec: dict[str, Any]
    grace_minutes: float
    enabled: bool
    next_due_at: datetime
    last: RunDetail | None

    @classmethod
    def of(cls, row: Schedule, plant: Plant, last: ScheduleRun | None) -> "ScheduleDetail":
        same = ("id", "every_hours", "cron", "time_zone", "spec", "grace_minutes", "enabled")
        values = {name: getattr(row, name) for name in same}
        more = {"plant": plant.id, "next_due_at": instant(row.next_due_at)}
        return cls.model_validate(values | more | {"last": RunDetail.of(last) if last else None})


class SchedulePage(BaseModel):
    """Schedules, the newest first."""

    items: list[ScheduleDetail]
    next_cursor: str | None = Field(description="Opaque; null on the last page.")
