"""The tables and the races on a real PostgreSQL."""

import subprocess
import sys
import threading
import time
from collections.abc import Collection
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from scanjobs import dispatch, leases, repository, workers
from scanjobs.artifacts import ArtifactStore
from scanjobs.clock import now_s
from scanjobs.fsck import check
from scanjobs.messages import EXTRACT, IDENTIFY, QUEUES, RENDER, TRAIN
from scanjobs.migrate import upgrade
from scanjobs.store import open_store
from scanjobs.workers import WorkerIdentity
from sqlalchemy import select
from sqlalchemy.orm import Session

from tests.integration.toy_service import toy_spec


def test_processes_that_start_together_migrate_one_after_the_other(database_url: str) -> None:
    url = database_url
    program = f"from scanjobs.migrate import upgrade; upgrade({url!r})"
    processes = [subprocess.Popen([sys.executable, "-c", program]) for _ in range(4)]
    assert [process.wait(60) for process in processes] == [0, 0, 0, 0]


def test_clock_is_in_seconds_since_1970(database_url: str) -> None:
    store = open_store(database_url)
    with store.read() as session:
        assert 1.7e9 < session.scalars(select(now_s())).one() < 1e10
    store.close()


@pytest.mark.parametrize("repetition", range(2))
def test_parents_that_finish_together_wake_every_child_once(database_url: str, tmp_path: Path, repetition: int) -> None:
    """The dispatcher, the claims and the fan-ins of 8 frames by 8 racing threads; every step is done once.

    Guard: `deps_left` is counted down by the statement that ends a parent (`transitions.count_down`). Seen to fail:
    with the unfinished parents counted in its place some steps are never claimed.
    """
    upgrade(database_url)
    store = open_store(database_url)
    identity = WorkerIdentity(id="w", host="here", pid=1, queues=QUEUES, slots=8)
    store.write(lambda session: workers.register(session, identity, 600.0))
    scan = store.write(lambda session: repository.insert_scan(session, toy_spec(frames=8))).scan
    done = threading.Event()

    def work() -> None:
        while not done.is_set():
            for message in store.write(dispatch.dispatch):
                claim = store.write(lambda session, step=message.step_id: leases.claim(session, step, "w", 60.0))
                if claim is None:
                    continue
                accepted = store.write(lambda session, held=claim: leases.finish(session, held, (), {}))
                if accepted and claim.kind == IDENTIFY:
                    done.set()
            time.sleep(0.02)

    threads = [threading.Thread(target=work, daemon=True) for _ in range(8)]
    for thread in threads:
        thread.start()
    assert done.wait(60)
    for thread in threads:
        thread.join(10)
    with store.read() as session:
        assert repository.get_scan(session, scan.id).state == "succeeded"
        steps = repository.list_steps(session, scan)
        assert check(session, ArtifactStore(tmp_path / "artifacts")) == (), repetition
    assert {step.token for step in steps} == {1}
    assert {step.kind for step in steps} == {RENDER, TRAIN, EXTRACT, IDENTIFY}
    store.close()


def test_two_dispatchers_fill_the_window_once(database_url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The second looks for room while the first has not committed, and for steps when it has.

    Guard: `one_at_a_time` in `dispatch`. Seen to fail: without it eight messages are sent where there is room for four.
    """
    upgrade(database_url)
    store = open_store(database_url)
    identity = WorkerIdentity(id="w", host="here", pid=1, queues=QUEUES, slots=2)
    store.write(lambda session: workers.register(session, identity, 600.0))
    store.write(lambda session: repository.insert_scan(session, toy_spec(frames=12)))
    has_room, is_committed, look = threading.Event(), threading.Event(), dispatch.candidates

    def look_late(session: Session, queues: Collection[str], most: int) -> list[dispatch.Candidate]:
        has_room.set()
        is_committed.wait(10)
        return look(session, queues, most)

    with ThreadPoolExecutor(1) as pool:
        with Session(store.engine) as session:
            sent = dispatch.dispatch(session)
            monkeypatch.setattr(dispatch, "candidates", look_late)
            second = pool.submit(store.write, dispatch.dispatch)
            has_room.wait(0.5)
            session.commit()
        is_committed.set()
        assert len(sent) + len(second.result(10)) == dispatch.WINDOW * identity.slots
    store.close()
