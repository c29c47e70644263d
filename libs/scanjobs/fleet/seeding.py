"""A fleet for demonstrations, written as scans would have left it: scans with steps, attempts, events and files.

Scans are rows and files like any other (`fsck` finds nothing wrong with them); their modes then go the way of real
ones: read from modes.json, joined, charted, alarmed. Everything of it is marked and can be removed.
"""

import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final
from uuid import UUID

import numpy as np
from nerfmodal.spec import CloudsSource, PlantSpec, ScanSpec
from sqlalchemy import delete, insert, select, update
from sqlalchemy.orm import Session

from scanjobs.artifacts import ArtifactStore
from scanjobs.fleet.joining import join
from scanjobs.fleet.plants import UNSYNCHRONISED
from scanjobs.fleet.seeding_files import Draw, Files, Pot, put_all
from scanjobs.fleet.seeding_rows import END_S, Rows, rows_of_drawing, rows_of_scan
from scanjobs.fleet.tables import Alarm, Environment, Plant, PlantEvent, PlantTag
from scanjobs.monitoring.simulated import DAY_S, Kind, Nature, live, temperature
from scanjobs.store import Store
from scanjobs.table_base import table_of
from scanjobs.tables import Artifact, ArtifactRef, Attempt, Event, Scan, ScanTag, Step, StepDependency

TAG: Final = "demo-fleet"
PAUSE_S: Final = 12 * 3600.0
TREATMENTS: Final = ("control", "drought", "recovery")
STUDY: Final = "greenhouse-demo"
TABLES: Final = (Scan, ScanTag, Step, StepDependency, Attempt, Event, Artifact, ArtifactRef)
BATCH: Final = 400


@dataclass(frozen=True, slots=True)
class Seeded:
    """What was made; plants that were there already are not counted."""

    plants: int
    scans: int
    full: tuple[str, ...] = ()
    """Plants whose newest scan has every file."""


def seed_fleet(
    store: Store,
    artifacts: ArtifactStore,
    *,
    owner: str,
    plants: int,
    scans: int,
    now: float,
    seed: int = 0,
    full: int = 0,
    draw: Draw | None = None,
    on_plant: Callable[[int], None] = lambda _: None,
) -> Seeded:
    """Make `plants` plants with `scans` scans each, two a day, the last one just before `now` (s); once.

    The newest scan of the first `full` plants whose every mode was seen then is made by `draw`, with every file.
    """
    with store.read() as session:
        there = set(session.scalars(select(Plant.id).where(Plant.owner == owner, Plant.demo)))
    rng = np.random.default_rng(seed)
    at = now - PAUSE_S * (np.arange(scans)[::-1] + 0.5)
    warm = temperature(at, rng)
    pots = [_pot(number, at, warm, np.random.default_rng([seed, number])) for number in range(1, plants + 1)]
    missing = [pot for pot in pots if pot.id not in there]
    if missing and not there:
        store.write(lambda session: _write_house(session, owner, at, rng))
    chosen = [pot.number for pot in missing if _is_whole(pot)][:full] if draw else []
    made = 0
    for pot in missing:
        made += _write_pot(store, artifacts, owner, pot, draw if pot.number in chosen else None)
        on_plant(pot.number)
    return Seeded(len(missing), made, tuple(pot.id for pot in missing if pot.number in chosen))


def _is_whole(pot: Pot) -> bool:
    """Whether the newest scan has succeeded and seen every mode."""
    return not pot.failed[-1] and bool(np.isfinite(pot.life.frequencies[-1]).all())


def remove_fleet(store: Store, *, owner: str) -> int:
    """Remove the demonstration's plants and scans; returns how many plants. Files are collected as garbage."""

    def work(session: Session) -> int:
        mine = select(Plant.id).where(Plant.owner == owner, Plant.demo)
        tagged = select(ScanTag.scan_id).where(ScanTag.tag == TAG)
        scans = delete(Scan).where(Scan.owner == owner, Scan.plant.in_(mine), Scan.id.in_(tagged))
        session.execute(scans, execution_options=UNSYNCHRONISED)
        gone = delete(Plant).where(Plant.owner == owner, Plant.demo).returning(Plant.key)
        count = len(session.scalars(gone, execution_options=UNSYNCHRONISED).all())
        house = delete(Environment).where(Environment.owner == owner, Environment.place == "")
        marked = house.where(Environment.id.startswith(HOUSE_MARK))
        session.execute(marked, execution_options=UNSYNCHRONISED)
        return count

    return store.write(work)


HOUSE_MARK: Final = "demo-"


