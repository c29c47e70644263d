"""The long table's rows, read in sets: a few queries for many plants, numbers as columns, no object for a row of SQL.

A batch of plants is read in a session of its own, which is closed before a row of it is given away: whoever takes the
rows slowly holds up no writer. In memory are the house's surroundings and one batch, or one plant that is larger.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import groupby
from operator import itemgetter
from typing import Any, Final

import numpy as np
from sqlalchemy import select
from sqlalchemy.orm import Session

from scanjobs.fleet.environment import COLUMNS as SURROUNDINGS
from scanjobs.fleet.environment import HOUSE, NEAR_S, between_known
from scanjobs.fleet.long_table import FACTORS, TRAITS, Extent, modes_in, plants_in, values_of_traits
from scanjobs.fleet.tables import Environment, Observation, Plant, Track
from scanjobs.fleet.tracks import called
from scanjobs.store import Store

SCANS_AT_ONCE: Final = 1000
RECORDS_AT_ONCE: Final = 10_000
DAY_S: Final = 86_400.0
Row = tuple[Any, ...]
Known = tuple[np.ndarray, np.ndarray]
"""A column where it is known: moments (s), ascending, and values."""
Around = tuple[Known, ...]
"""One `Known` for each of `SURROUNDINGS`."""
Word = Callable[[Any], Any]
NOTHING: Final[Around] = tuple((np.empty(0), np.empty(0)) for _ in SURROUNDINGS)


def as_it_is(value: Any) -> Any:
    """The same."""
    return value


@dataclass(frozen=True, slots=True)
class Unit:
    """A plant: its key, how many scans it has, and what stands of it in each of its rows."""

    key: str
    scans: int
    words: Row


def long_rows(store: Store, extent: Extent, word: Word = as_it_is) -> Iterator[Row]:
    """The table's rows in the order of `long_table.COLUMNS`, plant by plant, the oldest scan first.

    What people may have written (names, factors) goes through `word`, once for each plant and mode.
    """
    with store.read() as session:
        units = _units(session, extent, word)
        house = _surroundings(session, extent, [HOUSE]).get(HOUSE, NOTHING)
    for batch in _batches(units):
        keys = [unit.key for unit in batch]
        with store.read() as session:
            modes, own = _modes(session, extent, keys), _surroundings(session, extent, keys)
        for unit in batch:
            if unit.key in modes:
                around = tuple(_both(*pair) for pair in zip(house, own.get(unit.key, NOTHING), strict=True))
                yield from _rows_of(unit, modes[unit.key], around, word)


def _units(session: Session, extent: Extent, word: Word) -> list[Unit]:
    columns = (Plant.key, Plant.scans, Plant.id, Plant.name, *(getattr(Plant, name) for name in FACTORS))
    found = session.execute(select(*columns).where(*plants_in(extent)).order_by(Plant.id))
    return [Unit(row[0], row[1], tuple(map(word, row[2:]))) for row in found]


def _batches(units: Sequence[Unit]) -> Iterator[list[Unit]]:
    """So many plants that they have about `SCANS_AT_ONCE` scans together."""
    batch: list[Unit] = []
    scans = 0
    for unit in units:
        if batch and scans + unit.scans > SCANS_AT_ONCE:
            yield batch
            batch, scans = [], 0
        batch.append(unit)
        scans += max(unit.scans, 1)
    if batch:
        yield batch


def _modes(session: Session, extent: Extent, keys: Sequence[str]) -> dict[str, list[Row]]:
    """By plant the modes that belong to tracks, the oldest first."""
    frequency = (Observation.frequency_hz, Observation.frequency_std_hz)
    damping = (Observation.damping_ratio, Observation.damping_ratio_std)
    of_mode = (Observation.at, Observation.scan_id, *frequency, *damping, Observation.amplitude_m)
    of_track = (Track.id, Track.name, Track.number, Track.organ, Track.reference_hz)
    query = (
        select(Observation.plant_key, *of_mode, Observation.verdict, Observation.link, *of_track)
        .join(Track, Track.id == Observation.track_id)
        .where(Observation.plant_key.in_(keys), *modes_in(extent))
        .order_by(Observation.plant_key, Observation.at, Observation.scan_id, Observation.organ, Observation.mode)
    )
    return {key: [tuple(row[1:]) for row in rows] for key, rows in groupby(session.execute(query), itemgetter(0))}


def _surroundings(session: Session, extent: Extent, places: Sequence[str]) -> dict[str, Around]:
    """By place what is known of each column; only records that are near the extent's moments matter."""
    columns = (getattr(Environment, name) for name in SURROUNDINGS)
    mine = (Environment.owner == extent.owner, Environment.place.in_(places))
    query = select(Environment.place, Environment.at, *columns).where(*mine).order_by(Environment.place, Environment.at)
    if extent.since is not None:
        query = query.where(Environment.at >= extent.since - NEAR_S)
    if extent.until is not None:
        query = query.where(Environment.at <= extent.until + NEAR_S)
    parts: dict[str, list[np.ndarray]] = {}
    for some in session.execute(query.execution_options(yield_per=RECORDS_AT_ONCE)).partitions():
        for place, rows in groupby(some, itemgetter(0)):
            parts.setdefault(place, []).append(np.array([row[1:] for row in rows], dtype=float))
    return {place: _columns(np.concatenate(tables)) for place, tables in parts.items()}


def _columns(table: np.ndarray) -> Around:
    """Of a table (records, moment and `SURROUNDINGS`), NaN where nothing is known, each column where it is known."""
    known = np.isfinite(table)
    return tuple((table[rows, 0], table[rows, k]) for k, rows in enumerate(known[:, 1:].T, start=1))


def _both(house: Known, own: Known) -> Known:
    """A plant's own values among the house's, and instead of those of the same moment."""
    if not len(own[0]) or not len(house[0]):
        return own if len(own[0]) else house
    other = ~np.isin(house[0], own[0])
    at = np.concatenate([house[0][other], own[0]])
    order = np.argsort(at)
    return at[order], np.concatenate([house[1][other], own[1]])[order]


def _rows_of(unit: Unit, modes: Sequence[Row], around: Around, word: Word) -> Iterator[Row]:
    at = np.array([mode[0] for mode in modes])
    beside = list(zip(*(_rounded(between_known(*known, at)) for known in around), strict=True))
    for mode, surroundings in zip(modes, beside, strict=True):
        moment, scan, frequency, frequency_std, damping, damping_std, amplitude, verdict, link, *track = mode
        key, name, number, organ, reference = track
        days = round((moment - modes[0][0]) / DAY_S, 6)
        when = (scan, datetime.fromtimestamp(moment, UTC).isoformat(), days)
        place = (*unit.words, *when, key, word(called(name, organ, number)), word(organ))
        found = values_of_traits((frequency, frequency_std), (damping, damping_std), amplitude, reference)
        for trait, (value, std) in zip(TRAITS, found, strict=True):
            if value is not None:
                yield (*place, trait.name, value, std, trait.unit, verdict, link, *surroundings)


def _rounded(values: np.ndarray) -> list[float | None]:
    return [round(value, 4) if value == value else None for value in values.tolist()]
