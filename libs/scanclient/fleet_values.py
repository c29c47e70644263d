"""What the service says of plants, as frozen values. Times are UTC; units stand in the names, as in the JSON."""

from dataclasses import dataclass
from datetime import datetime
from typing import Any


@dataclass(frozen=True, slots=True, kw_only=True)
class LatestMode:
    """A track of a plant at its last scan; `ratio` is f/f0."""

    track: str
    name: str
    organ: str
    frequency_hz: float
    frequency_std_hz: float | None
    ratio: float | None
    ratio_std: float | None
    doubtful: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Plant:
    """A plant in a list; `ratio` is f/f0 of all its tracks together."""

    id: str
    name: str
    treatment: str | None
    position: str | None
    study: str | None
    tags: tuple[str, ...]
    scans: int
    last_status: str | None
    last_scan_at: datetime | None
    frequencies: tuple[LatestMode, ...]
    ratio: float | None
    alarms: int
    worst: str | None

    @classmethod
    def parse(cls, body: dict[str, Any]) -> "Plant":
        last = body["last_scan"] or {}
        keys = ("id", "name", "treatment", "position", "study", "scans", "ratio", "alarms", "worst")
        return cls(
            **{key: body[key] for key in keys},
            tags=tuple(body["tags"]),
            last_status=last.get("status"),
            last_scan_at=moment(last.get("at")),
            frequencies=tuple(_latest(row) for row in body["frequencies"]),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Track:
    """One mode of a plant through its scans."""

    id: str
    plant: str
    name: str
    organ: str
    state: str
    scans: int
    missed: int
    doubtful_links: int
    frequency_hz: float
    reference_hz: float | None
    ratio: float | None
    ratio_std: float | None

    @classmethod
    def parse(cls, body: dict[str, Any]) -> "Track":
        return cls(**{key: body[key] for key in cls.__dataclass_fields__})


@dataclass(frozen=True, slots=True, kw_only=True)
class Alarm:
    """What is not as it should be with a plant: what changed, since when, how sure, and how long it took."""

    id: str
    plant: str
    kind: str
    severity: str
    state: str
    title: str
    what: str
    since: datetime | None
    detected_at: datetime | None
    delay_scans: int | None
    change_percent: float | None
    change_percent_std: float | None
    confidence: float | None
    opened_at: datetime
    note: str

    @classmethod
    def parse(cls, body: dict[str, Any]) -> "Alarm":
        times = {name: moment(body[name]) for name in ("since", "detected_at", "opened_at")}
        return cls(**{key: body[key] for key in cls.__dataclass_fields__ if key not in times}, **times)  # type: ignore[arg-type]


def moment(text: str | None) -> datetime | None:
    """RFC 3339 as a time."""
    return datetime.fromisoformat(text) if text else None


def _latest(row: dict[str, Any]) -> LatestMode:
    return LatestMode(**{key: row[key] for key in LatestMode.__dataclass_fields__})
