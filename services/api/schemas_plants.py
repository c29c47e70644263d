"""What the API says of plants, and what may be asked of them."""

import re
from datetime import datetime
from typing import Annotated, Any, Literal

from pydantic import AwareDatetime, BaseModel, BeforeValidator, Field, StrictBool, StringConstraints
from pydantic_core import PydanticCustomError
from scanjobs.fleet.environment import COLUMNS
from scanjobs.fleet.tables import Plant, PlantEvent
from scanjobs.states import ScanState

from services.api.schemas import STATUS_OF, Status, instant
from services.api.schemas_access import Asked


def written_as_a_date(value: object) -> object:
    """What begins with year, month and day; pydantic would take bare numbers as seconds since 1970, too."""
    if isinstance(value, datetime) or (isinstance(value, str) and re.match(r"\d{4}-\d{2}-\d{2}", value)):
        return value
    raise PydanticCustomError("datetime_parsing", "Input should be a date and time as RFC 3339 writes it")


WORD = r"^[A-Za-z0-9][A-Za-z0-9_.-]*$"
LINE = r"^[^\x00-\x1f\x7f]*$"
PlantName = Annotated[str, StringConstraints(min_length=1, max_length=64, pattern=WORD)]
Label = Annotated[str, StringConstraints(max_length=64, pattern=LINE)]
LongLabel = Annotated[str, StringConstraints(max_length=120, pattern=LINE)]
Text = Annotated[str, StringConstraints(max_length=4000, pattern=r"^[^\x00]*$")]
Number = Annotated[float, Field(strict=True, ge=-1e12, le=1e12, allow_inf_nan=False)]
Tags = Annotated[list[PlantName], Field(max_length=32)]
Moment = Annotated[
    AwareDatetime, BeforeValidator(written_as_a_date), Field(description="RFC 3339, with its offset from UTC.")
]
Severity = Literal["notice", "warning", "critical"]


class Reference(Asked):
    """Which scans say what is normal: the first `scans` from `from` on, none of them after `until`."""

    from_: Moment | None = Field(default=None, alias="from")
    until: Moment | None = None
    scans: Annotated[int, Field(ge=6, le=10_000)] = 12


class Monitoring(Asked):
    """How closely the plant is watched."""

    false_alarms_per_year: Annotated[float, Field(strict=True, ge=0.001, le=100)] = 0.1
    covariates: Annotated[list[PlantName], Field(max_length=8)] | None = Field(
        default=None, description=f"Environment columns that explain changes; null is every one given: {COLUMNS[0]} …"
    )
    growth: StrictBool = Field(default=False, description="Whether a steady change with time is normal.")


class PlantChange(Asked):
    """What is to be another way; what is not given stays, null empties."""

    name: LongLabel | None = None
    treatment: Label | None = None
    position: Label | None = None
    study: Label | None = None
    species: LongLabel | None = None
    genotype: LongLabel | None = None
    replicate: Label | None = None
    block: Label | None = None
    tags: Tags | None = None
    notes: Text | None = None
    reference: Reference | None = None
    monitoring: Monitoring | None = None

    def columns(self, plant_id: str) -> dict[str, Any]:
        """What was given, as columns of the plant's row."""
        given = self.model_dump(exclude_unset=True, exclude={"reference", "monitoring", "id"})
        if "name" in given:
            given["name"] = given["name"] or plant_id
        if "notes" in given:
            given["notes"] = given["notes"] or ""
        if "tags" in given:
            given["tags"] = sorted(set(given["tags"] or []))
        if "reference" in self.model_fields_set:
            given |= _reference_columns(self.reference or Reference())
        if "monitoring" in self.model_fields_set:
            given |= (self.monitoring or Monitoring()).model_dump()
        return given


class NewPlant(PlantChange):
    """A plant that is to be watched; `id` is the word that a specification's `plant.id` says."""

    id: PlantName


class LastScan(BaseModel):
    """The last scan of a plant."""

    id: str
    status: Status
    state: str
    at: datetime


class LatestMode(BaseModel):
    """A track at the last scan whose modes were read."""

    track: str
    name: str
    organ: str
    frequency_hz: float
    frequency_std_hz: float | None
    ratio: float | None = Field(description="f/f0; null until the reference is there.")
    ratio_std: float | None
    doubtful: bool


