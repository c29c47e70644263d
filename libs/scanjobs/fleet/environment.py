"""What surrounded the plants: records by moment, of one plant or of the whole house, from JSON or CSV; and events.

A value of a plant's own goes before the house's of about the same time. Columns that the table does not know are free:
kept by name beside the others.
"""

import csv
import io
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any, Final

import numpy as np
from nerfmodal.errors import InvalidInput
from sqlalchemy import Select, delete, insert, select
from sqlalchemy.dialects import postgresql, sqlite
from sqlalchemy.orm import Session

from scanjobs.clock import now_s
from scanjobs.errors import NotFound
from scanjobs.fleet.tables import Environment, Plant, PlantEvent
from scanjobs.table_base import table_of
from scanjobs.uuids import new_id

COLUMNS: Final = ("temperature_c", "humidity_percent", "light_umol_m2_s", "soil_water_percent", "mass_g")
FREE_NAME: Final = re.compile(r"[A-Za-z][A-Za-z0-9_.%-]{0,47}")
NEAR_S: Final = 3 * 3600.0
"""A record is of a scan when no more than this lies between them; between two records values are interpolated."""
BATCH: Final = 300
HOUSE: Final = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Record:
    """The values of one moment; `values` has known columns and free ones. `plant` is an id, or None for the house."""

    at: float
    values: Mapping[str, float]
    plant: str | None = None


@dataclass(frozen=True, slots=True)
class Series:
    """Columns over time: `values[name][k]` at `at[k]`, NaN where nothing is known."""

    at: np.ndarray
    values: Mapping[str, np.ndarray] = field(default_factory=dict)


def store_records(session: Session, records: Sequence[Record], *, owner: str, plant_id: str | None = None) -> int:
    """Keep records of `plant_id`, or of the plants they name, or of the house; the same moment is written over.

    Raises
    ------
    NotFound
        A plant is not there.
    """
    keys = _keys_of(session, {plant_id, *(record.plant or plant_id for record in records)} - {None}, owner=owner)
    merged: dict[tuple[str, float], dict[str, float]] = {}
    for record in records:
        named = record.plant or plant_id
        merged.setdefault((keys[named] if named else HOUSE, record.at), {}).update(record.values)
    known = _known(session, merged, owner=owner)
    rows = [_row(owner, place, at, known.get((place, at), {}) | values) for (place, at), values in merged.items()]
    for start in range(0, len(rows), BATCH):
        _upsert(session, rows[start : start + BATCH])
    return len(records)


def read_csv(text: str) -> tuple[Record, ...]:
    """Records of a table with a header: `at`, known and free columns, `plant` where it is of several.

    Raises
    ------
    InvalidInput
        No column `at`, a time or number that cannot be read: the message names the line.
    """
    reader = csv.DictReader(io.StringIO(text.lstrip("\ufeff")), restkey="")
    names = [name for name in reader.fieldnames or () if name]
    if "at" not in names:
        raise InvalidInput("the table has no column 'at'.", where="/at", hint="Begin with a line such as: at,mass_g")
    for name in names:
        if name not in ("at", "plant") and not FREE_NAME.fullmatch(name):
            raise InvalidInput(f"'{name}' is no name of a column.", where=f"/{name}", hint="Use letters, digits, '_'.")
    return tuple(_record_of_line(line, row) for line, row in enumerate(reader, start=2))


def series_of(
    session: Session, plant: Plant, *, since: float | None = None, until: float | None = None, limit: int = 20_000
) -> Series:
    """Everything known around a plant, its own values before the house's, oldest first."""
    places = [plant.key, HOUSE]
    query = select(Environment).where(Environment.owner == plant.owner, Environment.place.in_(places))
    query = _between(query, since, until).order_by(Environment.at.desc(), Environment.place.asc()).limit(limit)
    moments: dict[float, dict[str, float]] = {}
    for row in session.scalars(query):  # the house's come first at one moment: the plant's own are written over them
        moments.setdefault(row.at, {}).update(values_of(row))
    at = np.array(sorted(moments))
    names = sorted({name for values in moments.values() for name in values}, key=_rank)
    columns = {name: np.array([moments[moment].get(name, np.nan) for moment in at]) for name in names}
    return Series(at, columns)


def at_moments(series: Series, moments: np.ndarray, near_s: float = NEAR_S) -> dict[str, np.ndarray]:
    """Each column at other moments: interpolated between records that are near, else the nearest, else NaN."""
    return {name: _at_moments(series.at, column, moments, near_s) for name, column in series.values.items()}


def values_of(row: Environment) -> dict[str, float]:
    """The values of a row, by column."""
    fixed = {name: getattr(row, name) for name in COLUMNS}
    return {name: value for name, value in (fixed | (row.free or {})).items() if value is not None}


def add_event(session: Session, plant: Plant, values: Mapping[str, Any], at: float | None) -> PlantEvent:
    """Note what was done to a plant, now by default."""
    event_id = new_id()
    row = {**values, "id": event_id, "plant_key": plant.key, "at": now_s() if at is None else at}
    session.execute(insert(PlantEvent).values(row))
    return session.get_one(PlantEvent, event_id)


