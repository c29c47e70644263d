"""Scans that come again, in the page: a schedule is made, changed where it stands, paused, and deleted."""

from typing import Any

import pytest
from playwright.sync_api import Locator, Page, expect

from tests.unit.api.service import Service

SPEC = {"source": {"kind": "clouds", "path": "incoming/{plant}/{date}"}}


@pytest.fixture
def schedule(service: Service) -> dict[str, Any]:
    """Of one plant, every twelve hours."""
    service.http.post("/v1/plants", json={"id": "acai-7"})
    asked = {"plant": "acai-7", "every_hours": 12, "spec": SPEC}
    made: dict[str, Any] = service.http.post("/v1/schedules", json=asked).json()
    return made


def stored(service: Service, schedule: dict[str, Any]) -> dict[str, Any]:
    """The schedule as the service has it now."""
    found: dict[str, Any] = service.http.get(f"/v1/schedules/{schedule['id']}").json()
    return found


def opened(page: Page, address: str) -> Locator:
    """The fields of the only schedule, opened by keyboard."""
    page.goto(f"{address}/#/schedules")
    button = page.get_by_role("button", name="Change the schedule of acai-7")
    button.focus()
    page.keyboard.press("Enter")
    expect(button).to_have_attribute("aria-expanded", "true")
    return page.get_by_role("form", name="Schedule of acai-7")


def test_a_schedule_is_made_of_a_plant_and_a_source(page: Page, service: Service, address: str):
    service.http.post("/v1/plants", json={"id": "acai-7"})
    page.goto(f"{address}/#/schedules")
    expect(page.get_by_text("No plant is scanned by itself yet.")).to_be_visible()
    page.get_by_text("New schedule").click()
    page.get_by_role("textbox", name="Plant").fill("acai-7")
    page.get_by_label("at times as cron writes them").check()
    page.get_by_label("Minute, hour, day, month, weekday").fill("0 6,18 * * *")
    page.get_by_label("Time zone").fill("America/Belem")
    page.get_by_role("button", name="Make the schedule").click()
    expect(page.locator("[data-schedule]")).to_contain_text("0 6,18 * * * America/Belem")


def test_only_what_was_changed_is_sent_so_that_the_next_time_stays(
    page: Page, service: Service, address: str, schedule: dict[str, Any]
):
    form = opened(page, address)
    form.get_by_label("Minutes that files may be late").fill("90")
    form.get_by_role("button", name="Keep the changes").click()
    expect(page.get_by_text("The schedule is changed.")).to_be_visible()
    expect(form).to_have_count(0)
    assert stored(service, schedule) == schedule | {"grace_minutes": 90.0}


def test_the_rhythm_and_the_source_are_changed_where_they_stand(
    page: Page, service: Service, address: str, schedule: dict[str, Any]
):
    form = opened(page, address)
    form.get_by_label("at times as cron writes them").check()
    form.get_by_label("Minute, hour, day, month, weekday").fill("30 5 * * 1")
    form.get_by_label("Time zone").fill("Europe/Lisbon")
    spec = form.locator("textarea")
    spec.fill(spec.input_value().replace("incoming/{plant}", "attic/{plant}"))
    form.get_by_role("button", name="Keep the changes").click()
    expect(page.locator("[data-schedule]")).to_contain_text("30 5 * * 1 Europe/Lisbon")
    found = stored(service, schedule)
    assert (found["every_hours"], found["cron"], found["time_zone"]) == (None, "30 5 * * 1", "Europe/Lisbon")
    assert found["spec"]["source"]["path"] == "attic/{plant}/{date}"


@pytest.mark.parametrize(
    ("cron", "spec", "reason"),
    [("0 25 * * *", None, "is no time of cron"), ("0 6 * * *", "{", "The specification is no JSON")],
)
def test_what_is_refused_stays_in_its_fields_with_the_reason(
    page: Page, service: Service, address: str, schedule: dict[str, Any], cron: str, spec: str | None, reason: str
):
    form = opened(page, address)
    form.get_by_label("at times as cron writes them").check()
    form.get_by_label("Minute, hour, day, month, weekday").fill(cron)
    if spec is not None:
        form.locator("textarea").fill(spec)
    form.get_by_role("button", name="Keep the changes").click()
    expect(form.get_by_role("alert")).to_contain_text(reason)
    expect(form.get_by_label("Minute, hour, day, month, weekday")).to_have_value(cron)
    assert stored(service, schedule) == schedule


def test_a_schedule_is_paused_goes_on_and_is_deleted(
    page: Page, service: Service, address: str, schedule: dict[str, Any]
):
    page.goto(f"{address}/#/schedules")
    row = page.locator("[data-schedule]")
    row.get_by_role("button", name="Pause").click()
    expect(row).to_contain_text("paused")
    assert stored(service, schedule)["enabled"] is False
    row.get_by_role("button", name="Go on").click()
    expect(row.get_by_role("button", name="Pause")).to_be_visible()
    row.get_by_role("button", name="Delete").click()
    page.get_by_role("button", name="Delete it").click()
    expect(page.get_by_text("No plant is scanned by itself yet.")).to_be_visible()
