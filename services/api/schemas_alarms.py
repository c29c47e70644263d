"""What the API says of alarms."""

from datetime import datetime
from typing import Any, Literal

from pydantic import BaseModel, Field, StrictBool
from scanjobs.fleet.alarms import document_of
from scanjobs.fleet.tables import Alarm, Plant

from services.api.schemas import instant
from services.api.schemas_access import Asked
from services.api.schemas_plants import Severity, Text

TIMES = ("since", "detected_at", "recovered_at", "opened_at", "acknowledged_at", "closed_at")


class AlarmChange(Asked):
    """What a person says of an alarm."""

    state: Literal["acknowledged", "closed"] | None = None
    note: Text | None = None
    new_reference: StrictBool = Field(default=False, description="With `closed`: f0 and the charts begin anew here.")


class AlarmDetail(BaseModel):
    """What is not as it should be with a plant."""

    id: str
    plant: str
    plant_name: str
    treatment: str | None
    kind: Literal["drift", "lost_mode", "scans_failing", "scan_missed"]
    severity: Severity
    state: Literal["open", "acknowledged", "closed"]
    title: str
    what: str
    since: datetime | None = Field(description="When it began, as far as the data tell.")
    since_scan: str | None
    detected_at: datetime | None = Field(description="The scan that showed it.")
    detected_scan: str | None
    delay_scans: int | None
    delay_s: float | None
    change_percent: float | None = Field(description="Of the frequencies, beyond what covariates explain.")
    change_percent_std: float | None
    confidence: float | None = Field(
        description="Probability that an unchanged plant would not have given it in as many scans."
    )
    charts: list[str]
    tracks: list[str]
    recovered_at: datetime | None = Field(description="Since when the charts are back within their limits.")
    opened_at: datetime
    acknowledged_at: datetime | None
    closed_at: datetime | None
    closed_by: Literal["user", "data"] | None
    note: str

    @classmethod
    def of(cls, alarm: Alarm, plant: Plant) -> "AlarmDetail":
        document: dict[str, Any] = document_of(alarm, plant)
        return cls.model_validate(document | {name: instant(document.get(name)) for name in TIMES})


class AlarmPage(BaseModel):
    """Alarms, the newest first."""

    items: list[AlarmDetail]
    next_cursor: str | None = Field(description="Opaque; null on the last page.")
