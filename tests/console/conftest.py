"""A browser for a file of tests, a page for a test; what the page complains of fails the test."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, sync_playwright

from services.api.app import create_app
from tests.console.browsing import CHROMIUM, SOFTWARE
from tests.console.site import finished_scan, open_service
from tests.unit.api.live import live
from tests.unit.api.service import Service

PATIENCE_MS = 15_000


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    """Per module: while Playwright runs, its event loop is in the way of tests that start one of their own."""
    if CHROMIUM is None:
        pytest.skip("no Chromium here: apt-get install chromium")
    with sync_playwright() as playwright:
        found = playwright.chromium.launch(executable_path=CHROMIUM, args=SOFTWARE)
        yield found
        found.close()


@pytest.fixture
def page(browser: Browser) -> Iterator[Page]:
    """A page of its own session; an exception in it, or a breach of the policy, fails the test."""
    context = browser.new_context(viewport={"width": 1280, "height": 900}, locale="en-GB", timezone_id="UTC")
    context.set_default_timeout(PATIENCE_MS)
    found = context.new_page()
    wrong: list[str] = []
    found.on("pageerror", lambda error: wrong.append(str(error)))
    found.on("console", lambda said: wrong.append(said.text) if is_wrong(said.text) else None)
    yield found
    context.close()
    assert wrong == []


def is_wrong(said: str) -> bool:
    """Whether the browser's console tells of a broken rule; refusals of the API are what pages are made for."""
    return "Content Security Policy" in said or "SyntaxError" in said or "Uncaught" in said


@pytest.fixture
def service(tmp_path: Path, migrated_sqlite: Path) -> Iterator[Service]:
    """A service of the test's own."""
    found = open_service(tmp_path, migrated_sqlite)
    yield found
    found.store.close()


@pytest.fixture
def address(service: Service) -> Iterator[str]:
    """Where its page is."""
    with live(create_app(service.settings, service.store, service.artifacts)) as found:
        yield found


@pytest.fixture(scope="module")
def gallery(tmp_path_factory: pytest.TempPathFactory, migrated_sqlite: Path) -> Iterator[tuple[str, str]]:
    """Address of a service with one finished scan, and that scan's id; tests only look at it."""
    service = open_service(tmp_path_factory.mktemp("gallery"), migrated_sqlite)
    scan = finished_scan(service)
    with live(create_app(service.settings, service.store, service.artifacts)) as found:
        yield found, scan
    service.store.close()
