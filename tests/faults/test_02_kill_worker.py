"""Fault 2: kill -9 a worker that holds a step, three times."""

import time
from functools import partial

import pytest
from scanjobs.settings import Settings
from scanjobs.states import StepState
from scanjobs.tables import Step, Worker
from sqlalchemy import select

from tests.faults.steps import RECOVERY_S, assert_whole, seconds_since, workers
from tests.integration.toy_service import Service, WorkerProcess, is_alive, looking_at, toy_spec


def test_three_killed_workers_are_replaced_within_the_lease(
    settings: Settings, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Promise (c): the step is claimed again within the lease and five seconds; its runner ends with its worker.

    Guard: `leases.reap` of what is overdue (`Ticker._take_back_lost`).
    Seen to fail: with `overdue_steps` returning nothing the step stays running and the test waits in vain.
    """
    monkeypatch.setenv("TOY_SECONDS", "0.6")
    patient = settings.model_copy(update={"max_attempts": 9})
    with looking_at(patient) as service, workers(patient, 2) as hired:
        scan_id = service.submit(toy_spec(frames=3))
        for _ in range(3):
            step_id, runner = one_running(service)
            token = token_of(service, step_id)
            victim = next((worker for worker in hired if worker.pid == holder_of(service, step_id)), hired[0])
            victim.close()
            killed_at = time.monotonic()
            service.wait(partial(is_dead, runner), RECOVERY_S)
            service.wait(partial(is_claimed_again, service, step_id, token))
            assert seconds_since(killed_at) < settings.lease_s + RECOVERY_S
            hired[hired.index(victim)] = WorkerProcess(patient)
        assert_whole(service, scan_id)


def one_running(service: Service) -> tuple[str, int]:
    """A step that is computed now, and the process that does; seen in one look, for it may end between two."""
    seen: list[tuple[str, int]] = []

    def look() -> bool:
        seen.extend(service.runners().items())
        return bool(seen)

    service.wait(look)
    return seen[0]


def holder_of(service: Service, step_id: str) -> int | None:
    """Process id of the worker that has the step."""
    query = select(Worker.pid).join(Step, Step.worker_id == Worker.id).where(Step.id == step_id)
    with service.store.read() as session:
        return session.scalars(query).one_or_none()


def token_of(service: Service, step_id: str) -> int:
    """How often the step has been claimed."""
    with service.store.read() as session:
        return session.get_one(Step, step_id).token


def is_claimed_again(service: Service, step_id: str, token: int) -> bool:
    """Whether somebody has claimed the step since, or it had ended before the kill."""
    with service.store.read() as session:
        step = session.get_one(Step, step_id)
        return step.token > token or step.state == StepState.SUCCEEDED


def is_dead(pid: int) -> bool:
    """Whether the process is gone."""
    return not is_alive(pid)
