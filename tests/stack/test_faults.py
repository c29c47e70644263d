"""Toy scans on PostgreSQL and Redis while one of them is emptied, killed, frozen or restarted."""

import signal
import threading
import time
from collections.abc import Callable
from functools import partial

import redis as redis_client
from scanjobs import control
from scanjobs.errors import IllegalTransition
from scanjobs.messages import TRAIN
from scanjobs.migrate import upgrade
from scanjobs.plan import WHOLE_SCAN
from scanjobs.settings import Settings
from scanjobs.states import StepState

from tests.integration.toy_service import Service, is_alive, looking_at, toy_spec, worker_process
from tests.stack.servers import Postgres, Redis


def has_finished(service: Service, scan_id: str, count: int) -> bool:
    """Whether so many steps have succeeded."""
    return sum(step.state == StepState.SUCCEEDED for step in service.steps(scan_id)) >= count


def assert_all_done_once(service: Service, scan_id: str) -> None:
    """Every step has succeeded with its first token, and the database is sound."""
    assert service.end_of(scan_id).state == "succeeded"
    assert {step.token for step in service.steps(scan_id)} == {1}
    assert service.violations() == ()


def test_two_workers_share_a_scan(settings: Settings) -> None:
    upgrade(settings.database)
    with looking_at(settings) as service, worker_process(settings), worker_process(settings):
        scan_id = service.submit(toy_spec(frames=6))
        assert_all_done_once(service, scan_id)


def test_emptied_redis_is_only_delay(settings: Settings, redis: Redis) -> None:
    """FLUSHALL at the barrier of the first training and again later: lost messages are sent again."""
    upgrade(settings.database)
    client = redis_client.Redis.from_url(redis.url)
    with looking_at(settings) as service, worker_process(settings):
        scan_id = service.submit(toy_spec(frames=4))
        for finished in (4, 7):
            service.wait(partial(has_finished, service, scan_id, finished))
            client.flushall()
        assert_all_done_once(service, scan_id)
    client.close()


def test_redis_killed_and_restarted_empty_is_only_delay(settings: Settings, redis: Redis) -> None:
    upgrade(settings.database)
    with looking_at(settings) as service, worker_process(settings):
        scan_id = service.submit(toy_spec(frames=4))
        service.wait(partial(has_finished, service, scan_id, 3))
        redis.stop()
        began = time.monotonic()
        other = service.submit(toy_spec(frames=1))
        assert time.monotonic() - began < 1.0
        time.sleep(3.0)
        redis.start()
        assert service.end_of(scan_id).state == "succeeded"
        assert service.end_of(other).state == "succeeded"
        assert service.violations() == ()


def test_frozen_redis_holds_up_nothing_but_messages(settings: Settings, redis: Redis) -> None:
    """While Redis is stopped, scans are submitted and cancelled and running steps are stopped."""
    upgrade(settings.database)
    with looking_at(settings) as service, worker_process(settings):
        scan_id = service.submit(toy_spec(frames=1, trouble=f"{TRAIN}:-1:slow"))
        runner = service.runner_of(scan_id, TRAIN, WHOLE_SCAN)
        redis.send(signal.SIGSTOP)
        try:
            began = time.monotonic()
            service.submit(toy_spec(frames=1))
            service.store.write(lambda session: control.cancel_scan(session, scan_id))
            assert time.monotonic() - began < 2.0
            assert service.end_of(scan_id, 5).state == "canceled"
            assert not is_alive(runner)
        finally:
            redis.send(signal.SIGCONT)


def test_killed_worker_on_redis_is_replaced(settings: Settings) -> None:
    upgrade(settings.database)
    with looking_at(settings) as service:
        scan_id = service.submit(toy_spec(trouble=f"{TRAIN}:1:slow_once={settings.data_folder.parent}/was_slow"))
        with worker_process(settings) as first:
            service.runner_of(scan_id, TRAIN, 1, mark=settings.data_folder.parent / "was_slow")
            finished = {step.id for step in service.steps(scan_id) if step.state == StepState.SUCCEEDED}
            first.signal(signal.SIGKILL)
            first.wait(5)
        with worker_process(settings):
            assert service.end_of(scan_id).state == "succeeded"
        assert {step.token for step in service.steps(scan_id) if step.id in finished} == {1}
        assert service.violations() == ()


def test_postgres_restarted_twice_loses_nothing(settings: Settings, postgres: Postgres) -> None:
    upgrade(settings.database)
    with looking_at(settings) as service, worker_process(settings):
        scan_id = service.submit(toy_spec(frames=4))
        for finished in (2, 6):
            service.wait(partial(has_finished, service, scan_id, finished))
            postgres.restart_at_once()
        assert service.end_of(scan_id).state == "succeeded"
        assert service.violations() == ()


def test_cancels_race_with_finishes(settings: Settings) -> None:
    """Six scans are cancelled at six moments of their life; none is stuck and no step lives on."""
    upgrade(settings.database)
    with looking_at(settings) as service, worker_process(settings):
        ids = [service.submit(toy_spec(frames=1, seed=seed)) for seed in range(6)]

        def cancel(position: int) -> None:
            time.sleep(0.4 * position)
            service.store.write(lambda session: control.cancel_scan(session, ids[position]))

        threads = [threading.Thread(target=partial(_quietly, cancel, position)) for position in range(6)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert {service.end_of(scan_id).state for scan_id in ids} <= {"canceled", "succeeded"}
        assert service.violations() == ()


def _quietly(cancel: Callable[[int], None], position: int) -> None:
    """A scan that has ended already cannot be cancelled."""
    try:
        cancel(position)
    except IllegalTransition:
        return
