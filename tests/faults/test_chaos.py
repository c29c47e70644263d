"""Random runners and workers are killed and frozen under running scans: nothing is lost or doubled."""

import os
import random
import signal
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest
from scanjobs import workers
from scanjobs.messages import TRAIN
from scanjobs.migrate import upgrade
from scanjobs.settings import Settings

from tests.integration.toy_service import (
    Service,
    WorkerProcess,
    looking_at,
    toy_settings,
    toy_spec,
    worker_process,
)

FAULTS_S = 8.0


class Crew:
    """Two workers; one that is killed is replaced."""

    def __init__(self, settings: Settings, chance: random.Random) -> None:
        self._settings = settings
        self._chance = chance
        self._workers = [WorkerProcess(settings) for _ in range(2)]

    def suffer(self) -> None:
        """Kill a runner or a worker, or freeze a worker for less or more than its lease."""
        worker = self._chance.choice(self._workers)
        fate = self._chance.choice(["runner", "runner", "worker", "freeze"])
        if fate == "runner":
            for pid in children_of(worker.pid)[:1]:
                os.kill(pid, signal.SIGKILL)
        elif fate == "worker":
            worker.close()
            self._workers[self._workers.index(worker)] = WorkerProcess(self._settings)
        else:
            worker.signal(signal.SIGSTOP)
            time.sleep(self._chance.choice([0.2, 1.2 * self._settings.lease_s]))
            worker.signal(signal.SIGCONT)

    def close(self) -> None:
        """Kill them all."""
        for worker in self._workers:
            worker.close()


def children_of(pid: int) -> list[int]:
    """Processes started by a process."""
    tasks = Path(f"/proc/{pid}/task").glob("*/children")
    return [int(child) for task in tasks for child in task.read_text().split()]


@contextmanager
def crew(settings: Settings, chance: random.Random) -> Iterator[Crew]:
    """Two workers until the block ends."""
    with ExitStack() as stack:
        hired = Crew(settings, chance)
        stack.callback(hired.close)
        yield hired


def suffer_for(seconds: float, hired: Crew, chance: random.Random) -> None:
    """One fault after the other."""
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        time.sleep(chance.uniform(0.2, 1.0))
        hired.suffer()


@pytest.mark.parametrize("seed", [1])
def test_random_kills_lose_and_double_nothing(tmp_path: Path, seed: int) -> None:
    """Fsck says that each step was accepted once; the guards one by one are in tests/unit/scanjobs/test_leases.py."""
    chance = random.Random(seed)
    settings = toy_settings(tmp_path).model_copy(update={"lease_s": 2.0, "max_attempts": 100})
    upgrade(settings.database)
    with looking_at(settings) as service, crew(settings, chance) as hired:
        scans = [service.submit(toy_spec(frames=4, seed=number)) for number in range(2)]
        suffer_for(FAULTS_S, hired, chance)
        for scan_id in scans:
            assert service.end_of(scan_id).state == "succeeded"
        assert service.violations() == ()


def test_operator_drains_a_worker(tmp_path: Path) -> None:
    """A row tells a worker to go: it gives its step back, ends with 0, and another one finishes the scan."""
    settings = toy_settings(tmp_path)
    upgrade(settings.database)
    with looking_at(settings) as service, worker_process(settings) as worker:
        scan_id = service.submit(toy_spec(frames=1, trouble=f"{TRAIN}:-1:slow_once={tmp_path}/was_slow"))
        service.runner_of(scan_id, TRAIN, -1, mark=tmp_path / "was_slow")
        drain_all(service)
        assert worker.wait(15) == 0
        assert service.step(scan_id, TRAIN, -1).attempt == 0
        with worker_process(settings):
            assert service.end_of(scan_id).state == "succeeded"
        assert service.violations() == ()


def drain_all(service: Service) -> None:
    """Ask every worker that is alive to drain."""
    with service.store.read() as session:
        ids = [worker.id for worker in workers.active_workers(session)]
    service.store.write(lambda session: workers.drain(session, ids))
