"""A plant computed: rows of modes → tracks → charts → alarms, and what its row shows.

The mathematics is in `monitoring`; here rows become arrays and arrays become rows. Tracks keep their identity, name and
number through recomputation.
"""

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
from sqlalchemy import delete, select
from sqlalchemy.orm import Session

from scanjobs.fleet.alarms import DRIFT, LOST_MODE, SCANS_FAILING, settle_alarms
from scanjobs.fleet.documents import drift_document
from scanjobs.fleet.environment import at_moments, series_of
from scanjobs.fleet.findings import Findings
from scanjobs.fleet.reasons import reasons_for
from scanjobs.fleet.tables import Observation, Plant, PlantScan, Track
from scanjobs.fleet.tracks import name_of, pins_of, ratio_of
from scanjobs.monitoring.drift import Drift, History, Wish, drift
from scanjobs.monitoring.tracking import Course, Key, Placed, Seen, Tracks, track
from scanjobs.uuids import new_id

SPARK: Final = 40
"""Points of a sparkline."""
JOINED: Final = ("accepted", "doubtful")
FOUNDING: Final = "accepted"


def analyse(session: Session, plant: Plant) -> dict[str, Any]:
    """Write the plant's tracks, places of modes and alarms; returns the columns of its own row."""
    found = compute(session, plant)
    settle_alarms(session, plant, reasons_for(session, plant, found), {DRIFT, LOST_MODE, SCANS_FAILING})
    return _shown(found)


def compute(session: Session, plant: Plant) -> Findings:
    """Join the plant's modes into tracks and watch them."""
    scans = tuple(
        session.scalars(
            select(PlantScan)
            .where(PlantScan.plant_key == plant.key, PlantScan.problem.is_(None))
            .order_by(PlantScan.at, PlantScan.scan_id)
        )
    )
    query = select(Observation).where(Observation.plant_key == plant.key)
    modes = tuple(session.scalars(query.order_by(Observation.at, Observation.frequency_hz)))
    joined = track(_by_scan(scans, modes), pins_of(session, plant))
    tracks, labels = _write_tracks(session, plant, joined, modes)
    _write_places(session, modes, joined, labels)
    history = history_of(session, plant, scans, modes, tracks)
    watched = drift(history, wish_of(plant)) if tracks else None
    if watched is not None:
        _write_references(session, tracks, watched)
    return Findings(scans, modes, tracks, history, watched)


def history_of(
    session: Session,
    plant: Plant,
    scans: Sequence[PlantScan],
    modes: Sequence[Observation],
    tracks: Sequence[Track],
) -> History:
    """Frequencies of each track at each scan, and the surroundings then."""
    place = {scan.scan_id: k for k, scan in enumerate(scans)}
    column = {one.id: k for k, one in enumerate(tracks)}
    frequencies, stds = np.full((len(scans), len(tracks)), np.nan), np.full((len(scans), len(tracks)), np.nan)
    for mode in modes:
        if mode.track_id in column:
            where = place[mode.scan_id], column[mode.track_id]
            frequencies[where] = mode.frequency_hz
            stds[where] = np.nan if mode.frequency_std_hz is None else mode.frequency_std_hz
    at = np.array([scan.at for scan in scans])
    return History(at, frequencies, stds, at_moments(series_of(session, plant), at))


def wish_of(plant: Plant) -> Wish:
    """How a plant is watched."""
    return Wish(
        reference_from=plant.reference_from,
        reference_until=plant.reference_until,
        reference_scans=plant.reference_scans,
        false_alarms_per_year=plant.false_alarms_per_year,
        covariates=plant.covariates,
        growth=plant.growth,
        charts_from=plant.charts_from,
    )


def _by_scan(scans: Sequence[PlantScan], modes: Sequence[Observation]) -> list[list[Seen]]:
    seen: dict[str, list[Seen]] = {scan.scan_id: [] for scan in scans}
    for mode in modes:
        if mode.verdict in JOINED and mode.scan_id in seen:
            seen[mode.scan_id].append(_seen(mode))
    return list(seen.values())


def _seen(mode: Observation) -> Seen:
    return Seen(
        key=_key(mode),
        at=mode.at,
        frequency=mode.frequency_hz,
        std=mode.frequency_std_hz,
        shape=mode.shape,
        may_found=mode.verdict == FOUNDING,
        before=mode.track_id,
    )


def _key(mode: Observation) -> Key:
    return (mode.scan_id, mode.organ, mode.mode)


def _write_tracks(
    session: Session, plant: Plant, joined: Tracks, modes: Sequence[Observation]
) -> tuple[tuple[Track, ...], dict[int, str]]:
    """The rows of the courses, and each course's id; rows that no course has any more go."""
    rows = {row.id: row for row in session.scalars(select(Track).where(Track.plant_key == plant.key))}
    of_key = {_key(mode): mode for mode in modes}
    labels = {number: course.label or new_id() for number, course in enumerate(joined.courses)}
    numbers = _numbers(joined.courses, labels, rows)
    gone = rows.keys() - set(labels.values())
    if gone:
        session.execute(delete(Track).where(Track.id.in_(gone)))
    for number, course in enumerate(joined.courses):
        links = [joined.placed[key].link for key in course.keys]
        values = _columns(course, [of_key[key] for key in course.keys], links) | {"number": numbers[number]}
        row = rows.get(labels[number])
        if row is None:
            row = Track(id=labels[number], plant_key=plant.key, **values)
            session.add(row)
            rows[row.id] = row
        else:
            for name, value in values.items():
                setattr(row, name, value)
    session.flush()
    return tuple(rows[labels[number]] for number in range(len(joined.courses))), labels


