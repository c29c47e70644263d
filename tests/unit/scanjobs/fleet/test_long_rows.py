"""The long table read in sets is the one that a loop over objects gives, in a bounded number of queries."""

import csv
import io
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from scanjobs.artifacts import ArtifactStore
from scanjobs.fleet import long_rows as module
from scanjobs.fleet.environment import COLUMNS as SURROUNDINGS
from scanjobs.fleet.environment import Record, at_moments, series_of, store_records
from scanjobs.fleet.exports import observations_csv, write_parquet
from scanjobs.fleet.long_rows import long_rows
from scanjobs.fleet.long_table import COLUMNS, FACTORS, TRAITS, Extent, observed, plants_of, value_of
from scanjobs.fleet.seeding import seed_fleet
from scanjobs.fleet.tables import Observation, Plant, Track
from scanjobs.fleet.tracks import name_of
from scanjobs.migrate import upgrade
from scanjobs.scopes import LOCAL_OWNER
from scanjobs.settings import Settings
from scanjobs.store import Store, open_store
from sqlalchemy import event, func, select, update
from sqlalchemy.orm import Session

NOW, HOUR_S, DAY_S = 1_767_225_600.0, 3600.0, 86_400.0
PLANTS, SCANS = 4, 14
WHOLE = Extent(owner=LOCAL_OWNER)
EXTENTS = {
    "whole": WHOLE,
    "one plant": Extent(owner=LOCAL_OWNER, plant="demo-002"),
    "a study": Extent(owner=LOCAL_OWNER, study="other"),
    "between": Extent(owner=LOCAL_OWNER, since=NOW - 5 * DAY_S, until=NOW - 2 * DAY_S),
    "one plant, between": Extent(owner=LOCAL_OWNER, plant="demo-003", since=NOW - 4 * DAY_S),
    "nobody's": Extent(owner="nobody"),
}


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Store]:
    """A small fleet whose surroundings overlap, have gaps and columns of their own."""
    settings = Settings(data_folder=tmp_path_factory.mktemp("fleet"))
    upgrade(settings.database)
    found = open_store(settings.database)
    seed_fleet(found, ArtifactStore(settings.artifacts), owner=LOCAL_OWNER, plants=PLANTS, scans=SCANS, now=NOW)
    found.write(_unsettle)
    yield found
    found.close()


def _unsettle(session: Session) -> None:
    """What a greenhouse that nobody tidied up looks like."""
    rng = np.random.default_rng(3)
    at = list(session.scalars(select(Observation.at).distinct().order_by(Observation.at)))
    here = [Record(at=one, values={"temperature_c": rng.normal(30, 1), "ndvi": 0.5}) for one in at[::2]]
    store_records(session, here, owner=LOCAL_OWNER, plant_id="demo-002")
    near = [Record(at=one + rng.uniform(-4, 4) * HOUR_S, values={"mass_g": rng.normal(300, 9)}) for one in at]
    store_records(session, near, owner=LOCAL_OWNER)
    session.execute(
        update(Plant).where(Plant.id == "demo-003").values(study="other", treatment=None, name='=1+"é",\n2')
    )
    dark = select(Track.id).order_by(Track.id).limit(2)
    session.execute(update(Track).where(Track.id.in_(dark)).values(reference_hz=None, name="+ second"))
    lost = update(Observation).where(Observation.at == at[3]).values(damping_ratio=None, frequency_std_hz=None)
    session.execute(lost)


def slowly(session: Session, extent: Extent) -> Iterator[dict[str, Any]]:
    """The table by a loop over plants, modes and traits as objects."""
    for plant in plants_of(session, extent):
        mine = Extent(owner=extent.owner, plant=plant.id, since=extent.since, until=extent.until)
        found: list[tuple[Observation, Track]] = [(mode, track) for mode, track, _ in session.execute(observed(mine))]
        at = np.array([mode.at for mode, _ in found])
        around = at_moments(series_of(session, plant), at)
        for k, (mode, track) in enumerate(found):
            place = {name: getattr(plant, name) for name in FACTORS} | {
                "plant": plant.id,
                "plant_name": plant.name,
                "scan": mode.scan_id,
                "at": datetime.fromtimestamp(mode.at, UTC).isoformat(),
                "days": round((mode.at - at[0]) / DAY_S, 6),
                "track": track.id,
                "track_name": name_of(track),
                "organ": track.organ,
                "verdict": mode.verdict,
                "link": mode.link,
            }
            beside = {name: float(around[name][k]) if name in around else np.nan for name in SURROUNDINGS}
            surroundings = {name: round(value, 4) if np.isfinite(value) else None for name, value in beside.items()}
            for trait in TRAITS:
                value, std = value_of(trait, mode, track)
                if value is not None:
                    yield (
                        place
                        | surroundings
                        | {
                            "trait": trait.name,
                            "value": value,
                            "std": std,
                            "unit": trait.unit,
                        }
                    )


@pytest.mark.parametrize("scans_at_once", [1, 30, 1000])
@pytest.mark.parametrize("name", EXTENTS)
def test_rows_are_those_of_a_loop_over_objects(
    store: Store, monkeypatch: pytest.MonkeyPatch, name: str, scans_at_once: int
) -> None:
    monkeypatch.setattr(module, "SCANS_AT_ONCE", scans_at_once)
    with store.read() as session:
        expected = [tuple(row[column] for column in COLUMNS) for row in slowly(session, EXTENTS[name])]
    assert list(long_rows(store, EXTENTS[name])) == expected
    assert bool(expected) == (name != "nobody's")


def test_csv_and_parquet_have_the_same_rows(store: Store, tmp_path: Path) -> None:
    text = b"".join(observations_csv(store, WHOLE)).decode()
    write_parquet(store, WHOLE, tmp_path / "rows.parquet")
    rows = list(csv.reader(io.StringIO(text, newline="")))
    parquet = pq.read_table(tmp_path / "rows.parquet").to_pylist()
    assert rows[0] == list(COLUMNS)
    assert next(row[1] for row in rows if "é" in row[1]) == '\'=1+"é",\n2'
    assert [[_as_csv(row[name]) for name in COLUMNS] for row in parquet] == rows[1:]


def _as_csv(value: Any) -> str:
    """As CSV writes it: milliseconds are all that this fleet's moments have."""
    if isinstance(value, datetime):
        return value.isoformat()
    return "" if value is None else f"'{value}" if str(value)[:1] in ("=", "+") else str(value)


def test_a_plant_more_is_no_query_more_and_rows_that_are_taken_slowly_hold_up_no_writer(store: Store) -> None:
    said: list[str] = []
    event.listen(store.engine, "before_cursor_execute", lambda *call: said.append(call[2]))
    rows = long_rows(store, WHOLE)
    next(rows)
    assert len([one for one in said if one.startswith("SELECT")]) == 4  # plants, house, modes, the plants' own records
    store.write(lambda session: session.execute(update(Plant).values(notes="while somebody is downloading")))
    with store.read() as session:
        count = session.scalars(select(func.count()).select_from(Observation)).one()
    assert count < len(list(rows)) < len(TRAITS) * count
