"""Fault 20: a webhook to every spelling of loopback, link-local, a redirect, a name whose address changes.

Each case names its guard; with the guard taken out the case fails (shown once for each). Messages are verified with
the library of Standard Webhooks, as a receiver would.
"""

import asyncio
import json
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from scanjobs.account_tables import WebhookAttempt, WebhookDelivery, WebhookEndpoint
from scanjobs.artifacts import ArtifactStore
from scanjobs.control import cancel_scan
from scanjobs.settings import Settings
from scanjobs.store import Store, open_store
from scanjobs.webhooks import DAY_S, LONGEST_PAUSE_S, claim_due, pause_s, record
from scanjobs.webhooks import Outcome as Sent
from sqlalchemy import select, update
from standardwebhooks.webhooks import Webhook, WebhookVerificationError
from starlette.testclient import TestClient

from services.api.app import create_app
from services.api.deliveries import ANSWER_BYTES, Deliveries
from tests.conftest import copy_database
from tests.faults.private_addresses import PRIVATE
from tests.integration.toy_service import toy_spec


@dataclass
class Receiver:
    """Somebody who listens on this machine."""

    port: int = 0
    heard: list[tuple[dict[str, str], bytes]] = field(default_factory=list)
    status: int = 204
    headers: dict[str, str] = field(default_factory=dict)
    body: Callable[[Any], None] | None = None


