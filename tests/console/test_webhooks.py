"""Who is told what, in the page: an address is added, tested, changed, switched off, and its log read and replayed."""

import json
import threading
from collections.abc import Iterator
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect
from scanjobs.webhooks import MEANING, TEST_TYPE, TOLD
from standardwebhooks.webhooks import Webhook

from services.api.app import create_app
from services.api.console.assets import words
from tests.console.site import open_service
from tests.unit.api.live import live
from tests.unit.api.service import Service


@dataclass
class Receiver:
    """Somebody who listens on this machine, and answers with `status`."""

    url: str
    status: int = 204
    heard: list[tuple[dict[str, str], str]] = field(default_factory=list)

    def told(self) -> list[str]:
        """Kinds of the messages so far."""
        return [json.loads(body)["type"] for _, body in self.heard]


@pytest.fixture
def receiver() -> Iterator[Receiver]:
    state = Receiver("")

    class Handler(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            body = self.rfile.read(int(self.headers["Content-Length"])).decode()
            state.heard.append(({name.lower(): value for name, value in self.headers.items()}, body))
            self.send_response(state.status)
            self.end_headers()
            if state.status != 204:
                self.wfile.write(b"the shed is closed")

        def log_message(self, format: str, *args: object) -> None:  # noqa: A002
            """Nothing to the terminal."""

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    state.url = f"http://127.0.0.1:{server.server_port}/hook"
    yield state
    server.shutdown()
    server.server_close()


@pytest.fixture
def teller(tmp_path: Path, migrated_sqlite: Path) -> Iterator[tuple[str, Service]]:
    """A service that may tell addresses of this machine."""
    service = open_service(tmp_path, migrated_sqlite, webhooks_to_private_addresses=True)
    with live(create_app(service.settings, service.store, service.artifacts)) as found:
        yield found, service
    service.store.close()


@pytest.fixture
def told(page: Page, teller: tuple[str, Service], receiver: Receiver) -> Page:
    """The page of a webhook that is told everything."""
    made = teller[1].http.post("/v1/webhooks", json={"url": receiver.url}).json()
    page.goto(f"{teller[0]}/#/webhooks/{made['id']}")
    expect(page.get_by_role("heading", level=1)).to_have_text(receiver.url)
    return page


def test_an_address_is_added_with_what_it_is_told_and_its_secret_is_shown_once(
    page: Page, teller: tuple[str, Service], receiver: Receiver
):
    page.goto(f"{teller[0]}/#/webhooks")
    expect(page.get_by_text("Nobody is told anything yet.")).to_be_visible()
    page.get_by_text("Tell another address").click()
    page.get_by_label("Address").fill(receiver.url)
    page.get_by_label("What it is for").fill("the drip controller")
    page.get_by_role("checkbox", name="alarm.opened").check()
    page.get_by_role("button", name="Tell this address").click()
    secret = page.get_by_role("dialog").locator("code").text_content() or ""
    page.get_by_role("button", name="I have it").click()
    expect(page.get_by_role("heading", level=1)).to_have_text(receiver.url)
    expect(page.locator("dl")).to_contain_text("alarm.opened")
    page.get_by_role("button", name="Send a test").click()
    row = page.locator("[data-delivery]")
    expect(row).to_contain_text("delivered")
    headers, body = receiver.heard[0]
    assert Webhook(secret).verify(body, headers)["type"] == TEST_TYPE
    page.get_by_role("link", name="All webhooks").click()
    expect(page.locator("table.webhooks tbody tr")).to_contain_text("the drip controller")
    assert secret not in page.content()


def test_a_log_has_every_attempt_and_a_message_is_sent_again_by_keyboard(told: Page, receiver: Receiver):
    receiver.status = 503
    told.get_by_role("button", name="Send a test").click()
    row = told.locator("[data-delivery]")
    expect(row).to_contain_text("waiting")
    opener = row.get_by_role("button", name=TEST_TYPE, exact=True)
    opener.focus()
    told.keyboard.press("Enter")
    expect(opener).to_have_attribute("aria-expanded", "true")
    attempts = told.locator("table.attempts tbody tr")
    expect(attempts.first).to_contain_text("503")
    expect(attempts.first).to_contain_text("the shed is closed")
    expect(attempts.first).to_contain_text(" s")
    receiver.status = 204
    again = row.get_by_role("button", name="Replay")
    again.click()
    expect(row).to_contain_text("delivered")
    expect(attempts.last).to_contain_text("204")
    again.focus()
    told.keyboard.press("Enter")
    expect(attempts).to_have_count(3)
    expect(row).to_contain_text("delivered")
    ids = {headers["webhook-id"] for headers, _ in receiver.heard}
    assert len(ids) == 1


def test_messages_are_filtered_by_what_became_of_them(told: Page, teller: tuple[str, Service], receiver: Receiver):
    scan = str(teller[1].submit()["id"])
    teller[1].http.post(f"/v1/scans/{scan}/cancel")
    told.reload()
    rows = told.locator("[data-delivery]", has_text="scan.canceled")
    expect(rows.first).to_contain_text("delivered")
    expect(rows.first.get_by_role("link")).to_have_attribute("href", f"#/scans/{scan}")
    told.get_by_label("State").select_option("given_up")
    expect(told.get_by_text("No messages here.")).to_be_visible()
    assert "state=given_up" in told.url
    told.get_by_label("State").select_option("delivered")
    expect(rows.first).to_contain_text("delivered")
    assert "scan.canceled" in receiver.told()


def test_a_webhook_is_changed_switched_off_given_a_new_secret_and_deleted(told: Page, receiver: Receiver):
    told.get_by_role("button", name="Change …").click()
    dialog = told.get_by_role("dialog", name="Change this webhook")
    expect(dialog.get_by_label("Address")).to_have_value(receiver.url)
    dialog.get_by_role("checkbox", name="scan.failed").check()
    dialog.get_by_role("button", name="Keep the changes").click()
    expect(told.locator("dl")).to_contain_text("scan.failed")
    told.get_by_role("button", name="New secret …").click()
    told.get_by_role("button", name="Make a new secret").click()
    secret = told.get_by_role("dialog", name="Keep this secret now").locator("code").text_content() or ""
    told.get_by_role("button", name="I have it").click()
    told.get_by_role("button", name="Send a test").click()
    expect(told.locator("[data-delivery]")).to_contain_text("delivered")
    headers, body = receiver.heard[-1]
    assert Webhook(secret).verify(body, headers)["type"] == TEST_TYPE
    told.get_by_role("button", name="Switch off").click()
    expect(told.locator(".head .state")).to_contain_text("off")
    expect(told.get_by_role("button", name="Send a test")).to_be_disabled()
    told.get_by_role("button", name="Switch on").click()
    expect(told.locator(".head .state")).to_contain_text("on")
    told.get_by_role("button", name="Delete …").click()
    told.get_by_role("button", name="Delete it").click()
    expect(told.get_by_text("Nobody is told anything yet.")).to_be_visible()


def test_an_address_that_may_not_be_told_is_refused_with_the_reason(page: Page, address: str):
    page.goto(f"{address}/#/webhooks")
    page.get_by_text("Tell another address").click()
    page.get_by_label("Address").fill("http://127.0.0.1/hook")
    page.get_by_role("button", name="Tell this address").click()
    expect(page.get_by_role("alert")).to_contain_text("127.0.0.1")


def test_every_kind_of_message_is_explained():
    assert words()["messages"] == MEANING
    assert {kind for kind in MEANING if kind.startswith("scan.")} == {f"scan.{state.value}" for state in TOLD}