class PlantRow(BaseModel):
    """A plant in a list."""

    id: str
    name: str
    position: str | None
    treatment: str | None
    study: str | None
    species: str | None
    genotype: str | None
    replicate: str | None
    block: str | None
    tags: list[str]
    scans: int
    last_scan: LastScan | None
    frequencies: list[LatestMode]
    ratio: float | None = Field(description="f/f0 of all tracks together (geometric mean).")
    spark: list[tuple[float, float]] = Field(description="Seconds since 1970 and f/f0 of all tracks together.")
    alarms: int = Field(description="Open and acknowledged ones.")
    worst: Severity | None
    next_due_at: datetime | None
    missed_scans: int
    created_at: datetime

    @classmethod
    def of(cls, row: Plant, next_due_at: float | None) -> "PlantRow":
        return cls.model_validate(_fields(row, next_due_at))


class PlantPage(BaseModel):
    """Plants in the order that was asked for."""

    items: list[PlantRow]
    next_cursor: str | None = Field(description="Opaque; null on the last page.")


class ReferenceDetail(BaseModel):
    """Which scans say what is normal."""

    from_: datetime | None = Field(alias="from")
    until: datetime | None
    scans: int


class PlantDetail(PlantRow):
    """A plant by itself."""

    notes: str
    reference: ReferenceDetail
    monitoring: Monitoring
    tracks: list["TrackDetail"]

    @classmethod
    def of_tracks(cls, row: Plant, next_due_at: float | None, tracks: list["TrackDetail"]) -> "PlantDetail":
        return cls.model_validate(
            _fields(row, next_due_at)
            | {
                "notes": row.notes,
                "tracks": tracks,
                "reference": {
                    "from": instant(row.reference_from),
                    "until": instant(row.reference_until),
                    "scans": row.reference_scans,
                },
                "monitoring": {
                    "false_alarms_per_year": row.false_alarms_per_year,
                    "covariates": row.covariates,
                    "growth": row.growth,
                },
            }
        )


class Facets(BaseModel):
    """How many plants there are of each kind: what a list can be filtered by."""

    plants: int
    alarms: int = Field(description="Plants with an open or acknowledged alarm.")
    treatments: dict[str, int]
    studies: dict[str, int]
    tags: dict[str, int]
    states: dict[str, int]


class NewEvent(Asked):
    """Something that was done to a plant."""

    at: Moment | None = Field(default=None, description="By default now.")
    kind: Literal["watering", "treatment", "note", "repotting", "pruning", "harvest", "other"]
    note: Text = ""
    amount: Number | None = None
    unit: Annotated[str, StringConstraints(max_length=32, pattern=LINE)] | None = None


class EventDetail(BaseModel):
    """Something that was done to a plant."""

    id: str
    at: datetime
    kind: str
    note: str
    amount: float | None
    unit: str | None

    @classmethod
    def of(cls, row: PlantEvent) -> "EventDetail":
        values = {name: getattr(row, name) for name in ("id", "kind", "note", "amount", "unit")}
        return cls.model_validate(values | {"at": instant(row.at)})


class EventList(BaseModel):
    """What was done to a plant, oldest first."""

    items: list[EventDetail]


class TrackDetail(BaseModel):
    """One mode of a plant through its scans."""

    id: str
    plant: str
    number: int
    name: str
    organ: str
    state: Literal["active", "ended"]
    born_at: datetime
    last_seen_at: datetime
    scans: int
    missed: int = Field(description="Scans between the first and the last sight that did not show it.")
    doubtful_links: int
    frequency_hz: float
    frequency_std_hz: float | None
    damping_ratio: float | None
    reference_hz: float | None
    reference_std_hz: float | None
    ratio: float | None
    ratio_std: float | None
    by_hand: bool = Field(description="Whether somebody has corrected it.")


def _reference_columns(asked: Reference) -> dict[str, Any]:
    return {
        "reference_from": asked.from_.timestamp() if asked.from_ else None,
        "reference_until": asked.until.timestamp() if asked.until else None,
        "reference_scans": asked.scans,
    }


def _fields(row: Plant, next_due_at: float | None) -> dict[str, Any]:
    same = ("id", "name", "position", "treatment", "study", "species", "genotype", "replicate", "block", "tags")
    last = None
    if row.last_scan_id is not None and row.last_scan_state is not None:
        last = {
            "id": row.last_scan_id,
            "status": STATUS_OF.get(ScanState(row.last_scan_state), "canceled"),
            "state": row.last_scan_state,
            "at": instant(row.last_scan_at),
        }
    return {name: getattr(row, name) for name in same} | {
        "scans": row.scans,
        "last_scan": last,
        "frequencies": row.latest,
        "ratio": row.ratio,
        "spark": row.spark,
        "alarms": row.open_alarms,
        "worst": row.worst,
        "next_due_at": instant(next_due_at),
        "missed_scans": row.missed_scans,
        "created_at": instant(row.created_at),
    }
