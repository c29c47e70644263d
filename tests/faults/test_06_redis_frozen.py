"""Fault 6: Redis is stopped with SIGSTOP for fifteen seconds: it takes connections and answers nothing."""

import signal
import time

from scanjobs import repository
from scanjobs.messages import TRAIN
from scanjobs.plan import WHOLE_SCAN
from scanjobs.settings import Settings

from tests.faults.redis_faults import api, body, timed
from tests.faults.steps import assert_whole, seconds_since
from tests.integration.toy_service import is_alive, looking_at, toy_spec, worker_process
from tests.stack.servers import Redis

FROZEN_S = 15.0


def test_frozen_redis_holds_up_nothing_but_messages(served: Settings, redis: Redis) -> None:
    """No request takes two seconds; a running step keeps its lease, and is cancelled within five seconds.

    Guards: the API never publishes; the worker's publishing has time limits (`queue._transport_options`).
    Seen to fail: with a publish in `submit` the POST fails after five seconds; without the limits the
    ticker hangs in its first message, and the worker is taken for dead.
    """
    slower = served.model_copy(update={"lease_s": 9.0})
    with looking_at(slower) as service, worker_process(slower), api(slower) as client:
        scan_id = service.submit(toy_spec(frames=1, trouble=f"{TRAIN}:-1:slow"))
        runner = service.runner_of(scan_id, TRAIN, WHOLE_SCAN)
        redis.send(signal.SIGSTOP)
        try:
            frozen_at, posted = time.monotonic(), 0
            while seconds_since(frozen_at) < FROZEN_S - 5:
                assert timed(lambda seed=posted: client.post("/v1/scans", json=body(seed))) < 2.0
                assert timed(lambda: client.get("/v1/scans")) < 2.0
                posted += 1
                time.sleep(2.0)
            assert service.step(scan_id, TRAIN, WHOLE_SCAN).token == 1
            assert timed(lambda: client.post(f"/v1/scans/{scan_id}/cancel")) < 2.0
            assert service.end_of(scan_id, 5).state == "canceled"
            assert not is_alive(runner)
            time.sleep(max(0.0, FROZEN_S - seconds_since(frozen_at)))
            with service.store.read() as session:
                assert len(repository.list_workers(session)) == 1, "its ticker goes on"
        finally:
            redis.send(signal.SIGCONT)
        with service.store.read() as session:
            others = [scan.id for scan in repository.list_scans(session).items if scan.id != scan_id]
        assert len(others) == posted
        for one in others:
            assert_whole(service, one)
