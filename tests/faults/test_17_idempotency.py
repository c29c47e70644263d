"""Fault 17: one Idempotency-Key twenty times in parallel, then with another body."""

import threading
from concurrent.futures import ThreadPoolExecutor

import httpx
from scanjobs.settings import Settings

from tests.faults.redis_faults import api, body
from tests.integration.toy_service import looking_at

HEADERS = {"Idempotency-Key": "the-same"}


def test_one_key_makes_one_scan_however_often_it_is_sent(settings: Settings) -> None:
    """Guard: the key's row is unique, and who finds it taken answers with its scan (`insert_scan`, `_store`).

    Seen to fail: with `_earlier_submission` always None and no row remembered, twenty scans are made.
    """
    together = threading.Barrier(20)
    with looking_at(settings) as service, api(settings) as client:

        def post(_: int) -> httpx.Response:
            together.wait()
            return client.post("/v1/scans", json=body(0), headers=HEADERS)

        with ThreadPoolExecutor(20) as pool:
            answers = list(pool.map(post, range(20)))
        assert {answer.status_code for answer in answers} == {202}
        assert len({answer.json()["id"] for answer in answers}) == 1
        other = client.post("/v1/scans", json=body(1), headers=HEADERS)
        assert (other.status_code, other.json()["code"]) == (409, "IDEMPOTENCY_CONFLICT")
        assert len(client.get("/v1/scans").json()["items"]) == 1
        assert service.violations() == ()
