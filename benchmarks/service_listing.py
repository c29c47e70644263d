"""A page of scans among 1,000,000 against among 1,000, on PostgreSQL: the database's part, p95, turn by turn.

Rows are made by `generate_series`: a tenth has failed, a tenth runs, each has two tags and four steps; pages are full.
"""

import statistics
import time
from collections.abc import Callable, Iterator

from scanjobs import repository
from scanjobs.repository import Page, list_scans, summaries_of
from scanjobs.states import ScanState
from scanjobs.store import Store, open_store
from sqlalchemy import text
from sqlalchemy.orm import Session

from benchmarks.rows import Row
from benchmarks.service_servers import Servers

MANY, FEW = 1_000_000, 1_000
TURNS = 200
PAGE = 50
SCANS = """
INSERT INTO scan (id, owner, root_id, name, source_kind, spec, spec_digest, plant, state, generation, priority, version,
                  cancel_seq, max_failed_frames, frames, created_at)
SELECT id, 'local', id, 'scan-' || n, 'simulation', '{"name": "x", "tags": []}', md5(n::text),
       'plant-' || n % 10, CASE WHEN n % 10 = 0 THEN 'failed' WHEN n % 10 = 1 THEN 'running' ELSE 'succeeded' END,
       0, 0, 0, 0, 0, 4, n
FROM (SELECT n, '0198' || lpad(to_hex(n / 65536), 4, '0') || '-' || lpad(to_hex(n % 65536), 4, '0') || '-7000-8000-'
      || lpad(to_hex(n), 12, '0') AS id FROM generate_series(1, :count) AS n) AS numbered
"""
STEPS = """
INSERT INTO step (id, scan_id, kind, frame, generation, queue, depth, state, deps_left, fresh, attempt, token,
                  progress_done, progress_total, progress_message, created_at)
SELECT gen_random_uuid()::text, scan.id, kind, frame, 0, 'render', 0, 'succeeded', 0, false, 1, 1, 10, 10, '', 0
FROM scan, (VALUES ('frame.render', 0), ('frame.train', 0), ('frame.extract', 0), ('scan.identify', -1))
     AS kinds (kind, frame)
"""
TAGS = "INSERT INTO scan_tag SELECT id, 'tag-' || n FROM scan, LATERAL (VALUES (created_at::int % 7), (100)) AS t (n)"
Look = Callable[[Session, int], Page]
"""A page of a database of so many scans."""


def listing_rows(machine: Servers) -> Iterator[Row]:
    """The first page, one in the middle, and pages by state, plant and tag."""
    stores = {count: _filled(machine, count) for count in (FEW, MANY)}
    for name, look in LOOKS.items():
        short, long = _in_turns(stores, look)
        what = f"a page among {MANY:,} over among {FEW:,} scans, p95: {name} ({long * 1e3:.1f} ms)"
        yield Row(what=what, value=long / short, unit="x", floor=2.0, aim=1.2)
    for store in stores.values():
        store.close()


LOOKS: dict[str, Look] = {
    "first": lambda session, _: list_scans(session, limit=PAGE),
    "middle": lambda session, count: list_scans(session, limit=PAGE, cursor=_cursor(count // 2)),
    "failed": lambda session, _: list_scans(session, limit=PAGE, states=[ScanState.FAILED]),
    "running": lambda session, _: list_scans(
        session, limit=PAGE, states=[ScanState.RUNNING, ScanState.PAUSED, ScanState.CANCELING]
    ),
    "plant": lambda session, _: list_scans(session, limit=PAGE, plant_id="plant-7"),
    "tag": lambda session, _: list_scans(session, limit=PAGE, tag="tag-3"),
}


def _cursor(number: int) -> str:
    return repository._write_cursor(_id(number))


def _id(number: int) -> str:
    """The id that `SCANS` gives its n-th row."""
    return f"0198{number // 65536:04x}-{number % 65536:04x}-7000-8000-{number:012x}"


def _filled(machine: Servers, count: int) -> Store:
    """A database of so many scans, analysed."""
    store = open_store(machine.database(f"listing_{count}"))
    store.write(lambda session: session.execute(text(SCANS), {"count": count}))
    for statement in (STEPS, TAGS):
        store.write(lambda session, statement=statement: session.execute(text(statement)))
    with store.engine.connect().execution_options(isolation_level="AUTOCOMMIT") as connection:
        connection.execute(text("VACUUM ANALYZE"))
    return store


def _in_turns(stores: dict[int, Store], look: Look) -> tuple[float, float]:
    """p95 among few and among many, in seconds."""
    taken: dict[int, list[float]] = {count: [] for count in stores}
    for _ in range(TURNS):
        for count, store in stores.items():
            taken[count].append(_time(store, count, look))
    short, long = (statistics.quantiles(taken[count], n=20)[-1] for count in (FEW, MANY))
    return short, long


def _time(store: Store, count: int, look: Look) -> float:
    began = time.perf_counter()
    with store.read() as session:
        page = look(session, count)
        summaries_of(session, page.items)
    return time.perf_counter() - began
