"""A fleet in the page: watched, filtered, opened, put right, alarmed and exported."""

import csv
import re
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect
from scanjobs.fleet.seeding import seed_fleet
from scanjobs.scopes import LOCAL_OWNER

from services.api.app import create_app
from tests.console.site import open_service
from tests.unit.api.live import live
from tests.unit.api.service import Service

PLANTS, SCANS = 12, 25
ALL = "fetch('/v1/plants?limit=200').then(answer => answer.json()).then(page => page.items)"


@pytest.fixture(scope="module")
def greenhouse(tmp_path_factory: pytest.TempPathFactory, migrated_sqlite: Path) -> Iterator[tuple[str, Service]]:
    """A dozen plants over two weeks: every third is left dry towards the end."""
    service = open_service(tmp_path_factory.mktemp("greenhouse"), migrated_sqlite)
    seed_fleet(
        service.store,
        service.artifacts,
        owner=LOCAL_OWNER,
        plants=PLANTS,
        scans=SCANS,
        now=time.time(),
        on_plant=lambda *_: None,
    )
    with live(create_app(service.settings, service.store, service.artifacts)) as found:
        yield found, service
    service.store.close()


@pytest.fixture
def plants(page: Page, greenhouse: tuple[str, Service]) -> Page:
    """The page of all plants."""
    page.goto(f"{greenhouse[0]}/#/plants")
    expect(page.locator("table.plants tbody tr")).to_have_count(PLANTS)
    return page


def rows(page: Page) -> list[dict[str, object]]:
    """What the service says of the plants."""
    found: list[dict[str, object]] = page.evaluate(ALL)
    return found


def alarmed(page: Page) -> dict[str, object]:
    """A plant with an open alarm."""
    return next(row for row in rows(page) if row["alarms"])


def test_every_plant_shows_its_frequencies_history_and_state(plants: Page):
    row = plants.locator("table.plants tbody tr").first
    expect(row.locator("svg.spark")).to_be_visible()
    expect(row.locator(".state").first).to_be_visible()
    first = rows(plants)[0]
    expect(row).to_contain_text(str(first["name"]))
    expect(plants.locator(".numbers")).to_contain_text(f"{PLANTS} plants")


def test_plants_are_filtered_and_sorted_by_the_service(plants: Page):
    treatment = str(rows(plants)[0]["treatment"])
    fitting = [row for row in rows(plants) if row["treatment"] == treatment]
    table = plants.locator("table.plants tbody tr")
    plants.get_by_label("Treatment").select_option(treatment)
    expect(table).to_have_count(len(fitting))
    assert f"treatment={treatment}" in plants.url
    plants.get_by_label("Treatment").select_option("")
    plants.locator("select[name='alarm']").select_option("true")
    expect(table).to_have_count(sum(1 for row in rows(plants) if row["alarms"]))
    plants.locator("select[name='alarm']").select_option("")
    expect(table).to_have_count(PLANTS)
    plants.get_by_role("button", name="f/f₀").click()
    expect(plants.locator("th[aria-sort='ascending']")).to_have_text("f/f₀ ↑")
    lowest = min((row for row in rows(plants) if row["ratio"] is not None), key=lambda row: float(str(row["ratio"])))
    expect(table.first).to_contain_text(str(lowest["name"]))


def test_a_phone_shows_the_ratio_its_history_and_alarms_without_scrolling_sideways(plants: Page):
    plants.set_viewport_size({"width": 375, "height": 740})
    row = plants.locator(f"[data-plant='{alarmed(plants)['id']}']")
    for inside in (row.locator("td.number"), row.locator("svg.spark"), row.locator("a .state").last):
        expect(inside).to_be_visible()
        box = inside.bounding_box()
        assert box is not None
        assert box["x"] + box["width"] <= 375


def test_a_plant_leads_to_its_last_scan(plants: Page):
    plant = rows(plants)[0]
    plants.get_by_role("link", name=str(plant["name"]), exact=True).click()
    plants.get_by_role("link", name="last scan").click()
    expect(plants.get_by_role("navigation", name="Parts of the scan")).to_be_visible()


