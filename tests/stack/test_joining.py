"""A plant's scans joined by several workers at once, on both engines."""

import threading
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path

import pytest
from scanjobs.artifacts import ArtifactStore
from scanjobs.fleet import joining
from scanjobs.fleet.results import Result
from scanjobs.fleet.tables import Plant, PlantScan
from scanjobs.repository import insert_scan
from scanjobs.states import ScanState
from scanjobs.store import Store, open_store
from scanjobs.tables import Scan
from sqlalchemy import select, update
from sqlalchemy.orm import Session

from tests.conftest import copy_database, new_database
from tests.integration.toy_service import toy_spec
from tests.stack.servers import Postgres


@pytest.fixture(params=["sqlite", "postgresql"])
def store(
    request: pytest.FixtureRequest, tmp_path: Path, postgres: Postgres, migrated_postgres: str, migrated_sqlite: Path
) -> Iterator[Store]:
    """An empty database."""
    if request.param == "postgresql":
        url = new_database(postgres, migrated_postgres)
    else:
        copy_database(migrated_sqlite, tmp_path)
        url = f"sqlite:///{tmp_path / 'nerfmodal.db'}"
    opened = open_store(url)
    yield opened
    opened.close()


def test_two_workers_keep_the_same_scan_one_after_the_other(
    store: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Both have read the scan before either writes it down; the row is there once and neither has failed.

    Guard: the plant is held before its results are kept (`joining.join`).
    Seen to fail: with `keep_results` before the lock one of them ends with PostgreSQL's UniqueViolation of
    `pk_plant_scan`. SQLite has one writer at a time, and passes without it.
    """
    scan = store.write(lambda session: insert_scan(session, toy_spec(frames=1))).scan
    store.write(lambda session: session.execute(update(Scan).values(state=ScanState.SUCCEEDED.value)))
    store.write(lambda session: session.execute(update(Plant).values(touched=1)))
    with store.read() as session:
        [key] = joining.touched_plants(session)
    both, keep = threading.Barrier(2), joining.keep_results

    def keep_at_once(session: Session, plant_key: str, results: Sequence[Result]) -> None:
        with suppress(threading.BrokenBarrierError):  # whoever waits for the lock cannot come
            both.wait(0.3)
        keep(session, plant_key, results)

    monkeypatch.setattr(joining, "keep_results", keep_at_once)
    with ThreadPoolExecutor(2) as pool:
        ends = [pool.submit(joining.join, store, ArtifactStore(tmp_path / "artifacts"), key) for _ in range(2)]
        assert [end.result(30) for end in ends] == [True, True]
    with store.read() as session:
        assert session.scalars(select(PlantScan.scan_id)).all() == [scan.id]
        assert joining.touched_plants(session) == ()
