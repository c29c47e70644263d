"""The client against a scripted server: what is sent, what is retried, what is raised."""

import json
from datetime import UTC, datetime

import pytest
from scanclient import (
    Client,
    Conflict,
    ConnectionFailed,
    InvalidRequest,
    NotFound,
    Scan,
    ScanFailed,
    TooManyRequests,
    WaitTimedOut,
)
from scanclient.errors import problem
from scanclient.retries import worth_retrying

from tests.unit.scanclient.scripted import Heard, Reply, ScriptedServer, json_reply, scan_body

PROBLEM = {
    "type": "about:blank",
    "title": "Unprocessable Content",
    "status": 422,
    "detail": "Unknown key.",
    "code": "INVALID_SPEC",
    "pointer": "/source/frams",
    "hint": "Did you mean 'frames'?",
    "request_id": "r1",
}


def test_submit_sends_the_spec_and_a_key_and_reads_the_scan(server: ScriptedServer) -> None:
    server.script = lambda _: json_reply(scan_body(), 202)
    with Client(server.address) as client:
        scan = client.submit({"name": "x"}, "key-1")
    [heard] = server.heard
    assert (heard.method, heard.path, heard.headers["Idempotency-Key"]) == ("POST", "/v1/scans", "key-1")
    assert json.loads(heard.body) == {"name": "x"}
    assert scan.status == "queued"
    assert scan.created_at == datetime(2026, 1, 2, 3, 4, 5, tzinfo=UTC)
    assert scan.progress[0].total == 4


def test_a_hung_up_submit_is_sent_again_under_the_same_key(server: ScriptedServer) -> None:
    server.script = lambda _: Reply(hang_up=True) if len(server.heard) < 3 else json_reply(scan_body(), 202)
    with Client(server.address) as client:
        assert client.submit({}).id == "0190"
    assert len({heard.headers["Idempotency-Key"] for heard in server.heard}) == 1
    assert len(server.heard) == 3


def test_a_busy_service_is_asked_again(server: ScriptedServer) -> None:
    server.script = lambda _: json_reply({}, 503) if len(server.heard) < 2 else json_reply(scan_body())
    with Client(server.address) as client:
        assert client.get("0190").id == "0190"


def test_a_retry_whose_answer_was_lost_is_not_sent_twice(server: ScriptedServer) -> None:
    server.script = lambda _: Reply(hang_up=True)
    with Client(server.address) as client, pytest.raises(ConnectionFailed):
        client.retry("0190", "scan.identify")
    assert [heard.path for heard in server.heard] == ["/v1/scans/0190/retry?from=scan.identify"]


def test_a_problem_becomes_a_typed_exception_and_is_not_repeated(server: ScriptedServer) -> None:
    server.script = lambda _: json_reply(PROBLEM, 422)
    with Client(server.address) as client, pytest.raises(InvalidRequest) as caught:
        client.submit({})
    refused = caught.value
    assert (refused.code, refused.pointer, refused.request_id) == ("INVALID_SPEC", "/source/frams", "r1")
    assert str(refused) == "/source/frams: Unknown key. Did you mean 'frames'? [INVALID_SPEC]"
    assert len(server.heard) == 1


@pytest.mark.parametrize(("status", "kind"), [(404, NotFound), (409, Conflict)])
def test_statuses_have_their_exceptions(server: ScriptedServer, status: int, kind: type[Exception]) -> None:
    server.script = lambda _: Reply(status=status, body=b"<html>proxy</html>")
    with Client(server.address) as client, pytest.raises(kind, match=f"HTTP_{status}"):
        client.cancel("0190")


def test_nobody_at_the_address_says_how_to_start_the_service() -> None:
    with Client("http://127.0.0.1:9", attempts=2) as client, pytest.raises(ConnectionFailed, match="nerfmodal up"):
        client.info()


def test_wait_reports_every_look_and_ends_with_the_scan(server: ScriptedServer) -> None:
    states = ["queued", "running", "running", "succeeded"]
    server.script = lambda _: json_reply(scan_body(states[len(server.heard) - 1]))
    seen: list[Scan] = []
    with Client(server.address) as client:
        final = client.wait("0190", on_progress=seen.append, poll_s=0.001)
    assert [scan.status for scan in seen] == states
    assert final.status == "succeeded"


def test_wait_raises_with_the_reason_of_a_failed_scan(server: ScriptedServer) -> None:
    error = {
        "step": "frame.train",
        "code": "TRAINING_DIVERGED",
        "message": "No number.",
        "hint": None,
        "retryable": False,
    }
    server.script = lambda _: json_reply(scan_body("failed", error=error))
    with Client(server.address) as client, pytest.raises(ScanFailed, match=r"frame\.train: No number") as caught:
        client.wait("0190")
    assert caught.value.scan.error is not None
    assert caught.value.scan.error.code == "TRAINING_DIVERGED"


def test_wait_loses_its_patience(server: ScriptedServer) -> None:
    server.script = lambda _: json_reply(scan_body("running"))
    with Client(server.address) as client, pytest.raises(WaitTimedOut):
        client.wait("0190", poll_s=0.01, timeout_s=0.03)


def test_iterate_follows_the_cursor_and_keeps_the_filters(server: ScriptedServer) -> None:
    def page(heard: Heard) -> Reply:
        last = "cursor=next" in heard.path
        return json_reply({"items": [scan_body(id="b" if last else "a")], "next_cursor": None if last else "next"})

    server.script = page
    with Client(server.address) as client:
        assert [scan.id for scan in client.iterate(tag="a b")] == ["a", "b"]
    assert all("tag=a" in heard.path for heard in server.heard)


def test_a_service_that_says_not_so_fast_is_asked_again_later(server: ScriptedServer) -> None:
    refusal = json_reply({"code": "TOO_MANY_REQUESTS", "detail": "Too many."}, 429)
    refusal.headers["Retry-After"] = "1"
    server.script = lambda _: json_reply(scan_body()) if len(server.heard) > 2 else refusal
    with Client(server.address) as client:
        assert client.cancel("s").status == "queued"
    assert len(server.heard) == 3


def test_the_wait_is_as_long_as_the_service_says() -> None:
    error = problem(429, {"code": "TOO_MANY_REQUESTS"}, 7.0)
    assert isinstance(error, TooManyRequests)
    assert worth_retrying(repeatable=False)(error) == 7.0
    assert worth_retrying(repeatable=False)(problem(503, {}, 3.0)) == 3.0
    assert worth_retrying(repeatable=False)(problem(404, {})) is False
