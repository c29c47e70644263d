"""Submitting, looking, listing, cancelling and retrying, over HTTP and a real database."""

import threading
import time
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime

import pytest
from scanjobs.repository import list_events
from scanjobs.tables import Scan
from sqlalchemy import event
from sqlalchemy.exc import OperationalError

from tests.unit.api.service import Service, simulation


def test_a_submitted_scan_is_named_planned_and_found_again(service: Service) -> None:
    answer = service.http.post("/v1/scans", json=simulation(tags=["b", "a"], plant={"id": "P-7"}))
    body = answer.json()
    assert answer.status_code == 202
    assert answer.headers["Location"] == f"/v1/scans/{body['id']}"
    assert int(answer.headers["Retry-After"]) > 0
    assert (body["status"], body["plant"], body["tags"], body["eta_s"]) == ("queued", "P-7", ["a", "b"], None)
    totals = {row["step"]: row["total"] for row in body["progress"]}
    assert totals == {"frame.render": 3, "frame.train": 4, "frame.extract": 3, "scan.identify": 1}
    assert service.http.get(answer.headers["Location"]).json() == body


def test_times_are_utc_and_now(service: Service) -> None:
    created = datetime.fromisoformat(service.submit()["created_at"])
    assert created.tzinfo is not None
    assert abs((datetime.now(UTC) - created).total_seconds()) < 10


def test_the_specification_comes_back_with_its_defaults(service: Service) -> None:
    assert service.submit()["spec"]["reconstruction"]["iterations"] == 600


def test_the_same_key_and_body_are_one_scan(service: Service) -> None:
    headers = {"Idempotency-Key": "k-1"}
    with ThreadPoolExecutor(8) as pool:
        answers = list(
            pool.map(lambda _: service.http.post("/v1/scans", json=simulation(), headers=headers), range(20))
        )
    assert {answer.status_code for answer in answers} == {202}
    assert len({answer.json()["id"] for answer in answers}) == 1
    assert service.rows() == 1


def test_the_same_key_with_another_body_is_a_conflict(service: Service) -> None:
    service.submit(**{"Idempotency-Key": "k-1"})
    answer = service.http.post("/v1/scans", json=simulation(seed=1), headers={"Idempotency-Key": "k-1"})
    assert (answer.status_code, answer.json()["code"]) == (409, "IDEMPOTENCY_CONFLICT")
    assert service.rows() == 1


def test_a_body_that_says_the_same_in_other_words_is_the_same(service: Service) -> None:
    first = service.submit(simulation(), **{"Idempotency-Key": "k"})
    assert service.submit(simulation(seed=0, organs=[]), **{"Idempotency-Key": "k"})["id"] == first["id"]


def test_without_a_key_each_request_is_a_scan(service: Service) -> None:
    assert service.submit()["id"] != service.submit()["id"]


def test_a_commit_that_fails_is_never_answered_with_success(service: Service) -> None:
    def refuse(_: object) -> None:
        raise OperationalError("COMMIT", {}, Exception("disk I/O error"))

    event.listen(service.store.engine, "commit", refuse)
    answer = service.http.post("/v1/scans", json=simulation())
    event.remove(service.store.engine, "commit", refuse)
    assert (answer.status_code, answer.json()["code"]) == (503, "DATABASE_UNAVAILABLE")
    assert "disk" not in answer.text
    assert service.rows() == 0


def test_the_answer_waits_for_the_commit(service: Service) -> None:
    """A slow commit: the client must not have its 202 while the row is not there."""
    committing, go_on = threading.Event(), threading.Event()

    def wait(_: object) -> None:
        committing.set()
        assert go_on.wait(10)

    event.listen(service.store.engine, "commit", wait)
    with ThreadPoolExecutor(1) as pool:
        pending = pool.submit(lambda: service.http.post("/v1/scans", json=simulation()))
        assert committing.wait(10)
        time.sleep(0.1)
        assert not pending.done()
        go_on.set()
        assert pending.result(10).status_code == 202
    event.remove(service.store.engine, "commit", wait)
    assert service.rows() == 1


def test_listing_walks_every_scan_once_newest_first(service: Service) -> None:
    made = [service.submit()["id"] for _ in range(7)]
    seen: list[str] = []
    cursor: str | None = None
    while True:
        params = {"limit": "3"} | ({"cursor": cursor} if cursor else {})
        page = service.http.get("/v1/scans", params=params).json()
        seen += [scan["id"] for scan in page["items"]]
        cursor = page["next_cursor"]
        if cursor is None:
            break
    assert seen == made[::-1]


def test_a_scan_made_during_the_walk_does_not_disturb_it(service: Service) -> None:
    made = [service.submit()["id"] for _ in range(4)]
    first = service.http.get("/v1/scans", params={"limit": 2}).json()
    service.submit()
    second = service.http.get("/v1/scans", params={"limit": 2, "cursor": first["next_cursor"]}).json()
    assert [scan["id"] for scan in first["items"] + second["items"]] == made[::-1]


