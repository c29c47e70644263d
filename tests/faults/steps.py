"""What the fault tests do over and over: wait for progress, see that nothing was lost or doubled, kill."""

import contextlib
import os
import signal
import sqlite3
import time
from collections.abc import Iterator

from scanjobs.settings import Settings
from scanjobs.states import StepState

from tests.integration.toy_service import Service, WorkerProcess

RECOVERY_S = 5.0
"""Beyond the lease: promise (c)."""


def has_finished(service: Service, scan_id: str, count: int) -> bool:
    """Whether so many steps have succeeded."""
    return sum(step.state == StepState.SUCCEEDED for step in service.steps(scan_id)) >= count


def wait_for(service: Service, scan_id: str, count: int) -> None:
    """Until so many steps have succeeded."""
    service.wait(lambda: has_finished(service, scan_id, count))


def assert_whole(service: Service, scan_id: str, seconds: float = 60.0) -> None:
    """The scan succeeds, every step was accepted once, and the database and the files are sound."""
    scan = service.end_of(scan_id, seconds)
    assert scan.state == "succeeded", scan.error
    assert {step.state for step in service.steps(scan_id)} == {StepState.SUCCEEDED}
    assert service.violations() == ()


def kill(pid: int) -> None:
    """SIGKILL, if it still lives."""
    with contextlib.suppress(ProcessLookupError):
        os.kill(pid, signal.SIGKILL)


def freeze(worker: WorkerProcess, service: Service) -> None:
    """SIGSTOP a worker, but not in the middle of a transaction, which would keep all others from SQLite's file."""
    while True:
        worker.signal(signal.SIGSTOP)
        if service.store.dialect != "sqlite" or can_write(service.settings):
            return
        worker.signal(signal.SIGCONT)
        time.sleep(0.05)


def can_write(settings: Settings) -> bool:
    """Whether nobody writes to the SQLite file at this moment, or reads from it: no commit passes a reader."""
    with contextlib.closing(sqlite3.connect(settings.data_folder / "nerfmodal.db", timeout=0.2)) as connection:
        try:
            connection.execute("BEGIN EXCLUSIVE")
        except sqlite3.OperationalError:
            return False
    return True


@contextlib.contextmanager
def workers(settings: Settings, count: int) -> Iterator[list[WorkerProcess]]:
    """Workers in processes of their own; whoever is in the list at the end is killed."""
    hired = [WorkerProcess(settings) for _ in range(count)]
    try:
        yield hired
    finally:
        for worker in hired:
            worker.close()


def seconds_since(began: float) -> float:
    """Of the monotonic clock."""
    return time.monotonic() - began
