"""A demonstration's scan with every file: what was imposed on drawn clouds is found again, kept, and shown."""

import json
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from nerfmodal.io import read_truth
from playwright.sync_api import Page, expect
from scanjobs.fleet.seeding import seed_fleet
from scanjobs.fsck import check
from scanjobs.scopes import LOCAL_OWNER

from services.api.app import create_app
from services.cli.demo_scan import SHOWN_POINTS, draw_scan
from tests.console.site import open_service
from tests.unit.api.live import live
from tests.unit.api.service import Json, Service

WITHIN = 0.005
"""Of a frequency: what scans scatter by anyway (`simulated.Nature`)."""


@dataclass(frozen=True)
class Demo:
    """A service with one plant whose newest scan was drawn, and where its page is."""

    service: Service
    address: str
    scan: str

    def get(self, path: str) -> Json:
        answer = self.service.http.get(path)
        assert answer.status_code == 200, answer.text
        found: Json = answer.json()
        return found


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory, migrated_sqlite: Path) -> Iterator[Demo]:
    service = open_service(tmp_path_factory.mktemp("demo"), migrated_sqlite)
    made = seed_fleet(
        service.store,
        service.artifacts,
        owner=LOCAL_OWNER,
        plants=1,
        scans=14,
        now=time.time(),
        full=1,
        draw=draw_scan,
    )
    assert made.full == ("demo-001",)
    [scan] = service.http.get("/v1/scans?tag=simulated").json()["items"]
    with live(create_app(service.settings, service.store, service.artifacts)) as address:
        yield Demo(service, address, scan["id"])
    service.store.close()


def test_the_modes_found_are_those_imposed_and_join_the_plant_s_tracks(demo: Demo, tmp_path: Path) -> None:
    (tmp_path / "truth.npz").write_bytes(demo.service.http.get(f"/v1/scans/{demo.scan}/artifacts/truth.npz").content)
    truth = [(one.organ, one.frequency) for one in read_truth(tmp_path / "truth.npz")]
    organs = demo.get(f"/v1/scans/{demo.scan}/modes")["organs"]
    found = [(organ["name"], mode["natural_frequency_hz"]) for organ in organs for mode in organ["modes"]]
    assert [organ for organ, _ in found] == [organ for organ, _ in truth]
    np.testing.assert_allclose([f for _, f in found], [f for _, f in truth], rtol=WITHIN)
    tracks = demo.get("/v1/tracks?plant=demo-001")["items"]
    assert len(tracks) == len(truth)
    newest = demo.get("/v1/plants/demo-001")["last_scan"]
    assert newest["id"] == demo.scan
    assert all(track["last_seen_at"] == newest["at"] for track in tracks)


def test_every_file_of_its_manifest_is_there_and_the_store_is_sound(demo: Demo) -> None:
    files = {file["name"]: file["sha256"] for file in demo.get(f"/v1/scans/{demo.scan}/artifacts")["items"]}
    manifest = json.loads(demo.service.http.get(f"/v1/scans/{demo.scan}/artifacts/manifest.json").content)
    told = {file["path"]: file["sha256"] for file in manifest["files"]}
    assert told.items() <= files.items()
    assert {"report.html", "figures/leaf_0_mode_0.mp4", "shapes/trunk_0.glb"} <= told.keys()
    with demo.service.store.read() as session:
        assert check(session, demo.service.artifacts) == ()


def test_the_page_shows_it_swinging_on_its_cloud_beside_the_truth_marked_as_simulated(page: Page, demo: Demo) -> None:
    page.goto(f"{demo.address}/#/scans/{demo.scan}/modes")
    expect(page.locator(".tag", has_text="simulated")).to_be_visible()
    expect(page.get_by_role("columnheader", name="True (Hz)")).to_be_visible()
    expect(page.locator("table.modes tbody tr").first).to_contain_text("%)")
    canvas = page.locator(".stage canvas")
    expect(canvas).to_have_attribute("data-points", str(SHOWN_POINTS))
    still = canvas.screenshot()
    page.wait_for_timeout(400)
    assert canvas.screenshot() != still
    page.get_by_role("link", name="Signals").click()
    expect(page.locator(".uplot canvas").first).to_be_visible()
    page.get_by_role("link", name="Files").click()
    with page.expect_download() as saved:
        page.get_by_role("button", name="modes.csv").click()
    assert saved.value.suggested_filename == "modes.csv"