def list_events(
    session: Session, plant: Plant, *, since: float | None = None, until: float | None = None
) -> tuple[PlantEvent, ...]:
    """What was done to a plant, oldest first."""
    query = select(PlantEvent).where(PlantEvent.plant_key == plant.key)
    if since is not None:
        query = query.where(PlantEvent.at >= since)
    if until is not None:
        query = query.where(PlantEvent.at <= until)
    return tuple(session.scalars(query.order_by(PlantEvent.at, PlantEvent.id)))


def remove_event(session: Session, plant: Plant, event_id: str) -> None:
    """Forget an event. Raises `NotFound`."""
    mine = (PlantEvent.id == event_id, PlantEvent.plant_key == plant.key)
    if not session.scalars(delete(PlantEvent).where(*mine).returning(PlantEvent.id)).all():
        raise NotFound(f"there is no event {event_id}.", hint="List them with GET /v1/plants/{id}/events.")


def _keys_of(session: Session, names: Iterable[str | None], *, owner: str) -> dict[str, str]:
    wanted = [name for name in names if name is not None]
    query = select(Plant.id, Plant.key).where(Plant.owner == owner, Plant.id.in_(wanted))
    keys = {row[0]: row[1] for row in session.execute(query)} if wanted else {}
    for name in wanted:
        if name not in keys:
            raise NotFound(f"there is no plant '{name}'.", hint="Make it with POST /v1/plants.")
    return keys


def _known(
    session: Session, wanted: Mapping[tuple[str, float], object], *, owner: str
) -> dict[tuple[str, float], dict[str, float]]:
    """What is stored already of these places and moments."""
    times = [at for _, at in wanted]
    places = {place for place, _ in wanted}
    if not times:
        return {}
    query = select(Environment).where(
        Environment.owner == owner, Environment.place.in_(places), Environment.at.between(min(times), max(times))
    )
    rows = session.scalars(query)
    return {(row.place, row.at): values_of(row) for row in rows if (row.place, row.at) in wanted}


def _row(owner: str, place: str, at: float, values: Mapping[str, float]) -> dict[str, Any]:
    free = {name: value for name, value in values.items() if name not in COLUMNS}
    fixed = {name: values.get(name) for name in COLUMNS}
    return fixed | {
        "id": new_id(),
        "owner": owner,
        "place": place,
        "plant_key": place or None,
        "at": at,
        "free": free or None,
    }


def _upsert(session: Session, rows: list[dict[str, Any]]) -> None:
    dialect = postgresql if session.get_bind().dialect.name == "postgresql" else sqlite
    statement = dialect.insert(table_of(Environment)).values(rows)
    changed = {name: statement.excluded[name] for name in (*COLUMNS, "free")}
    session.execute(statement.on_conflict_do_update(index_elements=["owner", "place", "at"], set_=changed))


def _record_of_line(line: int, row: Mapping[str, Any]) -> Record:
    at, plant = _moment_of(line, row.get("at") or ""), (row.get("plant") or "").strip() or None
    values = {
        name: _number_of(line, name, text)
        for name, text in row.items()
        if name and name not in ("at", "plant") and isinstance(text, str) and text.strip()
    }
    return Record(at=at, values=values, plant=plant)


def _moment_of(line: int, text: str) -> float:
    try:
        moment = datetime.fromisoformat(text.strip())
        return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()
    except (ValueError, OverflowError) as error:
        hint = "Write RFC 3339, such as 2026-01-01T06:00:00Z."
        raise InvalidInput(f"line {line}: '{text[:40]}' is no time.", where="/at", hint=hint) from error


def _number_of(line: int, name: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        hint = "Write a number with a decimal point, or nothing."
        raise InvalidInput(f"line {line}: '{text[:40]}' is no number.", where=f"/{name}", hint=hint)
    return value


def _between(query: Select[Environment], since: float | None, until: float | None) -> Select[Environment]:
    if since is not None:
        query = query.where(Environment.at >= since)
    if until is not None:
        query = query.where(Environment.at <= until)
    return query


def _rank(name: str) -> tuple[int, str]:
    return (COLUMNS.index(name) if name in COLUMNS else len(COLUMNS), name)


def _at_moments(at: np.ndarray, column: np.ndarray, moments: np.ndarray, near_s: float) -> np.ndarray:
    known = np.isfinite(column)
    return between_known(at[known], column[known], moments, near_s)


def between_known(times: np.ndarray, values: np.ndarray, moments: np.ndarray, near_s: float = NEAR_S) -> np.ndarray:
    """Values at `moments` from those known at `times`, ascending: see `at_moments`."""
    if not len(times):
        return np.full(len(moments), np.nan)
    after = np.searchsorted(times, moments).clip(0, len(times) - 1)
    before = (after - 1).clip(0)
    distance = np.minimum(np.abs(times[after] - moments), np.abs(times[before] - moments))
    apart = (moments - times[before] > near_s) | (times[after] - moments > near_s)
    nearest = np.where(np.abs(times[after] - moments) < np.abs(times[before] - moments), values[after], values[before])
    found = np.where(apart, nearest, np.interp(moments, times, values))
    return np.where(distance <= near_s, found, np.nan)
