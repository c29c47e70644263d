"""Fault 13: SIGTERM during the training of frame 0: exit 0, nothing lost, the same weights in the end."""

import signal
import time

from scanjobs.messages import TRAIN
from scanjobs.plan import WHOLE_SCAN
from scanjobs.settings import Settings
from scanjobs.states import StepState

from tests.faults.steps import assert_whole, kill, seconds_since
from tests.integration.toy_service import Service, is_alive, looking_at, toy_spec, worker_process

CHAIN = f"{TRAIN}:-1:chain=3"


def test_terminated_training_goes_on_where_it_was_and_ends_the_same(settings: Settings) -> None:
    """Promises (d) and (f). Two scans of one specification; the training of the first is terminated half way.

    Guard: what a runner saves when it is stopped is stored and given to the next attempt (`Supervisor._go_on`).
    Seen to fail: with `leases.save` storing nothing the second attempt takes up at 0.
    """
    with looking_at(settings) as service, worker_process(settings) as worker:
        scan_id = service.submit(toy_spec(frames=1, trouble=CHAIN))
        runner = service.runner_of(scan_id, TRAIN, WHOLE_SCAN)
        wait_for_links(service, scan_id, 100)
        asked_at = time.monotonic()
        worker.signal(signal.SIGTERM)
        assert worker.wait(15) == 0
        assert seconds_since(asked_at) < 15
        step = service.step(scan_id, TRAIN, WHOLE_SCAN)
        assert (step.state, step.attempt) == (StepState.READY, 0)
        assert not is_alive(runner)
        with worker_process(settings):
            undisturbed = service.submit(toy_spec(frames=1, trouble=CHAIN))
            assert_whole(service, scan_id)
            assert_whole(service, undisturbed)
        assert taken_up_at(service, scan_id) >= 100
        assert taken_up_at(service, undisturbed) == 0
        weights = [service.file(one, TRAIN, WHOLE_SCAN, "checkpoint") for one in (scan_id, undisturbed)]
        assert weights[0] == weights[1]


def test_killed_training_loses_no_more_than_one_interval(embedded: Settings) -> None:
    """Promise (d): kill -9 gives no chance to save, so what is lost is what was done since the last save.

    Guard: `save_every_s` reaches the task, and `saved` lines are stored while the step computes (`Supervisor._watch`).
    Seen to fail: with `saved` lines ignored the second attempt takes up at 0.
    """
    with looking_at(embedded) as service, worker_process(embedded):
        scan_id = service.submit(toy_spec(frames=1, trouble=CHAIN))
        runner = service.runner_of(scan_id, TRAIN, WHOLE_SCAN)
        wait_for_links(service, scan_id, 150)
        kill(runner)
        assert_whole(service, scan_id)
        interval = embedded.save_every_s / 0.01
        assert taken_up_at(service, scan_id) >= 150 - 2 * interval


def wait_for_links(service: Service, scan_id: str, links: int) -> None:
    """Until the training has told of so many links."""
    service.wait(lambda: service.step(scan_id, TRAIN, WHOLE_SCAN).progress_done >= links)


def taken_up_at(service: Service, scan_id: str) -> int:
    """How many links the last attempt did not have to compute."""
    return int((service.step(scan_id, TRAIN, WHOLE_SCAN).facts or {})["taken_up_at"])
