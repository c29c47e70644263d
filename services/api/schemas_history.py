"""What the API says of a plant's history: columns of equal length, null where something is not known."""

from collections.abc import Sequence
from datetime import datetime
from typing import Any, Literal

from pydantic import BaseModel, Field
from scanjobs.fleet.history import PlantHistory
from scanjobs.fleet.tables import Observation, Track
from scanjobs.states import ScanState

from services.api.schemas import STATUS_OF, Status, instant
from services.api.schemas_alarms import AlarmDetail
from services.api.schemas_environment import SeriesDetail, series_detail
from services.api.schemas_plants import EventDetail, TrackDetail
from services.api.schemas_tracks import detail_of

Numbers = list[float | None]
Link = Literal["born", "sure", "doubtful", "manual"]


class HistoryScan(BaseModel):
    """A scan of the plant."""

    id: str
    at: datetime
    status: Status
    state: str
    modes: int = Field(description="Of any verdict.")


class TrackPoints(BaseModel):
    """A track at the scans that show it."""

    scan: list[str]
    mode: list[int] = Field(description="Counted within the organ, as in modes.json.")
    at: list[datetime]
    frequency_hz: Numbers
    frequency_std_hz: Numbers
    damping_ratio: Numbers
    damping_ratio_std: Numbers
    amplitude_m: Numbers
    ratio: Numbers = Field(description="f/f0.")
    ratio_std: Numbers
    compensated_ratio: Numbers = Field(description="f/f0 without what covariates explain.")
    mac: Numbers = Field(description="Shape correlation with the track before; null where it cannot be compared.")
    link: list[Link | None]
    verdict: list[str]


class TrackHistory(TrackDetail):
    """A track with its points."""

    points: TrackPoints


class LooseMode(BaseModel):
    """A mode that belongs to no track."""

    scan: str
    at: datetime
    organ: str
    mode: int
    frequency_hz: float
    frequency_std_hz: float | None
    verdict: str


class ReferencePeriod(BaseModel):
    """Which scans say what is normal."""

    from_: datetime | None = Field(alias="from")
    until: datetime | None
    scans: int


class ChartDetail(BaseModel):
    """A control chart over time; `track` is null for all tracks together."""

    chart: Literal["ewma", "cusum_up", "cusum_down", "t2"]
    track: str | None
    at: list[datetime]
    value: list[float]
    limit: float = Field(description="Of an EWMA, on both sides.")
    signal: list[bool]


class EffectDetail(BaseModel):
    """How much ln f changes per unit of a covariate."""

    track: str
    covariate: str
    per_unit: float
    std: float


class ChangePointDetail(BaseModel):
    """A new level of f/f0 and when it began."""

    track: str
    at: datetime
    before: float
    after: float


class TrendDetail(BaseModel):
    """Sen's slope of f/f0 per day, and how likely as much is by chance (Mann-Kendall)."""

    track: str
    per_day: float
    p_value: float
    trend: str


class DriftDetail(BaseModel):
    """What was computed of the plant's drift, over all its scans."""

    reference: ReferencePeriod
    covariates: list[str]
    charts: list[ChartDetail]
    effects: list[EffectDetail]
    change_points: list[ChangePointDetail]
    trends: list[TrendDetail]


class HistoryDetail(BaseModel):
    """A plant over weeks."""

    plant: str
    scans: list[HistoryScan]
    tracks: list[TrackHistory]
    loose: list[LooseMode]
    environment: SeriesDetail
    events: list[EventDetail]
    drift: DriftDetail | None = Field(description="Null before the first mode was found.")
    alarms: list[AlarmDetail]


def history_detail(found: PlantHistory) -> HistoryDetail:
    """A history as the API tells it."""
    by_track: dict[str, list[Observation]] = {}
    for mode in found.modes:
        if mode.track_id is not None:
            by_track.setdefault(mode.track_id, []).append(mode)
    return HistoryDetail(
        plant=found.plant.id,
        scans=_scans(found),
        tracks=[_track(found, row, by_track.get(row.id, [])) for row in found.tracks],
        loose=[_loose(mode) for mode in found.modes if mode.track_id is None],
        environment=series_detail(found.environment),
        events=[EventDetail.of(row) for row in found.events],
        drift=None if found.drift is None else DriftDetail.model_validate(_dated(found.drift)),
        alarms=[AlarmDetail.of(row, found.plant) for row in found.alarms],
    )


def _scans(found: PlantHistory) -> list[HistoryScan]:
    counts: dict[str, int] = {}
    for mode in found.modes:
        counts[mode.scan_id] = counts.get(mode.scan_id, 0) + 1
    rows = [
        {
            "id": scan.id,
            "at": instant(scan.created_at),
            "status": STATUS_OF.get(ScanState(scan.state), "canceled"),
            "state": scan.state,
            "modes": counts.get(scan.id, 0),
        }
        for scan in found.scans
    ]
    return [HistoryScan.model_validate(row) for row in rows]


def _track(found: PlantHistory, row: Track, modes: Sequence[Observation]) -> TrackHistory:
    detail = detail_of(found.plant, row)
    return TrackHistory.model_validate(detail.model_dump() | {"points": _points(found, row, modes)})


def _points(found: PlantHistory, row: Track, modes: Sequence[Observation]) -> TrackPoints:
    f0 = row.reference_hz
    compensated = _compensated(found.drift or {}, row.id)
    same = ("frequency_hz", "frequency_std_hz", "damping_ratio", "damping_ratio_std", "amplitude_m", "mac")
    columns: dict[str, Any] = {
        name: [getattr(mode, name) for mode in modes] for name in (*same, "mode", "link", "verdict")
    }
    return TrackPoints(
        **columns,
        scan=[mode.scan_id for mode in modes],
        at=[moment for mode in modes if (moment := instant(mode.at))],
        ratio=[mode.frequency_hz / f0 if f0 else None for mode in modes],
        ratio_std=[mode.frequency_std_hz / f0 if f0 and mode.frequency_std_hz else None for mode in modes],
        compensated_ratio=[compensated.get(mode.scan_id) for mode in modes],
    )


def _compensated(drift: dict[str, Any], track_id: str) -> dict[str, float | None]:
    values = drift.get("compensated", {}).get(track_id, [])
    return dict(zip(drift.get("scans", []), values, strict=False))


def _loose(mode: Observation) -> LooseMode:
    same = ("organ", "mode", "frequency_hz", "frequency_std_hz", "verdict")
    values = {name: getattr(mode, name) for name in same}
    return LooseMode.model_validate(values | {"scan": mode.scan_id, "at": instant(mode.at)})


def _dated(drift: dict[str, Any]) -> dict[str, Any]:
    """The same with times as dates."""
    reference = drift["reference"]
    return drift | {
        "reference": reference | {name: instant(reference[name]) for name in ("from", "until")},
        "charts": [chart | {"at": [instant(at) for at in chart["at"]]} for chart in drift["charts"]],
        "change_points": [point | {"at": instant(point["at"])} for point in drift["change_points"]],
    }
