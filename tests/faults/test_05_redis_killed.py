"""Fault 5: Redis is killed and comes back empty, after longer than a worker is quiet about it (`ticker.QUIET_S`)."""

import time

from scanjobs.settings import Settings

from tests.faults.redis_faults import api, body
from tests.faults.steps import assert_whole, seconds_since, wait_for
from tests.integration.toy_service import looking_at, toy_spec, worker_process
from tests.stack.servers import Redis

AWAY_S = 7.0


def test_redis_killed_and_restarted_empty_is_only_delay(served: Settings, redis: Redis) -> None:
    """Promises (a) and (g): POST answers at once all the while, and what was posted runs afterwards.

    Guards: the API never publishes (the `ready` row is the outbox); messages that were lost are sent again.
    Seen to fail: with a publish in `submit` the POST fails because the connection is refused; with `unclaimed_steps`
    returning nothing the scans never end.
    """
    with looking_at(served) as service, worker_process(served), api(served) as client:
        scan_id = service.submit(toy_spec(frames=6))
        wait_for(service, scan_id, 3)
        redis.stop()
        stopped_at, posted = time.monotonic(), []
        while seconds_since(stopped_at) < AWAY_S:
            began = time.monotonic()
            answer = client.post("/v1/scans", json=body(len(posted)))
            assert answer.status_code == 202, answer.text
            assert seconds_since(began) < 1.0
            posted.append(answer.json()["id"])
            time.sleep(2.0)
        redis.start()
        for one in (scan_id, *posted):
            assert_whole(service, one)