def test_filters_are_joined_by_and_and_several_states_by_or(service: Service) -> None:
    red = service.submit(simulation(tags=["red"], plant={"id": "p1"}))["id"]
    both = service.submit(simulation(tags=["red", "dry"], plant={"id": "p2"}))["id"]
    dry = service.submit(simulation(tags=["dry"], plant={"id": "p2"}))["id"]
    service.move(dry, state="failed")
    service.move(both, state="canceling")

    def found(query: str) -> set[str]:
        return {scan["id"] for scan in service.http.get(f"/v1/scans?{query}").json()["items"]}

    assert found("tag=red") == {red, both}
    assert found("tag=dry&plant=p2") == {both, dry}
    assert found("status=failed") == {dry}
    assert found("status=running") == {both}
    assert found("status=failed&status=queued") == {dry, red}
    assert found("tag=none") == set()


@pytest.mark.parametrize(
    "query", ["status=done", "limit=0", "limit=201", "limit=x", "tag=a%00b", "plant=", "cursor=!!"]
)
def test_a_bad_filter_names_itself(service: Service, query: str) -> None:
    answer = service.http.get(f"/v1/scans?{query}")
    assert answer.status_code == 422
    assert answer.json()["code"] in ("INVALID_PARAMETER", "INVALID_CURSOR")
    assert query.split("=")[0] in answer.json()["detail"]


def test_progress_counts_what_ran_and_foresees_the_end(service: Service) -> None:
    scan = service.submit()["id"]
    with service.store.read() as session:
        now = session.query(Scan).one().created_at
    for frame in (0, 1):
        service.move_step(
            scan,
            "frame.render",
            frame,
            state="succeeded",
            started_at=now - 20 + 10 * frame,
            finished_at=now - 10 + 10 * frame,
        )
    service.move_step(scan, "frame.render", 2, state="running", started_at=now, progress_done=1, progress_total=2)
    service.move(scan, state="running", started_at=now - 20)
    body = service.http.get(f"/v1/scans/{scan}").json()
    render = body["progress"][0]
    assert (render["done"], render["running"], render["total"], render["fraction"]) == (2, 1, 3, 0.8333)
    # 10 s a step, one at a time: half a render and eight steps of unknown cost, taken as dear as a render
    assert body["eta_s"] == pytest.approx(85, rel=0.3)


def test_a_failed_scan_says_where_why_and_what_to_do(service: Service) -> None:
    scan = service.submit()["id"]
    error = {"step": "frame.train", "code": "TRAINING_DIVERGED", "message": "m", "hint": "h", "retryable": False}
    service.move(scan, state="failed", error=error)
    body = service.http.get(f"/v1/scans/{scan}").json()
    assert (body["status"], body["error"]) == ("failed", error)


def test_steps_are_listed_with_frame_and_state(service: Service) -> None:
    scan = service.submit()["id"]
    items = service.http.get(f"/v1/scans/{scan}/steps").json()["items"]
    assert len(items) == 11
    assert {item["state"] for item in items if item["step"] == "frame.render"} == {"ready"}
    assert [item["frame"] for item in items if item["step"] == "scan.identify"] == [-1]


def test_cancelling_a_waiting_scan_ends_it_and_twice_is_a_conflict(service: Service) -> None:
    scan = service.submit()["id"]
    answer = service.http.post(f"/v1/scans/{scan}/cancel")
    assert (answer.status_code, answer.json()["status"]) == (202, "canceled")
    again = service.http.post(f"/v1/scans/{scan}/cancel")
    assert (again.status_code, again.json()["code"]) == (409, "ILLEGAL_TRANSITION")
    with service.store.read() as session:
        moves = [row.to_state for row in list_events(session, session.query(Scan).one()) if row.step_id is None]
    assert moves == ["queued", "canceling", "canceled"]


def test_retry_makes_the_next_generation_and_needs_an_end(service: Service) -> None:
    scan = service.submit()["id"]
    early = service.http.post(f"/v1/scans/{scan}/retry")
    assert (early.status_code, early.json()["code"]) == (409, "ILLEGAL_TRANSITION")
    service.http.post(f"/v1/scans/{scan}/cancel")
    answer = service.http.post(f"/v1/scans/{scan}/retry", params={"from": "frame.train"})
    assert (answer.status_code, answer.json()["status"], answer.json()["generation"]) == (202, "queued", 1)


def test_retry_from_no_step_is_refused(service: Service) -> None:
    scan = service.submit()["id"]
    answer = service.http.post(f"/v1/scans/{scan}/retry", params={"from": "frame.bake"})
    assert (answer.status_code, answer.json()["code"]) == (422, "INVALID_PARAMETER")
    assert "frame.train" in answer.json()["hint"]


@pytest.mark.parametrize("scan", ["x", "0190c0de-0000-7000-8000-000000000000", "%00", "..%2f..", "a" * 5000])
@pytest.mark.parametrize("tail", ["", "/steps", "/modes", "/modes/0/shape", "/artifacts", "/artifacts/modes.json"])
def test_no_such_scan_is_404_everywhere(service: Service, scan: str, tail: str) -> None:
    answer = service.http.get(f"/v1/scans/{scan}{tail}")
    assert (answer.status_code, answer.json()["code"]) == (404, "NOT_FOUND")
