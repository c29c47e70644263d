"""Fault 1: kill -9 a random runner, six times."""

import random
import time

import pytest
from scanjobs.settings import Settings

from tests.faults.steps import assert_whole, kill, workers
from tests.integration.toy_service import looking_at, toy_spec


def test_six_killed_runners_cost_six_attempts_and_no_step(settings: Settings, monkeypatch: pytest.MonkeyPatch) -> None:
    """Guard: `RUNNER_DIED` is retryable (`death_of`, `leases.fail`).

    Seen to fail: with `retryable=False` in `death_of` the scan has failed after the first kill.
    """
    monkeypatch.setenv("TOY_SECONDS", "0.4")
    chance = random.Random(1)
    patient = settings.model_copy(update={"max_attempts": 9})
    with looking_at(patient) as service, workers(patient, 1):
        scan_id = service.submit(toy_spec(frames=4))
        killed: set[int] = set()
        while len(killed) < 6:
            assert service.scan(scan_id).state in ("queued", "running")
            running = sorted(pid for pid in service.runners().values() if pid not in killed)
            if running:
                victim = chance.choice(running)
                killed.add(victim)
                kill(victim)
            time.sleep(0.05)
        assert_whole(service, scan_id)
        assert sum(step.attempt - 1 for step in service.steps(scan_id)) >= 5  # one may have died between two steps
