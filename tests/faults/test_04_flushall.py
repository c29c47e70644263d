"""Fault 4: FLUSHALL at the barrier of the first training, and later."""

import redis as redis_client
from scanjobs.settings import Settings

from tests.faults.steps import assert_whole, wait_for
from tests.integration.toy_service import looking_at, toy_spec, worker_process
from tests.stack.servers import Redis


def test_emptied_redis_is_only_delay(served: Settings, redis: Redis) -> None:
    """Promise (g). All renderings have ended and the shared checkpoint is waited for: every message is lost there.

    Guard: `dispatch.unclaimed_steps` sends again what nobody claims.
    Seen to fail: with `unclaimed_steps` returning nothing the flushed steps stay `sent` for ever.
    """
    client = redis_client.Redis.from_url(redis.url)
    with looking_at(served) as service, worker_process(served):
        scan_id = service.submit(toy_spec(frames=6))
        for finished in (6, 9):
            wait_for(service, scan_id, finished)
            for _ in range(5):  # messages are on their way for milliseconds only
                client.flushall()
        assert_whole(service, scan_id)
    client.close()
