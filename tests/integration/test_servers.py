"""Servers and workers that are killed, frozen, ended and started again around a scan, each in a folder of its own."""

import signal
import time

from scanjobs.messages import RENDER, TRAIN
from scanjobs.migrate import upgrade
from scanjobs.plan import WHOLE_SCAN
from scanjobs.settings import Settings

from tests.integration.toy_service import is_alive, looking_at, serving, toy_spec, worker_process


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
