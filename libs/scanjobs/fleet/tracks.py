"""Tracks as rows: list them, and what a person decided of them (pins), which every recomputation keeps.

A correction is always written as pins, a mode of a scan → a track (or none): merging pins every mode of one track to
the other, splitting pins the later ones to a new track, moving pins one, confirming pins it where it is.
"""

import math
from collections.abc import Sequence
from typing import Final

from sqlalchemy import ColumnElement, delete, insert, select, update
from sqlalchemy.orm import Session

from scanjobs.clock import now_s
from scanjobs.errors import IllegalTransition, NotFound
from scanjobs.fleet.plants import UNSYNCHRONISED
from scanjobs.fleet.tables import Observation, Plant, Track, TrackPin
from scanjobs.table_base import table_of
from scanjobs.uuids import new_id

NEW: Final = "new"


class TracksMeet(IllegalTransition):
    """Two modes of one scan would be in one track; move one of them away first."""

    code = "TRACKS_MEET"


def list_tracks(session: Session, plant: Plant) -> tuple[Track, ...]:
    """The tracks of a plant: living ones first, by frequency."""
    query = select(Track).where(Track.plant_key == plant.key)
    return tuple(session.scalars(query.order_by(Track.active.desc(), Track.frequency_hz, Track.id)))


def get_track(session: Session, track_id: str, *, owner: str) -> tuple[Plant, Track]:
    """An owner's track, and its plant. Raises `NotFound`."""
    query = select(Plant, Track).join(Plant, Plant.key == Track.plant_key)
    row = session.execute(query.where(Track.id == track_id, Plant.owner == owner)).one_or_none()
    if row is None:
        raise NotFound(f"there is no track {track_id}.", hint="List them with GET /v1/tracks?plant=….")
    return row[0], row[1]


def name_of(track: Track) -> str:
    """What a person calls it, or organ and number."""
    return called(track.name, track.organ, track.number)


def called(name: str | None, organ: str, number: int) -> str:
    """What a person calls a track, or its organ and number."""
    return name or f"{organ} · {number}"


def ratio_of(track: Track) -> tuple[float | None, float | None]:
    """f/f0 and its standard deviation."""
    if not track.reference_hz:
        return None, None
    ratio = track.frequency_hz / track.reference_hz
    if track.frequency_std_hz is None or track.reference_std_hz is None:
        return ratio, None
    spread = math.hypot(track.frequency_std_hz / track.frequency_hz, track.reference_std_hz / track.reference_hz)
    return ratio, ratio * spread


def rename(session: Session, track: Track, name: str | None) -> None:
    """Call it so; None is organ and number again."""
    session.execute(update(Track).where(Track.id == track.id).values(name=name), execution_options=UNSYNCHRONISED)


def merge(session: Session, plant: Plant, track: Track, into: str) -> None:
    """Every mode of a track goes to another one of the plant. Raises `NotFound` or `TracksMeet`."""
    target = _sibling(session, plant, into, track)
    _pin(session, plant, _modes_of(session, track), target.id)


def split(session: Session, plant: Plant, track: Track, scan_id: str) -> str:
    """This scan's mode and later ones become a new track, whose id is returned. Raises `NotFound`."""
    modes = _modes_of(session, track)
    at = next((mode.at for mode in modes if mode.scan_id == scan_id), None)
    if at is None:
        raise NotFound(
            "the track has no mode of that scan.", where="/split_at/scan", hint="Choose a scan it was seen in."
        )
    later = [mode for mode in modes if mode.at >= at]
    if len(later) == len(modes):
        raise IllegalTransition("the track begins with that scan.", where="/split_at/scan", hint="Choose a later scan.")
    made = new_id()
    _pin(session, plant, later, made)
    return made


def move(session: Session, plant: Plant, mode: Observation, to: str | None) -> str | None:
    """A mode goes to a track, to a new one, or to none; the track's id. Raises `NotFound` or `TracksMeet`."""
    target = new_id() if to == NEW else None if to is None else _sibling(session, plant, to).id
    _pin(session, plant, [mode], target)
    return target