def _numbers(courses: Sequence[Course], labels: Mapping[int, str], rows: Mapping[str, Track]) -> dict[int, int]:
    """Within an organ from 1; a track that has a number keeps it."""
    numbers = {k: rows[labels[k]].number for k in range(len(courses)) if labels[k] in rows}
    taken: dict[str, int] = {}
    for row in rows.values():
        taken[row.organ] = max(taken.get(row.organ, 0), row.number)
    for k, course in enumerate(courses):
        if k not in numbers:
            taken[course.organ] = taken.get(course.organ, 0) + 1
            numbers[k] = taken[course.organ]
    return numbers


def _columns(course: Course, modes: Sequence[Observation], links: Sequence[str | None]) -> dict[str, Any]:
    last = modes[-1]
    return {
        "organ": course.organ,
        "active": course.alive,
        "by_hand": "manual" in links,
        "born_at": modes[0].at,
        "last_seen_at": last.at,
        "scans": len(modes),
        "missed": course.missed_in_all - course.missed,
        "doubtful_links": links.count("doubtful"),
        "frequency_hz": last.frequency_hz,
        "frequency_std_hz": last.frequency_std_hz,
        "damping_ratio": last.damping_ratio,
        "reference_hz": None,
        "reference_std_hz": None,
    }


def _write_places(session: Session, modes: Sequence[Observation], joined: Tracks, labels: Mapping[int, str]) -> None:
    """Write where each mode belongs, of those whose place has changed."""
    nowhere = Placed(None)
    for mode in modes:
        placed = joined.placed.get(_key(mode), nowhere)
        track_id = None if placed.course is None else labels[placed.course]
        if (track_id, placed.link, placed.mac) != (mode.track_id, mode.link, mode.mac):
            mode.track_id, mode.link, mode.mac = track_id, placed.link, placed.mac
    session.flush()


def _write_references(session: Session, tracks: Sequence[Track], watched: Drift) -> None:
    for k, row in enumerate(tracks):
        row.reference_hz, row.reference_std_hz = _known(watched.references[k]), _known(watched.reference_stds[k])
    session.flush()


def _shown(found: Findings) -> dict[str, Any]:
    """What lists and charts show of the plant."""
    nothing: dict[str, Any] = {"latest": [], "spark": [], "ratio": None, "frequency_hz": None, "drift": None}
    if found.drift is None:
        return nothing
    last_at = found.scans[-1].at
    here = {mode.track_id: mode for mode in found.modes if mode.at == last_at and mode.track_id is not None}
    latest = sorted(
        (_latest(row, here.get(row.id)) for row in found.tracks if row.active), key=lambda one: one["frequency_hz"]
    )
    lead = leading(found.tracks)
    together = all_together(found.history.frequencies / found.drift.references)
    known = np.flatnonzero(np.isfinite(together))[-SPARK:]
    return {
        "latest": latest,
        "spark": [[round(float(found.history.at[k])), round(float(together[k]), 5)] for k in known],
        "ratio": float(together[known[-1]]) if len(known) else None,
        "frequency_hz": None if lead is None else found.tracks[lead].frequency_hz,
        "drift": drift_document(found),
    }


def all_together(ratios: np.ndarray) -> np.ndarray:
    """Geometric mean of f/f0 (scans, tracks) over the tracks that each scan shows: what the EWMA watches; (scans,)."""
    seen = np.isfinite(ratios)
    logs = np.where(seen, np.log(np.where(seen, ratios, 1.0)), 0.0).sum(axis=1)
    counts = seen.sum(axis=1)
    return np.where(counts > 0, np.exp(logs / np.maximum(counts, 1)), np.nan)


def leading(tracks: Sequence[Track]) -> int | None:
    """The living track of the lowest frequency that has f0 and half as many scans as the longest at least."""
    living = [k for k, row in enumerate(tracks) if row.active and row.reference_hz]
    longest = max((tracks[k].scans for k in living), default=0)
    return min(
        (k for k in living if 2 * tracks[k].scans >= longest), key=lambda k: tracks[k].frequency_hz, default=None
    )


def _latest(row: Track, mode: Observation | None) -> dict[str, Any]:
    ratio, ratio_std = ratio_of(row)
    return {
        "track": row.id,
        "name": name_of(row),
        "organ": row.organ,
        "frequency_hz": row.frequency_hz,
        "frequency_std_hz": row.frequency_std_hz,
        "ratio": ratio,
        "ratio_std": ratio_std,
        "doubtful": mode is None or mode.link == "doubtful" or mode.verdict != FOUNDING,
    }


def _known(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
