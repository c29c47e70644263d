"""Fault 9: PostgreSQL is restarted at once (`-m immediate`), twice in one scan; and stays away for two leases."""

import time

from scanjobs.messages import TRAIN
from scanjobs.plan import WHOLE_SCAN
from scanjobs.settings import Settings

from tests.faults.steps import assert_whole, wait_for
from tests.integration.toy_service import is_alive, looking_at, toy_spec, worker_process
from tests.stack.servers import Postgres


def test_postgres_restarted_twice_loses_nothing(served: Settings, postgres: Postgres) -> None:
    """Every connection breaks, some in the middle of a transaction.

    Guard: a failed tick is tried again (`Ticker._run`), an ending is written until it is (`Supervisor._write`).
    Seen to fail: with `Ticker._run` letting database errors out, the ticker dies and the scan never ends.
    """
    with looking_at(served) as service, worker_process(served):
        scan_id = service.submit(toy_spec(frames=4))
        for finished in (2, 6):
            wait_for(service, scan_id, finished)
            postgres.restart_at_once()
        assert_whole(service, scan_id)


def test_runner_stops_itself_when_the_database_is_away_for_a_lease(served: Settings, postgres: Postgres) -> None:
    """Promise (h): by then somebody else may have the step.

    Guard: `Supervisor._is_expired`. Seen to fail: with it returning False the runner computes on.
    """
    quick = served.model_copy(update={"lease_s": 2.0})
    with looking_at(quick) as service, worker_process(quick):
        scan_id = service.submit(toy_spec(frames=1, trouble=f"{TRAIN}:-1:slow_once={quick.data_folder}/was_slow"))
        runner = service.runner_of(scan_id, TRAIN, WHOLE_SCAN, mark=quick.data_folder / "was_slow")
        postgres.stop()
        try:
            deadline = time.monotonic() + 3 * quick.lease_s + 5
            while is_alive(runner) and time.monotonic() < deadline:
                time.sleep(0.1)
            assert not is_alive(runner)
        finally:
            postgres.start()
        assert_whole(service, scan_id)
