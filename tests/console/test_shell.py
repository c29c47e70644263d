"""The shell: every page opens, by key alone too; a key where one is needed; light, dark and a phone."""

from collections.abc import Iterator

import pytest
from playwright.sync_api import Page, expect

from services.api.app import create_app
from tests.console.site import finished_scan
from tests.unit.api.live import live
from tests.unit.api.service import Service

PAGES = {
    "plants": "Plants",
    "scans": "Scans",
    "alarms": "Alarms",
    "new": "New scan",
    "schedules": "Schedules",
    "webhooks": "Webhooks",
    "admin": "Service",
}


@pytest.mark.parametrize("name", PAGES)
def test_every_page_opens_from_the_navigation(page: Page, gallery: tuple[str, str], name: str):
    page.goto(f"{gallery[0]}/#/scans")
    page.get_by_role("navigation", name="Pages").get_by_role("link", name=PAGES[name], exact=True).click()
    expect(page.get_by_role("heading", level=1)).to_have_text(PAGES[name])
    expect(page.locator("nav [aria-current=page]").first).to_have_text(PAGES[name])
    expect(page.get_by_role("alert")).to_have_count(0)


def test_an_unknown_page_says_so(page: Page, gallery: tuple[str, str]):
    page.goto(f"{gallery[0]}/#/nowhere")
    expect(page.get_by_role("heading", level=1)).to_have_text("There is no such page")


def test_the_keyboard_alone_reaches_the_content_and_opens_a_scan(page: Page, gallery: tuple[str, str]):
    page.goto(f"{gallery[0]}/#/scans")
    expect(page.get_by_role("link", name="small")).to_be_visible()
    page.keyboard.press("Tab")
    expect(page.get_by_role("link", name="Skip to content")).to_be_focused()
    page.keyboard.press("Enter")
    expect(page.locator("main")).to_be_focused()
    for _ in range(12):
        page.keyboard.press("Tab")
        if page.evaluate("document.activeElement.textContent") == "small":
            break
    page.keyboard.press("Enter")
    expect(page.get_by_role("heading", level=1)).to_have_text("small")


def test_colours_follow_the_system_until_somebody_chooses(page: Page, gallery: tuple[str, str]):
    background = "getComputedStyle(document.body).backgroundColor"
    page.emulate_media(color_scheme="dark")
    page.goto(gallery[0])
    dark = page.evaluate(background)
    page.get_by_role("button", name="Colours: auto").click()
    light = page.evaluate(background)
    assert light != dark
    page.reload()
    assert page.evaluate(background) == light


@pytest.mark.parametrize("name", ["scans", "new", "plants", "webhooks", "schedules", "scan"])
def test_a_phone_needs_no_scrolling_sideways(page: Page, gallery: tuple[str, str], name: str):
    page.set_viewport_size({"width": 375, "height": 740})
    page.goto(f"{gallery[0]}/#/{f'scans/{gallery[1]}' if name == 'scan' else name}")
    expect(page.get_by_role("heading", level=1)).to_be_visible()
    page.wait_for_timeout(600)
    assert page.evaluate("document.documentElement.scrollWidth") <= 375


def test_a_phone_shows_in_its_navigation_where_it_is(page: Page, gallery: tuple[str, str]):
    page.set_viewport_size({"width": 375, "height": 740})
    page.goto(f"{gallery[0]}/#/admin")
    expect(page.locator("nav [aria-current=page]").first).to_be_in_viewport(ratio=1)


def test_everything_that_takes_a_value_has_a_name(page: Page, gallery: tuple[str, str]):
    """What a screen reader would have to call by its kind alone."""
    nameless = """[...document.querySelectorAll('input, select, textarea, button, a, canvas')].filter(one =>
        one.offsetParent && !one.labels?.length && !one.getAttribute('aria-label') && !one.textContent.trim()
        && !one.title)
        .map(one => one.outerHTML.slice(0, 120))"""
    for name in (*PAGES, f"scans/{gallery[1]}/modes", f"scans/{gallery[1]}/cloud"):
        page.goto(f"{gallery[0]}/#/{name}")
        expect(page.get_by_role("heading", level=1)).to_be_visible()
        page.wait_for_timeout(300)
        assert page.evaluate(nameless) == []


@pytest.fixture
def locked(service: Service) -> Iterator[str]:
    """The service as callers elsewhere meet it."""
    finished_scan(service)
    settings = service.settings.model_copy(update={"keyless": False})
    with live(create_app(settings, service.store, service.artifacts)) as found:
        yield found


def test_a_key_is_asked_for_kept_for_the_session_and_never_in_an_address(page: Page, service: Service, locked: str):
    asked: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    page.goto(f"{locked}/#/scans")
    secret = service.key("local")
    page.get_by_label("Key", exact=True).fill("nm_wrong")
    page.get_by_role("button", name="Use this key").click()
    page.get_by_label("Key", exact=True).fill(secret)
    page.get_by_role("button", name="Use this key").click()
    page.get_by_role("link", name="small").click()
    expect(page.get_by_text("live", exact=False).first).to_be_visible()
    page.reload()
    expect(page.get_by_role("heading", level=1)).to_have_text("small")
    with page.expect_download() as saved:
        page.get_by_role("button", name="Shape (.npz)").click()
    assert saved.value.suggested_filename.endswith(".npz")
    assert not any("nm_" in url for url in asked)
    assert page.evaluate("localStorage.length === 0 || !JSON.stringify(localStorage).includes('nm_')")


def test_a_refusal_shows_what_to_do_and_the_id_to_quote(page: Page, gallery: tuple[str, str]):
    page.goto(f"{gallery[0]}/#/scans/00000000-0000-7000-8000-000000000000")
    box = page.get_by_role("alert")
    expect(box).to_contain_text("NOT_FOUND")
    expect(box).to_contain_text("request")
    expect(box.get_by_role("button", name="Try again")).to_be_visible()
