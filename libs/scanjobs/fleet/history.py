"""A plant between two moments, read for people: scans, modes by track, surroundings, events, charts, alarms."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from sqlalchemy import select
from sqlalchemy.orm import Session

from scanjobs.fleet.alarms import list_alarms
from scanjobs.fleet.environment import Series, list_events, series_of
from scanjobs.fleet.tables import Alarm, Observation, Plant, PlantEvent, Track
from scanjobs.fleet.tracks import list_tracks
from scanjobs.states import ScanState
from scanjobs.tables import Scan

ALARMS = 200


@dataclass(frozen=True, slots=True)
class PlantHistory:
    """What `read_history` found. `modes` are the oldest first; `drift` is the document of `documents`."""

    plant: Plant
    scans: tuple[Scan, ...]
    tracks: tuple[Track, ...]
    modes: tuple[Observation, ...]
    environment: Series
    events: tuple[PlantEvent, ...]
    drift: dict[str, Any] | None
    alarms: tuple[Alarm, ...]


def read_history(
    session: Session, plant: Plant, *, since: float | None = None, until: float | None = None, most: int = 500
) -> PlantHistory:
    """A plant's history; of more than `most` scans the newest."""
    query = select(Scan).where(
        Scan.owner == plant.owner,
        Scan.plant == plant.id,
        Scan.state.not_in((ScanState.DELETING, ScanState.DELETED)),
    )
    if since is not None:
        query = query.where(Scan.created_at >= since)
    if until is not None:
        query = query.where(Scan.created_at <= until)
    newest = query.order_by(Scan.created_at.desc(), Scan.id.desc()).limit(most)
    scans = tuple(reversed(session.scalars(newest).all()))
    first = scans[0].created_at if len(scans) == most else since
    return PlantHistory(
        plant=plant,
        scans=scans,
        tracks=list_tracks(session, plant),
        modes=_modes(session, plant, scans),
        environment=series_of(session, plant, since=first, until=until),
        events=list_events(session, plant, since=first, until=until),
        drift=plant.drift,
        alarms=tuple(row[0] for row in list_alarms(session, owner=plant.owner, plant_id=plant.id, limit=ALARMS)),
    )


def _modes(session: Session, plant: Plant, scans: Sequence[Scan]) -> tuple[Observation, ...]:
    if not scans:
        return ()
    query = select(Observation).where(
        Observation.plant_key == plant.key,
        Observation.at >= scans[0].created_at,
        Observation.at <= scans[-1].created_at,
    )
    return tuple(session.scalars(query.order_by(Observation.at, Observation.frequency_hz)))
