"""Servers and workers that are killed, frozen, ended and started again around a scan, each in a folder of its own."""

import os
import signal
import time
from functools import partial

from scanjobs.messages import RENDER, TRAIN
from scanjobs.migrate import upgrade
from scanjobs.plan import WHOLE_SCAN
from scanjobs.settings import Settings
from scanjobs.states import StepState

from tests.integration.toy_service import Service, is_alive, looking_at, serving, toy_spec, worker_process


def test_killed_worker_is_replaced_without_redoing_finished_steps(settings: Settings) -> None:
    upgrade(settings.database)
    with looking_at(settings) as service:
        scan_id = service.submit(toy_spec(trouble=f"{TRAIN}:1:slow_once={settings.data_folder}/was_slow"))
        with worker_process(settings) as first:
            runner = service.runner_of(scan_id, TRAIN, 1, mark=settings.data_folder / "was_slow")
            finished = {step.id for step in service.steps(scan_id) if step.state == StepState.SUCCEEDED}
            first.signal(signal.SIGKILL)
            first.wait(5)
            service.wait(lambda: not is_alive(runner), 2)
        assert finished
        with worker_process(settings):
            assert service.end_of(scan_id).state == "succeeded"
        assert {step.token for step in service.steps(scan_id) if step.id in finished} == {1}
        assert service.step(scan_id, TRAIN, 1).attempt == 2
        assert service.violations() == ()


def test_server_killed_three_times_finishes_its_scan(settings: Settings) -> None:
    """The embedded server, killed whole in mid-scan, goes on from the file it left."""
    upgrade(settings.database)
    with looking_at(settings) as service:
        scan_id = service.submit(toy_spec(frames=4))
        for finished in (1, 5, 9):
            with worker_process(settings) as server:
                service.wait(partial(has_finished, service, scan_id, finished))
                server.signal(signal.SIGKILL)
                server.wait(5)
        with worker_process(settings):
            assert service.end_of(scan_id).state == "succeeded"
        assert service.violations() == ()


def test_killed_server_leaves_no_working_files_to_the_next(settings: Settings) -> None:
    upgrade(settings.database)
    work = settings.data_folder / "work"
    with looking_at(settings) as service:
        scan_id = service.submit(toy_spec(frames=1, trouble=f"{RENDER}:0:slow_once={settings.data_folder}/was_slow"))
        with worker_process(settings) as server:
            service.runner_of(scan_id, RENDER, 0, mark=settings.data_folder / "was_slow")
            server.signal(signal.SIGKILL)
            server.wait(5)
        assert list(work.glob("*/*"))
        with worker_process(settings):
            assert service.end_of(scan_id).state == "succeeded"
            service.wait(lambda: not list(work.glob("*/*")), 5)


def test_embedded_server_ends_with_everything_it_started(settings: Settings) -> None:
    """Also with a step under way: nothing is left running, and the next start goes on."""
    spec = toy_spec(frames=1, trouble=f"{TRAIN}:-1:slow_once={settings.data_folder}/was_slow")
    with serving(settings) as service:
        scan_id = service.submit(spec)
        runner = service.runner_of(scan_id, TRAIN, WHOLE_SCAN, mark=settings.data_folder / "was_slow")
    assert not is_alive(runner)
    with serving(settings) as service:
        assert service.end_of(scan_id).state == "succeeded"
        assert service.step(scan_id, TRAIN, WHOLE_SCAN).attempt == 1


def has_finished(service: Service, scan_id: str, count: int) -> bool:
    """Whether so many steps have succeeded."""
    return sum(step.state == StepState.SUCCEEDED for step in service.steps(scan_id)) >= count


def test_terminated_worker_gives_its_step_back_uncounted(settings: Settings) -> None:
    upgrade(settings.database)
    with looking_at(settings) as service, worker_process(settings) as worker:
        scan_id = service.submit(toy_spec(trouble=f"{TRAIN}:-1:slow"))
        runner = service.runner_of(scan_id, TRAIN, WHOLE_SCAN)
        asked_at = time.monotonic()
        worker.signal(signal.SIGTERM)
        assert worker.wait(15) == 0
        assert time.monotonic() - asked_at < 15
        step = service.step(scan_id, TRAIN, WHOLE_SCAN)
        assert (step.state, step.attempt) == (StepState.READY, 0)
        assert not is_alive(runner)
        assert service.violations() == ()


def test_frozen_worker_is_fenced_off(settings: Settings) -> None:
    """A worker that sleeps for three leases wakes up to a step that somebody else has finished."""
    quick = settings.model_copy(update={"lease_s": 1.5})
    upgrade(quick.database)
    with looking_at(quick) as service, worker_process(quick) as frozen:
        scan_id = service.submit(toy_spec(frames=1, trouble=f"{TRAIN}:-1:slow_once={quick.data_folder}/was_slow"))
        service.runner_of(scan_id, TRAIN, WHOLE_SCAN, mark=quick.data_folder / "was_slow")
        frozen.signal(signal.SIGSTOP)
        with worker_process(quick):
            assert service.end_of(scan_id).state == "succeeded"
            frozen.signal(signal.SIGCONT)
            time.sleep(1.0)
        assert service.step(scan_id, TRAIN, WHOLE_SCAN).token == 2
        assert service.violations() == ()


def test_runner_ends_when_its_supervisor_is_gone(settings: Settings) -> None:
    upgrade(settings.database)
    with looking_at(settings) as service, worker_process(settings) as worker:
        scan_id = service.submit(toy_spec(frames=1, trouble=f"{RENDER}:0:slow"))
        runner = service.runner_of(scan_id, RENDER, 0)
        os.kill(worker.pid, signal.SIGKILL)
        service.wait(lambda: not is_alive(runner), 5.0)


def test_step_that_takes_too_long_fails(settings: Settings) -> None:
    short = settings.model_copy(update={"step_limit_s": 0.5, "max_attempts": 1})
    with serving(short) as service:
        scan = service.end_of(service.submit(toy_spec(frames=1, trouble=f"{TRAIN}:-1:slow")))
        assert (scan.state, (scan.error or {})["code"]) == ("failed", "STEP_TOO_LONG")
        assert service.violations() == ()


def test_nothing_is_begun_on_a_disk_that_is_nearly_full(settings: Settings) -> None:
    full = settings.model_copy(update={"disk_low_mb": 10**9})
    upgrade(full.database)
    with looking_at(full) as service:
        scan_id = service.submit(toy_spec(frames=1))
        with serving(full):
            time.sleep(1.0)
            assert {step.token for step in service.steps(scan_id)} == {0}
        with serving(settings):
            assert service.end_of(scan_id).state == "succeeded"