@pytest.fixture
def receiver() -> Iterator[Receiver]:
    state = Receiver()

    class Handler(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            body = self.rfile.read(int(self.headers.get("Content-Length") or 0))
            state.heard.append(({key.lower(): value for key, value in self.headers.items()}, body))
            self.send_response(state.status)
            for key, value in state.headers.items():
                self.send_header(key, value)
            self.end_headers()
            if state.body is not None:
                state.body(self.wfile)

        def log_message(self, *_: Any) -> None:
            pass

    http = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    http.daemon_threads = True
    thread = threading.Thread(target=http.serve_forever, args=(0.01,))
    thread.start()
    state.port = http.server_address[1]
    yield state
    http.shutdown()
    thread.join()
    http.server_close()


@dataclass
class Post:
    """A service whose deliveries are sent by hand."""

    http: TestClient
    store: Store
    settings: Settings

    def endpoint(self, url: str, **values: Any) -> dict[str, Any]:
        answer = self.http.post("/v1/webhooks", json={"url": url} | values)
        assert answer.status_code == 201, answer.text
        made: dict[str, Any] = answer.json()
        return made

    def send(self, resolve: Callable[[str, int], Sequence[str]] | None = None) -> None:
        """Send what is due."""
        sender = Deliveries(self.store, self.settings, **({"resolve": resolve} if resolve else {}))  # type: ignore[arg-type]
        asyncio.run(sender.send_due())

    def due(self) -> None:
        """Let the pause be over."""
        self.store.write(lambda session: session.execute(update(WebhookDelivery).values(next_at=0.0)))

    def log(self, made: dict[str, Any]) -> list[dict[str, Any]]:
        where = f"/v1/webhooks/{made['id']}/deliveries"
        [one] = self.http.get(where).json()["items"]
        found: list[dict[str, Any]] = self.http.get(f"{where}/{one['id']}").json()["log"]
        return found


@pytest.fixture
def post(tmp_path: Path, migrated_sqlite: Path) -> Iterator[Post]:
    settings = Settings(data_folder=tmp_path / "data", webhooks_to_private_addresses=True)
    copy_database(migrated_sqlite, settings.data_folder)
    store = open_store(settings.database)
    app = create_app(settings, store, ArtifactStore(settings.artifacts))
    yield Post(TestClient(app), store, settings)  # not entered: nothing is sent but by hand
    store.close()


def closed(post: Post) -> Post:
    """The same service with private addresses refused."""
    settings = post.settings.model_copy(update={"webhooks_to_private_addresses": False})
    app = create_app(settings, post.store, ArtifactStore(settings.artifacts))
    return Post(TestClient(app), post.store, settings)


@pytest.mark.parametrize("url", PRIVATE, ids=lambda url: url[:40])
def test_no_spelling_leads_inside(post: Post, url: str) -> None:
    """Guard: `is_public` of every address.

    Seen to fail: with no address judged every spelling that resolves is taken; without `_inside` and `is_multicast`
    6to4 and multicast are; without `TRANSLATED` three ways to write IPv4 as IPv6 are.
    """
    answer = closed(post).http.post("/v1/webhooks", json={"url": url})
    assert (answer.status_code, answer.json()["pointer"]) == (422, "/url")
    assert answer.json()["code"] in ("ADDRESS_REFUSED", "INVALID_BODY")
    assert post.http.get("/v1/webhooks").json()["items"] == []


def test_a_name_whose_address_changes_is_judged_again_before_every_attempt(post: Post, receiver: Receiver) -> None:
    """The name was public when the webhook was made. Guard: `judge` in `Deliveries.attempt`.

    Seen to fail: with private addresses allowed there the message arrives.
    """
    made = post.endpoint(f"http://127.0.0.1:{receiver.port}/")
    post.http.post(f"/v1/webhooks/{made['id']}/test")
    closed(post).send(lambda *_: ["127.0.0.1"])
    assert receiver.heard == []
    [attempt] = post.log(made)
    assert (attempt["status"], "not public" in attempt["error"]) == (None, True)


def test_the_connection_goes_to_the_address_that_was_judged(post: Post, receiver: Receiver) -> None:
    """A name that nobody could resolve is reached where the judge saw it, and is asked for. Guard: `Target.url`.

    Seen to fail: with the name in it nothing arrives.
    """
    made = post.endpoint(f"http://127.0.0.1:{receiver.port}/hook?a=1")
    post.http.patch(f"/v1/webhooks/{made['id']}", json={"url": f"http://127.0.0.1:{receiver.port}/hook?a=1"})
    post.store.write(
        lambda session: session.execute(
            update(WebhookEndpoint).values(url=f"http://judged.invalid:{receiver.port}/hook?a=1")
        )
    )
    post.http.post(f"/v1/webhooks/{made['id']}/test")
    asked: list[str] = []

    def once(host: str, _: int) -> Sequence[str]:
        asked.append(host)
        return ["127.0.0.1"]

    post.send(once)
    assert asked == ["judged.invalid"]
    [(headers, _)] = receiver.heard
    assert headers["host"] == f"judged.invalid:{receiver.port}"


def test_a_redirect_is_not_followed(post: Post, receiver: Receiver) -> None:
    """Guard: follow_redirects=False. Seen to fail: with True it is followed twenty times."""
    receiver.status, receiver.headers = 307, {"Location": f"http://127.0.0.1:{receiver.port}/inside"}
    made = post.endpoint(f"http://127.0.0.1:{receiver.port}/")
    post.http.post(f"/v1/webhooks/{made['id']}/test")
    post.send()
    assert len(receiver.heard) == 1
    assert [attempt["status"] for attempt in post.log(made)] == [307]


def test_a_proxy_of_the_environment_is_not_asked(
    post: Post, receiver: Receiver, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A proxy would resolve the name again. Guard: trust_env=False. Seen to fail: with True nothing arrives."""
    monkeypatch.setenv("HTTP_PROXY", "http://127.0.0.1:9")
    made = post.endpoint(f"http://127.0.0.1:{receiver.port}/")
    post.http.post(f"/v1/webhooks/{made['id']}/test")
    post.send()
    assert len(receiver.heard) == 1


def test_an_answer_without_end_is_not_waited_for(
    post: Post, receiver: Receiver, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Guard: PATIENCE_S.

    Seen to fail: without the timeout the sender listens for the ten seconds that the answer drips.
    """
    monkeypatch.setattr("services.api.deliveries.PATIENCE_S", 1.0)

    def drip(wfile: Any) -> None:
        with suppress(BrokenPipeError):
            for _ in range(100):
                wfile.write(b"x")
                time.sleep(0.1)

    receiver.status, receiver.body = 200, drip
    made = post.endpoint(f"http://127.0.0.1:{receiver.port}/")
    post.http.post(f"/v1/webhooks/{made['id']}/test")
    began = time.monotonic()
    post.send()
    assert time.monotonic() - began < 5
    [attempt] = post.log(made)
    assert attempt["error"] is not None


def test_an_answer_that_floods_is_read_as_far_as_the_log_keeps_it(post: Post, receiver: Receiver) -> None:
    """Guard: ANSWER_BYTES in `_beginning`.

    Seen to fail: read to its end, the answer takes longer than the patience lasts.
    """

    def flood(wfile: Any) -> None:
        with suppress(ConnectionError):
            for _ in range(20_000):
                wfile.write(b"x" * 100_000)

    receiver.status, receiver.body = 200, flood
    made = post.endpoint(f"http://127.0.0.1:{receiver.port}/")
    post.http.post(f"/v1/webhooks/{made['id']}/test")
    post.send()
    [attempt] = post.log(made)
    assert (attempt["status"], set(attempt["answer"])) == (200, {"x"})
    assert len(attempt["answer"]) <= ANSWER_BYTES


def test_a_message_is_signed_and_tells_what_happened(post: Post, receiver: Receiver) -> None:
    """Seen to fail: with another body signed than the one that is sent."""
    made = post.endpoint(f"http://127.0.0.1:{receiver.port}/hook", types=["scan.canceled"])
    scan = post.http.post("/v1/scans", json=toy_spec(frames=1).model_dump(mode="json")).json()["id"]
    post.store.write(lambda session: cancel_scan(session, scan))
    post.send()
    [(headers, body)] = receiver.heard
    message = Webhook(made["secret"]).verify(body, headers)
    assert (message["type"], message["data"]["scan"]) == ("scan.canceled", scan)
    with pytest.raises(WebhookVerificationError):
        Webhook(made["secret"]).verify(body.replace(b"canceled", b"succeeded"), headers)
    with pytest.raises(WebhookVerificationError):
        Webhook("whsec_" + "A" * 43 + "=").verify(body, headers)


def test_a_rotated_secret_signs_beside_the_new_one_for_a_while(post: Post, receiver: Receiver) -> None:
    """Guard: `_claimed` gives the old secret until its time.

    Seen to fail: given never, its signature is missing; given always, it signs when the time is over.
    """
    made = post.endpoint(f"http://127.0.0.1:{receiver.port}/hook")
    new = post.http.post(f"/v1/webhooks/{made['id']}/rotate-secret", json={}).json()
    post.http.post(f"/v1/webhooks/{made['id']}/test")
    post.send()
    [(headers, body)] = receiver.heard
    for secret in (made["secret"], new["secret"]):
        assert Webhook(secret).verify(body, headers)["type"] == "webhook.test"
    last = post.http.post(f"/v1/webhooks/{made['id']}/rotate-secret", json={"grace_s": 0}).json()
    post.http.post(f"/v1/webhooks/{made['id']}/test")
    post.send()
    headers, body = receiver.heard[1]
    assert Webhook(last["secret"]).verify(body, headers)
    with pytest.raises(WebhookVerificationError):
        Webhook(new["secret"]).verify(body, headers)


def test_what_was_rolled_back_is_not_told(post: Post, receiver: Receiver) -> None:
    """The outbox is written in the transaction that moves the scan, and what happened is told.

    Guard: `announce_scan` in `move_scan`. Seen to fail: without it nothing is written.
    """
    made = post.endpoint(f"http://127.0.0.1:{receiver.port}/hook")
    scan = post.http.post("/v1/scans", json=toy_spec(frames=1).model_dump(mode="json")).json()["id"]

    def fail(session: Any) -> None:
        cancel_scan(session, scan)
        raise RuntimeError("after the message was written")

    with pytest.raises(RuntimeError):
        post.store.write(fail)
    deliveries = f"/v1/webhooks/{made['id']}/deliveries"
    assert post.http.get(deliveries).json()["items"] == []
    post.store.write(lambda session: cancel_scan(session, scan))
    assert [row["type"] for row in post.http.get(deliveries).json()["items"]] == ["scan.canceled"]


def test_a_failed_delivery_is_tried_again_with_one_id_until_it_arrives(post: Post, receiver: Receiver) -> None:
    """Guards: the pause, and the state that `claim_due` and `_take` look for.

    Seen to fail: with no pause it is sent at every look; with delivered ones taken too, again after it has arrived.
    """
    receiver.status = 500
    made = post.endpoint(f"http://127.0.0.1:{receiver.port}/hook")
    post.http.post(f"/v1/webhooks/{made['id']}/test")
    for _ in range(3):
        post.send()
        post.send()  # not due yet
        post.due()
    receiver.status = 200
    post.send()
    post.due()
    post.send()
    assert len({headers["webhook-id"] for headers, _ in receiver.heard}) == 1
    assert len({body for _, body in receiver.heard}) == 1
    assert [attempt["status"] for attempt in post.log(made)] == [500, 500, 500, 200]


def test_it_is_given_up_after_a_day_and_can_be_replayed(post: Post, receiver: Receiver) -> None:
    """Guard: `give_up_at` in `record`. Seen to fail: without it the message waits for ever."""
    receiver.status = 500
    made = post.endpoint(f"http://127.0.0.1:{receiver.port}/hook")
    one = post.http.post(f"/v1/webhooks/{made['id']}/test").json()
    post.store.write(lambda session: session.execute(update(WebhookDelivery).values(give_up_at=1.0)))
    post.send()
    where = f"/v1/webhooks/{made['id']}/deliveries/{one['id']}"
    assert post.http.get(where).json()["state"] == "given_up"
    receiver.status = 200
    assert post.http.post(f"{where}/replay").status_code == 202
    post.send()
    after = post.http.get(where).json()
    assert (after["state"], [attempt["number"] for attempt in after["log"]]) == ("delivered", [1, 2])
    assert len({headers["webhook-id"] for headers, _ in receiver.heard}) == 1


def test_an_endpoint_that_is_gone_is_told_no_more(post: Post, receiver: Receiver) -> None:
    """Guard: 410 in `record`. Seen to fail: with another status the endpoint stays enabled."""
    receiver.status = 410
    made = post.endpoint(f"http://127.0.0.1:{receiver.port}/hook")
    post.http.post(f"/v1/webhooks/{made['id']}/test")
    post.send()
    assert post.http.get(f"/v1/webhooks/{made['id']}").json()["enabled"] is False


def test_a_lost_claim_writes_nothing(post: Post, receiver: Receiver) -> None:
    """Guard: the token in `record`.

    Seen to fail: without it the frozen claimer writes the same attempt again, which the database refuses.
    """
    made = post.endpoint(f"http://127.0.0.1:{receiver.port}/hook")
    post.http.post(f"/v1/webhooks/{made['id']}/test")
    [slow] = post.store.write(claim_due)
    assert post.store.write(claim_due) == ()
    post.due()  # the claimer froze for longer than it may
    [fast] = post.store.write(claim_due)
    assert post.store.write(lambda session: record(session, fast, Sent(took_s=0.1, status=200)))
    assert not post.store.write(lambda session: record(session, slow, Sent(took_s=9.0, error="late")))
    with post.store.read() as session:
        assert [row.status for row in session.scalars(select(WebhookAttempt))] == [200]


def test_one_endpoint_that_hangs_holds_up_no_other(post: Post, receiver: Receiver) -> None:
    """Guard: AT_ONCE in `claim_due`. Seen to fail: without it the first twenty are all the slow one's."""
    slow = post.endpoint(f"http://127.0.0.1:{receiver.port}/slow")
    fast = post.endpoint(f"http://127.0.0.1:{receiver.port}/fast")
    for made in [slow] * 30 + [fast]:
        post.http.post(f"/v1/webhooks/{made['id']}/test")
    assert fast["url"] in {claimed.url for claimed in post.store.write(claim_due)}


def test_pauses_double_to_two_hours_and_fill_a_day() -> None:
    """Guard: LONGEST_PAUSE_S. Seen to fail: with a longer one pauses go on doubling."""
    pauses = [pause_s(number, chance=0.5) for number in range(1, 40)]
    assert pauses[0] == 5.0
    assert all(later == min(2 * before, LONGEST_PAUSE_S) for before, later in pairwise(pauses))
    tries = 0
    while sum(pauses[:tries]) < DAY_S:
        tries += 1
    assert 15 < tries < 30
    assert pause_s(1, asked_s=600.0) == 600.0
    assert pause_s(1, asked_s=1e9) == LONGEST_PAUSE_S


def test_the_secret_is_shown_once(post: Post, receiver: Receiver) -> None:
    made = post.endpoint(f"http://127.0.0.1:{receiver.port}/hook")
    shown = post.http.get(f"/v1/webhooks/{made['id']}").text + post.http.get("/v1/webhooks").text
    assert made["secret"] not in shown
    assert "secret" not in json.loads(post.http.get(f"/v1/webhooks/{made['id']}").text)


def test_the_running_service_sends_by_itself(post: Post, receiver: Receiver) -> None:
    """Guard: the task in `create_app`. Seen to fail: without it nothing is sent."""
    with TestClient(create_app(post.settings, post.store, ArtifactStore(post.settings.artifacts))):
        made = post.endpoint(f"http://127.0.0.1:{receiver.port}/hook")
        post.http.post(f"/v1/webhooks/{made['id']}/test")
        deadline = time.monotonic() + 20
        while not receiver.heard and time.monotonic() < deadline:
            time.sleep(0.05)
    assert len(receiver.heard) == 1
