"""Fault 3: kill -9 the whole embedded server, three times in one scan."""

import signal

from scanjobs.settings import Settings

from tests.faults.steps import assert_whole, wait_for
from tests.integration.toy_service import looking_at, toy_spec, worker_process


def test_server_killed_three_times_finishes_its_scan(embedded: Settings) -> None:
    """Its messages lay in its memory: the next server finds them in the rows.

    Guard: `sent` steps that nobody claims are taken back (`dispatch.unclaimed_steps`).
    Seen to fail: with `unclaimed_steps` returning nothing the sent steps of the dead server are never sent again.
    """
    with looking_at(embedded) as service:
        scan_id = service.submit(toy_spec(frames=4))
        for finished in (1, 5, 9):
            with worker_process(embedded) as server:
                wait_for(service, scan_id, finished)
                server.signal(signal.SIGKILL)
                server.wait(5)
        with worker_process(embedded):
            assert_whole(service, scan_id)