def confirm(session: Session, plant: Plant, track: Track, scan_id: str) -> None:
    """The link to this scan's mode is right. Raises `NotFound`."""
    modes = [mode for mode in _modes_of(session, track) if mode.scan_id == scan_id]
    if not modes:
        raise NotFound(
            "the track has no mode of that scan.", where="/confirm/scan", hint="Choose a scan it was seen in."
        )
    _pin(session, plant, modes, track.id)


def release(session: Session, plant: Plant, track: Track) -> None:
    """Forget what was done by hand to the modes that are in this track."""
    session.execute(delete(TrackPin).where(TrackPin.track_id == track.id))
    _touch(session, plant)


def mode_of(session: Session, plant: Plant, scan_id: str, organ: str, mode: int) -> Observation:
    """A mode of a plant's scan. Raises `NotFound`."""
    which = (Observation.scan_id == scan_id, Observation.organ == organ, Observation.mode == mode)
    query = select(Observation).where(Observation.plant_key == plant.key, *which)
    found = session.scalars(query).one_or_none()
    if found is None:
        raise NotFound("the plant has no such mode.", where="/move", hint="See GET /v1/plants/{id}/history.")
    return found


def pins_of(session: Session, plant: Plant) -> dict[tuple[str, str, int], str | None]:
    """What people decided: (scan, organ, mode) → track or none."""
    rows = session.scalars(select(TrackPin).where(TrackPin.plant_key == plant.key))
    return {(row.scan_id, row.organ, row.mode): row.track_id for row in rows}


def _modes_of(session: Session, track: Track) -> tuple[Observation, ...]:
    query = select(Observation).where(Observation.track_id == track.id)
    return tuple(session.scalars(query.order_by(Observation.at)))


def _sibling(session: Session, plant: Plant, track_id: str, other_than: Track | None = None) -> Track:
    query = select(Track).where(Track.id == track_id, Track.plant_key == plant.key)
    found = session.scalars(query).one_or_none()
    if found is None or found is other_than:
        hint = "Use another track of the same plant."
        raise NotFound(f"the plant has no other track {track_id}.", where="/merge_into", hint=hint)
    return found


def _pin(session: Session, plant: Plant, modes: Sequence[Observation], track_id: str | None) -> None:
    if track_id is not None:
        _refuse_meeting(session, modes, track_id)
    for mode in modes:
        session.execute(delete(TrackPin).where(*_same(mode)))
    rows = [
        {
            "scan_id": mode.scan_id,
            "organ": mode.organ,
            "mode": mode.mode,
            "plant_key": plant.key,
            "track_id": track_id,
        }
        for mode in modes
    ]
    session.execute(insert(table_of(TrackPin)).values(created_at=now_s()), rows)
    _touch(session, plant)


def _touch(session: Session, plant: Plant) -> None:
    touched = update(Plant).where(Plant.key == plant.key).values(touched=Plant.touched + 1)
    session.execute(touched, execution_options=UNSYNCHRONISED)


def _refuse_meeting(session: Session, modes: Sequence[Observation], track_id: str) -> None:
    """A track has one mode of a scan."""
    moving = {(mode.scan_id, mode.organ, mode.mode) for mode in modes}
    scans = {mode.scan_id for mode in modes}
    query = select(Observation).where(Observation.scan_id.in_(scans), Observation.track_id == track_id)
    for other in session.scalars(query):
        if (other.scan_id, other.organ, other.mode) not in moving:
            what = f"the scan {other.scan_id} has a mode in that track already."
            raise TracksMeet(what, hint="Move that one away first.")


def _same(mode: Observation) -> tuple[ColumnElement[bool], ...]:
    return (TrackPin.scan_id == mode.scan_id, TrackPin.organ == mode.organ, TrackPin.mode == mode.mode)
