"""New scans: the form is the service's own schema, files go on after a reload, a fork sends what was changed."""

import io
import json
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from playwright.sync_api import Page, expect
from scanjobs.repository import get_scan, list_scans

from tests.unit.api.service import Service, simulation

CHUNK = 4 << 20


def spec_of(service: Service, name: str) -> dict[str, Any]:
    """The specification of the scan of this name, as it is stored."""
    with service.store.read() as session:
        [found] = [one for one in list_scans(session).items if one.name == name]
        return dict(found.spec)


def test_a_preset_with_a_changed_option_is_submitted(page: Page, service: Service, address: str):
    page.goto(f"{address}/#/new")
    page.get_by_role("button", name="quick").click()
    page.locator("[data-pointer='/name'] input").fill("from-the-page")
    page.locator("[data-pointer='/source/frames'] input").fill("44")
    page.get_by_text("Identification", exact=False).first.click()
    page.locator("[data-pointer='/identification/max_modes'] input").fill("5")
    page.locator("[data-pointer='/tags'] input").fill("wind, night")
    page.get_by_role("button", name="Submit the scan").click()
    expect(page.get_by_role("heading", level=1)).to_have_text("from-the-page")
    spec = spec_of(service, "from-the-page")
    assert (spec["source"]["frames"], spec["identification"]["max_modes"]) == (44, 5)
    assert tuple(spec["tags"]) == ("wind", "night")


def test_what_is_wrong_stands_at_its_field(page: Page, address: str):
    page.goto(f"{address}/#/new")
    page.locator("[data-pointer='/source/frames'] input").fill("0")
    page.get_by_role("button", name="Submit the scan").click()
    expect(page.get_by_role("alert").first).to_contain_text("INVALID_SPEC")
    field = page.locator("[data-pointer='/source/frames']")
    expect(field.locator("input")).to_have_attribute("aria-invalid", "true")
    expect(field.locator(".wrong")).to_be_visible()


def test_sources_change_what_the_form_asks_for(page: Page, address: str):
    page.goto(f"{address}/#/new")
    expect(page.locator("[data-pointer='/source/frames']")).to_be_visible()
    page.locator("select[name='/source']").select_option(label="clouds")
    expect(page.locator("[data-pointer='/source/unit']")).to_be_visible()
    expect(page.locator("[data-pointer='/source/frames']")).to_have_count(0)


def test_preflight_answers_before_anything_is_submitted(page: Page, service: Service, address: str):
    page.goto(f"{address}/#/new")
    page.get_by_role("button", name="quick").click()
    page.get_by_role("button", name="What can it resolve?").click()
    answer = page.get_by_label("Preflight")
    expect(answer.get_by_role("heading")).to_contain_text("Preflight")
    expect(answer.locator("tbody tr").first).to_be_visible()
    expect(answer).to_contain_text("Cost")
    assert service.rows() == 0


def test_a_fork_sends_what_was_changed_alone(page: Page, service: Service, address: str):
    scan = str(service.submit(simulation(name="parent"))["id"])
    bodies: list[str] = []
    page.on("request", lambda one: bodies.append(one.post_data or "") if one.url.endswith("/fork") else None)
    page.goto(f"{address}/#/scans/{scan}")
    page.get_by_role("button", name="Fork with changes").click()
    page.locator("[data-pointer='/name'] input").fill("child")
    page.locator("[data-pointer='/seed'] input").fill("3")
    page.get_by_role("button", name="Submit the scan").click()
    expect(page.get_by_role("heading", level=1)).to_have_text("child")
    assert json.loads(bodies[0]) == {"name": "child", "seed": 3}
    with service.store.read() as session:
        assert get_scan(session, page.url.split("/scans/")[1].split("/")[0]).root_id == scan


@pytest.fixture
def clouds(tmp_path: Path) -> Path:
    """A record of a thousand points in 20 frames, as one file of more than one piece."""
    rng = np.random.default_rng(0)
    frames = {f"frame_{k:04d}": rng.normal(size=(20_000, 3)) for k in range(20)}
    path = tmp_path / "record.npz"
    with path.open("wb") as file:
        np.savez(file, frame_rate_hz=np.array(30.0), **frames)
    assert path.stat().st_size > 2 * CHUNK
    return path


def test_an_upload_goes_on_after_a_reload_where_it_stood(page: Page, service: Service, address: str, clouds: Path):
    """The second piece is refused until the page is loaded anew; then only what was not there yet is sent."""
    offsets: list[int] = []
    page.on("request", lambda one: offsets.append(int(one.headers["upload-offset"])) if one.method == "PATCH" else None)
    page.route(
        "**/v1/uploads/*",
        lambda route: (
            route.abort()
            if route.request.method == "PATCH" and route.request.headers["upload-offset"] != "0"
            else route.continue_()
        ),
    )
    page.goto(f"{address}/#/new")
    page.locator("input[name='files']").set_input_files(clouds)
    expect(page.get_by_label("Uploads")).to_contain_text("4.2 MB of")
    page.reload()
    expect(page.get_by_text("1 upload not finished")).to_be_visible()
    page.unroute("**/v1/uploads/*")  # not before: the old page would try again, and go on by itself
    offsets.clear()
    page.locator("input[name='files']").set_input_files(clouds)
    expect(page.get_by_text("The files are there: 1 file.")).to_be_visible()
    assert offsets[0] == CHUNK
    source = page.locator("[data-pointer='/source/path'] input")
    expect(source).to_have_value(path_of_capture(service))


def path_of_capture(service: Service) -> str:
    """What a specification says to use the one capture there is."""
    [capture] = service.http.get("/v1/captures").json()["items"]
    return str(capture["source"]["path"])


def test_dropped_files_of_a_folder_become_a_capture(page: Page, service: Service, address: str):
    """A zip that is dropped is taken as the capture that it holds."""
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        record = io.BytesIO()
        np.savez(record, frame_rate_hz=np.array(30.0), frame_0000=np.ones((9, 3)), frame_0001=np.zeros((9, 3)))
        archive.writestr("record.npz", record.getvalue())
    page.goto(f"{address}/#/new")
    data = page.evaluate_handle(
        """bytes => { const files = new DataTransfer();
            files.items.add(new File([Uint8Array.from(bytes)], 'record.zip', {type: 'application/zip'}));
            return files; }""",
        list(packed.getvalue()),
    )
    page.locator(".drop").dispatch_event("drop", {"dataTransfer": data})
    expect(page.get_by_text("The files are there", exact=False)).to_be_visible()
    [capture] = service.http.get("/v1/captures").json()["items"]
    assert capture["kind"] == "clouds"