def test_a_plant_opens_with_its_history_events_and_alarm(plants: Page):
    plant = alarmed(plants)
    plants.get_by_role("link", name=str(plant["name"]), exact=True).click()
    expect(plants.get_by_role("heading", level=1)).to_have_text(str(plant["name"]))
    expect(plants.locator("article.alarm").first).to_be_visible()
    chart = plants.locator(".chart [role=img]")
    expect(chart).to_have_attribute("aria-label", spanning(r"f/f₀ of \d tracks.*values.*watering"))
    for view in ("frequency", "damping", "mac"):
        plants.get_by_label("Show").select_option(view)
        expect(plants.locator(".uplot canvas")).to_be_visible()


@pytest.mark.parametrize(
    ("tab", "sees"),
    [("Drift", ".uplot canvas"), ("Environment", ".uplot canvas"), ("Tracks", "tbody tr"), ("Scans", "tbody tr")],
)
def test_a_plant_s_parts_open(plants: Page, tab: str, sees: str):
    plants.locator("table.plants tbody tr").first.click(position={"x": 300, "y": 5})
    plants.get_by_role("navigation", name="Parts of the plant").get_by_role("link", name=tab).click()
    expect(plants.locator(sees).first).to_be_visible()


def test_treatments_stand_side_by_side(plants: Page, greenhouse: tuple[str, Service]):
    plants.goto(f"{greenhouse[0]}/#/plants/{rows(plants)[0]['id']}/treatments")
    boxes = plants.locator("svg.boxes")
    expect(boxes).to_have_attribute("aria-label", spanning("control: median"))
    names = {str(row["treatment"]) for row in rows(plants)}
    assert boxes.locator("rect").count() >= len(names)
    expect(plants.locator(".legend > span")).to_have_count(len(names))


def test_a_track_is_renamed_and_split_by_hand(plants: Page, greenhouse: tuple[str, Service]):
    plant = rows(plants)[-1]["id"]
    plants.goto(f"{greenhouse[0]}/#/plants/{plant}/tracks")
    tracks = plants.locator("table").first.locator("tbody tr")
    tracks.first.wait_for()
    before = tracks.count()
    tracks.first.get_by_role("button").click()
    plants.locator("input[name='track-name']").fill("first bending")
    plants.get_by_role("button", name="Rename").click()
    expect(tracks.first).to_contain_text("first bending")
    plants.get_by_role("button", name="Another mode from here").first.click()
    expect(tracks).to_have_count(before + 1)


def test_an_event_is_written_down(plants: Page, greenhouse: tuple[str, Service]):
    plant = rows(plants)[0]["id"]
    plants.goto(f"{greenhouse[0]}/#/plants/{plant}/environment")
    plants.get_by_role("heading", name="Write an event down").wait_for()
    plants.locator("form input[name='note']").fill("a leaf was cut")
    plants.get_by_role("button", name="Write down").click()
    expect(plants.get_by_text("The event is written down.")).to_be_visible()
    events = plants.evaluate(f"fetch('/v1/plants/{plant}/events').then(a => a.json()).then(a => a.items)")
    assert "a leaf was cut" in [event["note"] for event in events]


def test_an_alarm_says_what_changed_and_is_acknowledged_and_closed(page: Page, greenhouse: tuple[str, Service]):
    page.goto(f"{greenhouse[0]}/#/alarms?state=open&kind=drift")
    alarm = page.locator("article.alarm").first
    expect(alarm).to_contain_text("lower since")
    expect(alarm).to_contain_text("sure")
    expect(alarm).to_contain_text("beyond what temperature")
    expect(alarm).not_to_contain_text("temperature_c")
    which = alarm.get_attribute("data-alarm")
    alarm.get_by_label("Note").fill("the drip is blocked")
    alarm.get_by_role("button", name="Acknowledge").click()
    expect(page.locator(f"[data-alarm='{which}']")).to_have_count(0)
    page.get_by_label("State").select_option("acknowledged")
    mine = page.locator(f"[data-alarm='{which}']")
    expect(mine).to_contain_text("the drip is blocked")
    mine.get_by_role("button", name="Close").click()
    page.get_by_role("button", name="Close it").click()
    expect(mine).to_have_count(0)
    page.get_by_label("State").select_option("closed")
    expect(mine).to_contain_text("closed")


def test_observations_are_exported(plants: Page):
    with plants.expect_download() as saved:
        plants.get_by_role("button", name="Observations (.csv)").click()
    with saved.value.path().open(newline="") as file:
        found = list(csv.DictReader(file))
    assert len({row["plant"] for row in found}) == PLANTS


def spanning(pattern: str) -> re.Pattern[str]:
    """A pattern that spans lines."""
    return re.compile(pattern, re.DOTALL)