def _pot(number: int, at: np.ndarray, warm: np.ndarray, rng: np.random.Generator) -> Pot:
    treatment = TREATMENTS[(number - 1) % 4 % 3]
    span = at[-1] - at[0]
    dry_from = again_from = None
    dryness = np.zeros(len(at))
    if treatment != "control" and rng.random() < 0.5:
        dry_from = float(at[0] + span * rng.uniform(0.52, 0.8))
        dryness = 1.0 - np.exp(-np.maximum(at - dry_from, 0.0) / (4.0 * DAY_S))
        if treatment == "recovery":
            again_from = dry_from + 2.5 * DAY_S
            dryness = np.where(at > again_from, dryness * np.exp(-(at - again_from) / (0.7 * DAY_S)), dryness)
    life = live(at, warm, dryness, rng=rng, kind=Kind(), nature=Nature(growth_per_day=float(rng.normal(0.0, 0.0001))))
    failed = rng.random(len(at)) < 0.02
    if number % 67 == 5:
        failed[-3:] = True
    return Pot(number, treatment, life, failed, dry_from, again_from)


def _write_house(session: Session, owner: str, at: np.ndarray, rng: np.random.Generator) -> None:
    """What all plants have in common, every hour."""
    hours = np.arange(at[0] - 3600.0, at[-1] + 3600.0, 3600.0)
    warm = np.interp(hours, at, temperature(at, np.random.default_rng(0)))
    light = 600.0 * np.clip(np.sin(2.0 * np.pi * (hours / DAY_S - 0.25)), 0.0, None)
    rows = [
        {
            "id": f"{HOUSE_MARK}{owner[:8]}-{int(hour)}",
            "owner": owner,
            "place": "",
            "at": float(hour),
            "temperature_c": round(float(warm[k]), 2),
            "humidity_percent": round(float(np.clip(75.0 - 1.5 * (warm[k] - 23.0) + rng.normal(0, 2), 20, 100)), 1),
            "light_umol_m2_s": round(float(light[k]), 1),
        }
        for k, hour in enumerate(hours)
    ]
    session.execute(delete(Environment).where(Environment.owner == owner, Environment.id.startswith(HOUSE_MARK)))
    known = set(session.scalars(select(Environment.at).where(Environment.owner == owner, Environment.place == "")))
    session.execute(insert(table_of(Environment)), [row for row in rows if row["at"] not in known])


def _write_pot(store: Store, artifacts: ArtifactStore, owner: str, pot: Pot, draw: Draw | None) -> int:
    """One plant, all or nothing, then joined as a worker would; its newest scan is drawn where `draw` is given."""
    rng = np.random.default_rng(pot.number)
    files = Files(artifacts, pot, rng)
    key = str(UUID(bytes=rng.bytes(16), version=4))
    rows: dict[Any, list[dict[str, Any]]] = {table: [] for table in TABLES}
    for k, at in enumerate(pot.life.at.tolist()):
        ids = [id_at(at + 0.001 * n, rng) for n in range(4)]
        if draw is not None and k == len(pot.life.at) - 1:
            made = _drawn_rows(artifacts, owner, pot, ids, draw)
        else:
            made = [rows_of_scan(ids[:3], owner, pot.id, _spec(pot), at, files.of_scan(k), failed=bool(pot.failed[k]))]
        for one in made:
            for table, some in one.items():
                rows[table] += some

    def work(session: Session) -> None:
        session.execute(insert(table_of(Plant)), [_plant_row(owner, key, pot)])
        session.execute(
            insert(table_of(PlantTag)), [{"plant_key": key, "tag": "demo"}, {"plant_key": key, "tag": bench_of(pot)}]
        )
        _write_care(session, owner, key, pot)
        for table in TABLES:
            _insert(session, table, rows[table])

    store.write(work)
    join(store, artifacts, key)
    store.write(lambda session: _date_alarms(session, key))
    return len(pot.life.at)


def _drawn_rows(artifacts: ArtifactStore, owner: str, pot: Pot, ids: Sequence[str], draw: Draw) -> list[Rows]:
    """The rows of the newest scan, drawn."""
    with tempfile.TemporaryDirectory(prefix="nerfmodal-demo-") as folder:
        drawn = draw(pot, Path(folder))
        results, beside = put_all(artifacts, drawn.results), put_all(artifacts, drawn.beside)
    at, names = float(pot.life.at[-1]), {role: path.name for role, path in drawn.beside.items()}
    scan = rows_of_scan(ids[:3], owner, pot.id, drawn.spec, at, results, frames=drawn.frames)
    return [scan, rows_of_drawing(ids[3], ids[0], at, beside, names)]


