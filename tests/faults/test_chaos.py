"""Random runners and workers are killed and frozen under running scans (`benchmarks.chaos`, a few kills of it)."""

import random
from pathlib import Path

from scanjobs import workers
from scanjobs.messages import TRAIN
from scanjobs.migrate import upgrade
from scanjobs.settings import Settings

from benchmarks.chaos import Crew, doubled_steps, lost_steps, open_scans, torment
from tests.integration.toy_service import Service, looking_at, toy_settings, toy_spec, worker_process

KILLS = 15


def test_random_kills_lose_and_double_nothing(settings: Settings) -> None:
    """All guards together; one by one they are in the numbered files."""
    chance = random.Random(1)
    patient = settings.model_copy(update={"lease_s": 2.0, "max_attempts": 100})
    with looking_at(patient) as service:
        crew = Crew(patient, 2, chance)
        try:
            assert torment(service, crew, chance, KILLS, 2.0).total >= KILLS
            service.wait(lambda: not open_scans(service), 120)
        finally:
            crew.close()
        assert (lost_steps(service), doubled_steps(service), service.violations()) == (0, 0, ())


def test_operator_drains_a_worker(tmp_path: Path) -> None:
    """A row tells a worker to go: it gives its step back, ends with 0, and another one finishes the scan.

    Guard: `on_drain` in `Ticker._beat`. Seen to fail: without it the worker has not ended after fifteen seconds.
    """
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
