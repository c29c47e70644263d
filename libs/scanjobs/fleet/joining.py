"""A plant's rows brought up to date: the modes of its scans read, tracks, charts and alarms computed.

A worker's chore does it for plants that `notes` has touched. Everything computed follows
from the rows of modes, pins and surroundings alone, so it may be computed again at any time with the same outcome.
"""

from collections.abc import Sequence
from typing import Any, Final

from sqlalchemy import and_, delete, func, insert, select, update
from sqlalchemy.orm import Session

from scanjobs.artifacts import ArtifactStore
from scanjobs.fleet.plants import UNSYNCHRONISED
from scanjobs.fleet.results import MOST, Result, read_result, unread_scans
from scanjobs.fleet.tables import Observation, Plant, PlantScan
from scanjobs.states import ScanState
from scanjobs.store import Store
from scanjobs.table_base import table_of
from scanjobs.tables import Scan

FORGOTTEN: Final = (ScanState.DELETING, ScanState.DELETED)


def touched_plants(session: Session, most: int = 200) -> tuple[str, ...]:
    """Keys of plants that are to be joined."""
    return tuple(session.scalars(select(Plant.key).where(Plant.touched > Plant.joined).limit(most)))


def join(store: Store, artifacts: ArtifactStore, plant_key: str) -> bool:
    """Read what is new of a plant and compute what follows; whether the plant is up to date then."""
    with store.read() as session:
        plant = session.get(Plant, plant_key)
        if plant is None:
            return True
        unread = unread_scans(session, plant.owner, plant.id)
    results = [read_result(artifacts, one) for one in unread]
    whole = len(unread) < MOST

    def work(session: Session) -> None:
        # held before anything is written: two workers that have read the same scan keep it one after the other
        held = session.get(Plant, plant_key, with_for_update=True, populate_existing=True)
        if held is not None:
            keep_results(session, plant_key, results)
            join_plant(session, held, up_to=plant.touched if whole else None)

    store.write(work)
    return whole


def keep_results(session: Session, plant_key: str, results: Sequence[Result]) -> None:
    """The modes of scans as rows, in the place of those of an earlier generation."""
    scans = [result.scan_id for result in results]
    if not scans:
        return
    session.execute(delete(Observation).where(Observation.scan_id.in_(scans)))
    session.execute(delete(PlantScan).where(PlantScan.scan_id.in_(scans)))
    read = [
        {
            "scan_id": result.scan_id,
            "plant_key": plant_key,
            "generation": result.generation,
            "at": result.at,
            "problem": result.problem,
        }
        for result in results
    ]
    session.execute(insert(table_of(PlantScan)), read)
    modes = [
        {**row, "scan_id": result.scan_id, "at": result.at, "plant_key": plant_key}
        for result in results
        for row in result.rows
    ]
    if modes:
        session.execute(insert(table_of(Observation)), modes)


def join_plant(session: Session, plant: Plant, *, up_to: int | None = None) -> None:
    """Compute a held plant's tracks, charts and alarms afresh; `up_to` is the `touched` that this answers to."""
    from scanjobs.fleet.analysis import analyse  # here: scipy takes long to import, and most workers never join

    _forget_deleted(session, plant)
    values = analyse(session, plant) | _scans_of(session, plant)
    if up_to is not None:
        values["joined"] = up_to
    session.execute(update(Plant).where(Plant.key == plant.key).values(values), execution_options=UNSYNCHRONISED)
    session.refresh(plant)


def _forget_deleted(session: Session, plant: Plant) -> None:
    gone = select(PlantScan.scan_id).join(Scan, Scan.id == PlantScan.scan_id)
    ids = session.scalars(gone.where(PlantScan.plant_key == plant.key, Scan.state.in_(FORGOTTEN))).all()
    if ids:
        session.execute(delete(Observation).where(Observation.scan_id.in_(ids)))
        session.execute(delete(PlantScan).where(PlantScan.scan_id.in_(ids)))


def _scans_of(session: Session, plant: Plant) -> dict[str, Any]:
    """How many scans there are, and the last one: counted, so that a miscount heals."""
    mine = and_(Scan.owner == plant.owner, Scan.plant == plant.id, Scan.state.not_in(FORGOTTEN))
    count = session.scalars(select(func.count()).select_from(Scan).where(mine)).one()
    last = session.execute(select(Scan.id, Scan.state, Scan.created_at).where(mine).order_by(Scan.id.desc()).limit(1))
    row = last.one_or_none()
    found = (None, None, None) if row is None else tuple(row)
    return {"scans": count, "last_scan_id": found[0], "last_scan_state": found[1], "last_scan_at": found[2]}