def bench_of(pot: Pot) -> str:
    """The tag of the bench that the pot stands on."""
    return f"bench-{1 + (pot.number - 1) // 50}"


def _spec(pot: Pot) -> dict[str, Any]:
    source = CloudsSource(kind="clouds", path="demo-fleet")
    spec = ScanSpec(name=pot.id, source=source, plant=PlantSpec(id=pot.id, treatment=pot.treatment), tags=(TAG,))
    return spec.model_dump(mode="json")


def _plant_row(owner: str, key: str, pot: Pot) -> dict[str, Any]:
    row, column = divmod(pot.number - 1, 10)
    return {
        "key": key,
        "owner": owner,
        "id": pot.id,
        "name": f"Açaí {pot.number}",
        "treatment": pot.treatment,
        "position": f"{chr(65 + row % 26)}{column + 1}",
        "study": STUDY,
        "species": "Euterpe oleracea",
        "genotype": ("BRS-Pará", "BRS Pai d'Égua")[pot.number % 2],
        "replicate": str(1 + (pot.number - 1) // 4 % 5),
        "block": ("north", "south")[(pot.number - 1) // 100 % 2],
        "notes": "Simulated by `nerfmodal demo-fleet`.",
        "tags": sorted(["demo", bench_of(pot)]),
        "demo": True,
        "reference_scans": 12,
        "false_alarms_per_year": 0.1,
        "growth": False,
        "created_at": float(pot.life.at[0]),
        "scans": 0,
        "latest": [],
        "spark": [],
        "open_alarms": 0,
        "missed_scans": 0,
        "touched": 1,
        "joined": 0,
    }


def _write_care(session: Session, owner: str, key: str, pot: Pot) -> None:
    """What was measured at the pot with every scan, and what was done to it."""
    life = pot.life
    records = [
        {
            "id": id_at(float(at), np.random.default_rng([pot.number, k])),
            "owner": owner,
            "place": key,
            "plant_key": key,
            "at": float(at),
            "soil_water_percent": round(float(life.soil_water_percent[k]), 1),
            "mass_g": round(float(life.mass_g[k]), 1),
        }
        for k, at in enumerate(life.at)
    ]
    session.execute(insert(table_of(Environment)), records)
    days = np.arange(life.at[0], life.at[-1], 2.0 * DAY_S)
    dry = (pot.dry_from or np.inf, pot.again_from or np.inf)
    care: list[tuple[float, str, str, float | None, str | None]]
    care = [(float(at), "watering", "", 250.0, "ml") for at in days if not dry[0] <= at < dry[1]]
    if pot.dry_from is not None:
        care.append((pot.dry_from, "treatment", "Watering stopped.", None, None))
    if pot.again_from is not None:
        care.append((pot.again_from, "watering", "Watered again.", 400.0, "ml"))
    events = [
        {
            "id": id_at(at, np.random.default_rng([pot.number, 7, k])),
            "plant_key": key,
            "at": at,
            "kind": kind,
            "note": note,
            "amount": amount,
            "unit": unit,
        }
        for k, (at, kind, note, amount, unit) in enumerate(care)
    ]
    session.execute(insert(table_of(PlantEvent)), events)


def _date_alarms(session: Session, key: str) -> None:
    """The demonstration's alarms were opened when their scans ended, not when this ran."""
    for alarm in session.scalars(select(Alarm).where(Alarm.plant_key == key)):
        opened = {"opened_at": float(alarm.evidence["detected_at"]) + END_S}
        session.execute(update(Alarm).where(Alarm.id == alarm.id).values(opened), execution_options=UNSYNCHRONISED)


def id_at(at: float, rng: np.random.Generator) -> str:
    """A UUIDv7 of a moment: ids of simulated scans sort by their times."""
    random = int.from_bytes(rng.bytes(10), "big")
    milliseconds = int(at * 1000.0) & (2**48 - 1)
    high = (milliseconds << 16) | 0x7000 | (random >> 62 & 0x0FFF)
    low = 0x8000000000000000 | (random & 0x3FFFFFFFFFFFFFFF)
    return str(UUID(int=(high << 64) | low))


def _insert(session: Session, table: Any, rows: list[dict[str, Any]]) -> None:
    if table is Artifact:
        known = set()
        for start in range(0, len(rows), BATCH):
            digests = [row["digest"] for row in rows[start : start + BATCH]]
            known |= set(session.scalars(select(Artifact.digest).where(Artifact.digest.in_(digests))))
        rows = list({row["digest"]: row for row in rows if row["digest"] not in known}.values())
    for start in range(0, len(rows), BATCH):
        session.execute(insert(table_of(table)), rows[start : start + BATCH])
