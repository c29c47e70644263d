"""Server-sent events: everything once and in order, resumed after lost connections and restarts, each owner his own."""

import json
import time
from collections.abc import Iterator
from typing import Any

import httpx
import pytest
from scanjobs.account_tables import ApiKey
from scanjobs.control import cancel_scan
from scanjobs.event_log import BEGINNING, Place, last_place, read_events
from sqlalchemy import update

from services.api.app import create_app
from services.api.routes import events
from tests.unit.api.live import live
from tests.unit.api.service import Service, simulation

Message = tuple[str, str, dict[str, Any]]


def messages(answer: httpx.Response) -> Iterator[Message]:
    """Id, type and document of each message of a stream."""
    found: dict[str, str] = {}
    for line in answer.iter_lines():
        if line:
            key, _, value = line.partition(": ")
            found[key] = value
        else:
            yield found.get("id", ""), found["event"], json.loads(found["data"])
            found = {}


def read(address: str, path: str, wanted: int, headers: dict[str, str] | None = None) -> list[Message]:
    """The first so many messages that are no ping."""
    found: list[Message] = []
    with httpx.Client(base_url=address, timeout=10) as http, http.stream("GET", path, headers=headers) as answer:
        assert answer.status_code == 200, answer.read()
        assert answer.headers["Content-Type"].startswith("text/event-stream")
        for message in messages(answer):
            if message[1] not in ("ping", "progress"):
                found.append(message)
            if len(found) == wanted:
                return found
    return found


def happened(service: Service) -> list[str]:
    with service.store.read() as session:
        return [str(one.place) for one in read_events(session, BEGINNING, limit=10_000)]


def test_a_scan_tells_its_whole_story_and_goes_on_where_a_reader_stopped(service: Service) -> None:
    scan = service.submit()["id"]
    service.store.write(lambda session: cancel_scan(session, scan))
    everything = happened(service)
    with live(service.app()) as address:
        path = f"/v1/scans/{scan}/events"
        whole = read(address, path, len(everything))
        assert [message[0] for message in whole] == everything
        assert (whole[0][1], whole[0][2]["to"], whole[-1][2]["to"]) == ("scan", "queued", "canceled")
        for seen in (0, len(everything) // 2):
            rest = read(address, path, len(everything) - seen - 1, {"Last-Event-ID": everything[seen]})
            assert rest == whole[seen + 1 :]
            assert read(address, f"{path}?after={everything[seen]}", len(rest)) == rest


def test_a_scan_tells_from_now_on_alone_who_asks_for_that(service: Service) -> None:
    """A page that has just loaded the scan needs none of its thousand events again."""
    scan = service.submit()["id"]
    known = len(happened(service))
    with live(service.app()) as address:
        path = f"{address}/v1/scans/{scan}/events?after=now"
        with httpx.Client(timeout=10) as http, http.stream("GET", path) as answer:
            told = messages(answer)
            assert next(told)[1] == "ping"
            service.store.write(lambda session: cancel_scan(session, scan))
            first = next(message for message in told if message[1] not in ("ping", "progress"))
    assert first[0] == happened(service)[known]


def test_what_happens_while_somebody_listens_arrives_within_a_second(service: Service) -> None:
    scan = service.submit()["id"]
    with live(service.app()) as address, httpx.Client(base_url=address, timeout=10) as http:
        with http.stream("GET", "/v1/events") as answer:
            lines = messages(answer)
            assert next(lines)[1] == "ping"
            time.sleep(0.2)
            began = time.monotonic()
            http2 = httpx.post(f"{address}/v1/scans/{scan}/cancel")
            assert http2.status_code == 202
            told = [next(lines) for _ in range(2)]
        assert time.monotonic() - began < 3
        assert [(kind, document["to"]) for _, kind, document in told] == [("scan", "canceling"), ("scan", "canceled")]


def test_a_page_goes_on_after_the_service_was_restarted(service: Service) -> None:
    scan = service.submit()["id"]
    path = f"/v1/scans/{scan}/events"
    with live(service.app()) as address:
        before = read(address, path, 1)
    service.store.write(lambda session: cancel_scan(session, scan))
    again = create_app(service.settings, service.store, service.artifacts)
    with live(again) as address:
        after = read(address, path, len(happened(service)) - 1, {"Last-Event-ID": before[0][0]})
    assert [message[0] for message in before + after] == happened(service)


def test_progress_is_told_while_a_scan_runs(service: Service) -> None:
    scan = service.submit()["id"]
    service.move(scan, state="running")
    with live(service.app()) as address, httpx.stream("GET", f"{address}/v1/scans/{scan}/events") as answer:
        document = next(one[2] for one in messages(answer) if one[1] == "progress")
    assert document["scan"] == scan


def test_each_owner_hears_of_his_own(service: Service) -> None:
    theirs = service.submit()["id"]
    headers = {"Authorization": f"Bearer {service.key('b')}"}
    with live(service.app()) as address:
        assert httpx.get(f"{address}/v1/scans/{theirs}/events", headers=headers).status_code == 404
        mine = httpx.post(f"{address}/v1/scans", json=simulation(), headers=headers).json()["id"]
        told = read(address, f"/v1/events?after={BEGINNING}", 1, headers)
        assert {message[2]["scan"] for message in told} == {mine}


def test_a_stream_ends_with_its_key(service: Service, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(events, "SILENCE_S", 0.3)
    headers = {"Authorization": f"Bearer {service.key('b')}"}
    with live(service.app()) as address, httpx.stream("GET", f"{address}/v1/events", headers=headers) as answer:
        lines = messages(answer)
        assert [next(lines)[1] for _ in range(2)] == ["ping", "ping"]
        service.store.write(lambda session: session.execute(update(ApiKey).values(revoked_at=1.0)))
        assert all(kind == "ping" for _, kind, _ in lines)  # and then it ends


@pytest.mark.parametrize("place", ["x", "1", "-1-1", "1-1-1", "1-" + "9" * 40, "０-０"])
def test_a_place_that_is_none_is_refused(service: Service, place: str) -> None:
    answer = service.http.get("/v1/events", params={"after": place})
    assert (answer.status_code, answer.json()["code"]) == (422, "INVALID_CURSOR")


def test_places_are_ordered_and_survive_text(service: Service) -> None:
    service.submit()
    with service.store.read() as session:
        last = last_place(session)
    assert last > BEGINNING
    assert Place.parse(str(last)) == last
