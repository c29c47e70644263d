"""A scan that runs, watched: progress and logs as they come, through an API that dies and comes back."""

from collections.abc import Iterator
from functools import partial

import pytest
from playwright.sync_api import Page, expect
from scanjobs.control import cancel_scan
from scanjobs.messages import RENDER
from scanjobs.repository import get_scan
from scanjobs.states import StepState
from scanjobs.tables import Step
from sqlalchemy import update
from sqlalchemy.orm import Session

from tests.console.api_process import Api
from tests.console.site import FINISHED, SUBMITTED, finish
from tests.unit.api.service import Service, simulation


@pytest.fixture
def api(service: Service) -> Iterator[Api]:
    found = Api(service)
    found.start()
    yield found
    found.kill()


def test_a_killed_and_restarted_api_resumes_a_live_page_without_a_reload(page: Page, service: Service, api: Api):
    scan = str(service.submit(simulation(name="growing"))["id"])
    page.goto(f"{api.url}/#/scans/{scan}")
    expect(page.locator(".live").first).to_contain_text("live")
    page.evaluate("window.marked = 'the same page'")
    api.kill()
    expect(page.locator(".live").first).to_contain_text("connection lost")
    service.store.write(partial(_render_all, scan=scan))
    api.start()
    expect(page.locator(".live").first).to_have_text("● live")
    expect(page.locator("[data-step='frame.render']")).to_contain_text("3 / 3")
    assert page.evaluate("window.marked") == "the same page"
    finish_and_tell(service, scan)
    expect(page.locator("h1 + span")).to_contain_text("canceled")


def _render_all(session: Session, scan: str) -> None:
    done = {"state": StepState.SUCCEEDED, "started_at": SUBMITTED, "finished_at": FINISHED}
    session.execute(update(Step).where(Step.scan_id == scan, Step.kind == RENDER).values(done))


def finish_and_tell(service: Service, scan: str) -> None:
    """An event of the scan, as the service itself writes it."""
    service.store.write(lambda session: cancel_scan(session, scan))


def test_progress_comes_by_itself_and_a_finished_scan_shows_its_modes(page: Page, service: Service, address: str):
    scan = str(service.submit(simulation(name="growing"))["id"])
    service.move(scan, state="running")
    page.goto(f"{address}/#/scans/{scan}")
    expect(page.locator(".live").first).to_have_text("● live")
    rendering = page.locator("[data-step='frame.render']")
    expect(rendering).to_contain_text("0 / 3")
    service.move_step(scan, RENDER, 1, state="running", progress_done=1, progress_total=2)
    expect(rendering).to_contain_text("17 %")
    service.move_step(scan, RENDER, 1, state="succeeded", started_at=SUBMITTED, finished_at=FINISHED)
    expect(rendering).to_contain_text("1 / 3")


def test_canceling_asks_first(page: Page, service: Service, address: str):
    scan = str(service.submit(simulation(name="growing"))["id"])
    page.goto(f"{address}/#/scans/{scan}")
    page.get_by_role("button", name="Cancel", exact=True).click()
    dialog = page.get_by_role("dialog")
    dialog.get_by_role("button", name="No, go back").click()
    assert state_of(service, scan) == "queued"
    page.get_by_role("button", name="Cancel", exact=True).click()
    dialog.get_by_role("button", name="Cancel the scan").click()
    expect(page.locator(".state").first).to_contain_text("canceled")
    assert state_of(service, scan) == "canceled"
    page.get_by_role("button", name="Retry what failed").click()
    expect(page.locator(".state").first).to_contain_text("queued")


def test_a_scan_runs_again_from_a_step_and_is_deleted(page: Page, service: Service, address: str):
    scan = str(service.submit(simulation(name="done"))["id"])
    finish(service, scan)
    page.goto(f"{address}/#/scans/{scan}/steps")
    page.get_by_role("button", name="Run again from a step").click()
    page.get_by_role("dialog").get_by_role("combobox").select_option("frame.extract")
    page.get_by_role("dialog").get_by_role("button", name="Run again").click()
    expect(page.get_by_text("run 2 times")).to_be_visible()
    expect(page.locator("[data-step='frame.train']")).to_contain_text("4 / 4")
    expect(page.locator("[data-step='frame.extract']")).to_contain_text("0 / 3")
    finish(service, scan)
    page.reload()
    page.get_by_role("button", name="Delete").click()
    page.get_by_role("button", name="Delete it").click()
    expect(page.get_by_role("heading", level=1)).to_have_text("Scans")
    expect(page.get_by_text("No scans here.")).to_be_visible()


def test_a_failed_scan_says_what_to_do(page: Page, service: Service, address: str):
    scan = str(service.submit(simulation(name="broken"))["id"])
    error = {"step": RENDER, "code": "BLENDER_FAILED", "message": "Blender stopped.", "hint": "Install it again."}
    service.move(scan, state="failed", error={**error, "retryable": True})
    page.goto(f"{address}/#/scans/{scan}")
    alert = page.get_by_role("alert")
    expect(alert).to_contain_text("Blender stopped.")
    expect(alert).to_contain_text("Install it again.")


def test_lists_are_filtered_paged_and_kept_up_to_date(page: Page, service: Service, address: str):
    for number in range(60):
        service.submit(simulation(name=f"scan-{number}", tags=["wind"] if number % 2 else []))
    page.goto(f"{address}/#/scans")
    rows = page.locator("tbody tr")
    expect(rows).to_have_count(50)
    page.get_by_role("button", name="Further").click()
    expect(rows).to_have_count(10)
    page.get_by_role("button", name="Back").click()
    expect(rows).to_have_count(50)
    page.get_by_label("Tag").fill("wind")
    expect(rows).to_have_count(30)
    assert "tag=wind" in page.url
    service.submit(simulation(name="newest", tags=["wind"]))
    expect(page.get_by_role("link", name="newest")).to_be_visible()


def state_of(service: Service, scan: str) -> str:
    with service.store.read() as session:
        return str(get_scan(session, scan).state)


def test_a_scan_is_paused_and_goes_on(page: Page, service: Service, address: str):
    scan = str(service.submit(simulation(name="growing"))["id"])
    service.move(scan, state="running")
    page.goto(f"{address}/#/scans/{scan}")
    page.get_by_role("button", name="Pause").click()
    expect(page.locator(".state").first).to_contain_text("paused")
    assert state_of(service, scan) == "paused"
    page.get_by_role("button", name="Resume").click()
    expect(page.get_by_role("button", name="Pause")).to_be_visible()
    assert state_of(service, scan) != "paused"
