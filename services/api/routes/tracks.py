"""Tracks: one mode of a plant through its scans, and what a person corrects of them."""

from typing import Annotated

from fastapi import APIRouter, Path, Query
from scanjobs.fleet import tracks as corrections
from scanjobs.fleet.joining import join_plant
from scanjobs.fleet.plants import get_plant
from scanjobs.fleet.tables import Plant, Track
from scanjobs.fleet.tracks import get_track, list_tracks
from sqlalchemy.orm import Session

from services.api.dependencies import Owner, Parts, Submitter, TheParts, uuid_of
from services.api.routes.plants import PlantWord
from services.api.schemas_plants import TrackDetail
from services.api.schemas_tracks import TrackChange, TrackList, detail_of

WHERE = "GET /v1/tracks?plant=…"
TrackId = Annotated[str, Path(description="Id of a track.")]
router = APIRouter(prefix="/v1/tracks", tags=["tracks"])


@router.get("")
def list_(parts: TheParts, owner: Owner, plant: Annotated[PlantWord, Query()]) -> TrackList:
    """The tracks of a plant: living ones first, by frequency."""
    return _tracks(parts, plant, owner)


@router.get("/{track_id}")
def show(track_id: TrackId, parts: TheParts, owner: Owner) -> TrackDetail:
    """One track."""
    with parts.store.read() as session:
        return detail_of(*get_track(session, uuid_of(track_id, "track", WHERE), owner=owner))


@router.patch("/{track_id}")
def change(track_id: TrackId, asked: TrackChange, parts: TheParts, owner: Submitter) -> TrackList:
    """Correct a track; the plant is computed again at once, and its tracks are the answer.

    409 where two modes of one scan would be in one track.
    """
    which = uuid_of(track_id, "track", WHERE)

    def work(session: Session) -> str:
        plant, track = get_track(session, which, owner=owner)
        _correct(session, plant, track, asked)
        if asked.name is None:
            join_plant(session, get_plant(session, plant.id, owner=owner))
        return plant.id

    return _tracks(parts, parts.store.write(work), owner)


def _correct(session: Session, plant: Plant, track: Track, asked: TrackChange) -> None:
    if asked.name is not None:
        corrections.rename(session, track, asked.name or None)
    elif asked.merge_into is not None:
        corrections.merge(session, plant, track, asked.merge_into)
    elif asked.split_at is not None:
        corrections.split(session, plant, track, asked.split_at.scan)
    elif asked.move is not None:
        mode = corrections.mode_of(session, plant, asked.move.scan, asked.move.organ, asked.move.mode)
        corrections.move(session, plant, mode, asked.move.to)
    elif asked.confirm is not None:
        corrections.confirm(session, plant, track, asked.confirm.scan)
    else:
        corrections.release(session, plant, track)


def _tracks(parts: Parts, plant_id: str, owner: str) -> TrackList:
    with parts.store.read() as session:
        plant = get_plant(session, plant_id, owner=owner)
        return TrackList(items=[detail_of(plant, row) for row in list_tracks(session, plant)])
