"""Fault 8: a worker is stopped with SIGSTOP for three leases and goes on: it is fenced off."""

import signal
import time

from scanjobs.messages import TRAIN
from scanjobs.plan import WHOLE_SCAN
from scanjobs.settings import Settings
from scanjobs.tables import Attempt
from sqlalchemy import select

from tests.faults.steps import assert_whole, freeze, workers
from tests.integration.toy_service import looking_at, toy_spec, worker_process

LEASE_S = 1.5
STEP_S = 3.5
"""Its runner ends while the worker sleeps, and the second computation still runs when the worker wakes up."""


def test_result_of_a_worker_that_slept_is_dropped(settings: Settings) -> None:
    """Promise (b): the sleeper finds its runner's result when it wakes up, and must not give it in.

    Guard: the token in `leases.standing` and `leases._owned`.
    Seen to fail: without both comparisons of tokens the sleeper ends the second claim's step with its own result.
    """
    quick = settings.model_copy(update={"lease_s": LEASE_S, "slots": 1})
    with looking_at(quick) as service, worker_process(quick) as sleeper:
        scan_id = service.submit(toy_spec(frames=1, trouble=f"{TRAIN}:-1:takes={STEP_S}"))
        service.runner_of(scan_id, TRAIN, WHOLE_SCAN)
        freeze(sleeper, service)
        with workers(quick, 1):
            time.sleep(3 * LEASE_S)
            service.wait(lambda: service.step(scan_id, TRAIN, WHOLE_SCAN).token == 2)
            sleeper.signal(signal.SIGCONT)
            assert_whole(service, scan_id)
        step = service.step(scan_id, TRAIN, WHOLE_SCAN)
        query = select(Attempt.outcome, Attempt.pid).where(Attempt.step_id == step.id).order_by(Attempt.token)
        with service.store.read() as session:
            (first, _), (second, computed_by) = session.execute(query)
        assert (step.token, first, second) == (2, "lease expired", "succeeded")
        assert (step.facts or {})["pid"] == computed_by, "the result is that of the claim that counts"
