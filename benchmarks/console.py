"""The web page with a fleet of 200 plants and 5,000 scans: `python -m benchmarks.console [--plants 5000]`.

How long each page takes until it shows its content, the median of several visits in a headless Chromium, each with an
empty cache. What 50 open pages cost the API while nothing happens. How many points of 100,000 swing in software, at
which rate, and what of a picture is the page's own work. How long the long table takes as a file. Then the page of all
plants again, with as many as `--plants` says: rows copied of the 200, since a list looks at no scan. Minutes.
"""

import argparse
import os
import statistics
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from uuid import uuid4

import httpx
import numpy as np
from nerfmodal.types import PointCloud
from playwright.sync_api import Browser, sync_playwright
from scanjobs.fleet.seeding import seed_fleet
from scanjobs.fleet.tables import Plant, PlantTag
from scanjobs.migrate import upgrade
from scanjobs.scopes import LOCAL_OWNER
from scanjobs.store import Store
from scanjobs.table_base import table_of
from sqlalchemy import insert, select
from sqlalchemy.orm import Session

from benchmarks.rows import Row, print_and_write
from tests.console.api_process import Api
from tests.console.browsing import CHROMIUM, SOFTWARE
from tests.console.site import finished_scan, open_service
from tests.fixtures.scans import small_cloud
from tests.unit.api.service import Service

OUT = Path("out/benchmarks/console.json")
PLANTS, SCANS, POINTS = 200, 25, 100_000
VISITS, LISTENERS, EXPORTS = 5, 50, 3
SETTLING_S, REST_S, SWING_S = 3.0, 20.0, 25.0
TIMED = """window.took = []; const plain = window.requestAnimationFrame;
    window.requestAnimationFrame = (work) => plain.call(window, (now) => {
        const began = performance.now(); work(now); took.push(performance.now() - began); });"""
"""What the page itself does for a picture, whoever draws it."""
PAGES = {
    "plants": ("plants", "table.plants tbody tr"),
    "plant": ("plants/{plant}", ".uplot canvas"),
    "scans": ("scans", "tbody tr"),
    "scan": ("scans/{scan}", "table.modes tbody tr"),
    "scan, its mode in space without a graphics card": ("scans/{scan}", ".stage canvas:not([data-points='0'])"),
    "alarms": ("alarms", "article.alarm"),
    "new scan": ("new", "[data-pointer='/name']"),
}


LARGE = 5000
LARGE_PAGES = {
    "{count:,} plants": "plants",
    "{count:,} plants, those of one treatment, the lowest f/f0 first": "plants?treatment=drought&sort=ratio",
    "{count:,} plants, by a part of a name": "plants?text=7",
}


def main() -> None:
    """Measure all, print it and keep it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--plants", type=int, default=LARGE, help="of the large fleet; 0 leaves it out")
    large = parser.parse_args().plants
    with (
        tempfile.TemporaryDirectory(prefix="nerfmodal-bench-") as folder,
        fleet(Path(folder)) as (api, service, plant, scan),
    ):
        rows = [*idle(api, scan), *exports(api.url)]
        with sync_playwright() as playwright:
            browser = playwright.chromium.launch(executable_path=CHROMIUM, args=SOFTWARE)
            rows += [*loads(browser, api.url, plant, scan), *swing(browser, api.url, scan)]
            if large > PLANTS:
                grow(service.store, large)
                rows += large_loads(browser, api.url, large)
            browser.close()
    print_and_write(rows, OUT)


@contextmanager
def fleet(folder: Path) -> Iterator[tuple[Api, Service, str, str]]:
    """The API over the fleet and one large scan, in a process of its own; a plant's id and the scan's."""
    upgrade(f"sqlite:///{folder / 'migrated.db'}")
    service = open_service(folder / "service", folder / "migrated.db")
    seed_fleet(
        service.store,
        service.artifacts,
        owner=LOCAL_OWNER,
        plants=PLANTS,
        scans=SCANS,
        now=time.time(),
        on_plant=lambda *_: None,
    )
    scan = finished_scan(service, cloud=dense_cloud())
    plant = service.http.get("/v1/plants?sort=-alarms&limit=1").json()["items"][0]["id"]
    api = Api(service)
    api.start()
    yield api, service, plant, scan
    api.kill()
    service.store.close()


def dense_cloud() -> PointCloud:
    """The points of the small scan, many times over and a little apart."""
    small, rng = small_cloud(), np.random.default_rng(0)
    chosen = rng.integers(0, len(small.points), POINTS)
    points = small.points[chosen] + rng.normal(0, 0.002, (POINTS, 3))
    return PointCloud(points=points, colors=small.colors[chosen], time=0.0)


def loads(browser: Browser, url: str, plant: str, scan: str) -> Iterator[Row]:
    """Milliseconds from asking for a page to its content, with an empty cache."""
    for name, (path, content) in PAGES.items():
        took = [visit(browser, f"{url}/#/{path.format(plant=plant, scan=scan)}", content) for _ in range(VISITS)]
        yield Row(
            what=f"{name}: until its content stands",
            value=round(statistics.median(took)),
            unit="ms",
            floor=1000,
            aim=500,
        )


def grow(store: Store, count: int) -> None:
    """Copies of the fleet's plants, under other names, until there are `count`."""
    with store.read() as session:
        plants = [dict(row) for row in session.execute(select(table_of(Plant))).mappings()]
    others = [
        plant | {"key": str(uuid4()), "id": f"{plant['id']}-{copy}", "name": f"{plant['name']}.{copy}"}
        for copy in range(1, -(-count // len(plants)))
        for plant in plants
    ]
    tags = [{"plant_key": plant["key"], "tag": tag} for plant in others for tag in plant["tags"]]

    def work(session: Session) -> None:
        session.execute(insert(table_of(Plant)), others)
        session.execute(insert(table_of(PlantTag)), tags)

    store.write(work)


def large_loads(browser: Browser, url: str, count: int) -> Iterator[Row]:
    """Milliseconds until a page of a large fleet stands, with an empty cache."""
    for what, path in LARGE_PAGES.items():
        took = [visit(browser, f"{url}/#/{path}", PAGES["plants"][1]) for _ in range(VISITS)]
        name = what.format(count=count)
        yield Row(
            what=f"{name}: until they stand", value=round(statistics.median(took)), unit="ms", floor=1000, aim=500
        )


def exports(url: str) -> Iterator[Row]:
    """Seconds until every observation is saved."""
    for form in ("csv", "parquet"):
        took = []
        for _ in range(EXPORTS):
            began = time.perf_counter()
            httpx.get(f"{url}/v1/exports/observations", params={"format": form}, timeout=120).raise_for_status()
            took.append(time.perf_counter() - began)
        what = f"observations of {PLANTS * SCANS:,} scans as {form}"
        yield Row(what=what, value=round(statistics.median(took), 2), unit="s", floor=5, aim=1)


def visit(browser: Browser, address: str, content: str) -> float:
    """One visit in a session of its own."""
    context = browser.new_context()
    page = context.new_page()
    began = time.perf_counter()
    page.goto(address, wait_until="commit")
    page.locator(content).first.wait_for()
    took = 1000 * (time.perf_counter() - began)
    context.close()
    return took


def idle(api: Api, scan: str) -> Iterator[Row]:
    """Share of one core that the API uses while pages are open and nothing happens: half watch a scan, half all."""
    paths = [f"/v1/scans/{scan}/events", "/v1/events?steps=true"] * (LISTENERS // 2)
    client = httpx.Client(base_url=api.url, limits=httpx.Limits(max_connections=None), timeout=60)
    with client, ExitStack() as open_pages:
        for path in paths:
            answer = open_pages.enter_context(client.stream("GET", path))
            assert answer.status_code == 200
        time.sleep(SETTLING_S)
        before = cpu_s(api.pid)
        time.sleep(REST_S)
        used = cpu_s(api.pid) - before
    yield Row(
        what=f"{LISTENERS} open pages at rest", value=round(100 * used / REST_S, 2), unit="% of a core", floor=10, aim=3
    )


def cpu_s(pid: int) -> float:
    """Seconds of processor time that a process has used."""
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def swing(browser: Browser, url: str, scan: str) -> Iterator[Row]:
    """What a processor alone draws of a mode on 100,000 points, once the page has settled."""
    page = browser.new_page(viewport={"width": 1280, "height": 900})
    page.add_init_script(TIMED)
    page.goto(f"{url}/#/scans/{scan}/modes")
    canvas = page.locator(".stage canvas")
    time.sleep(SWING_S)
    shown, fps = int(canvas.get_attribute("data-shown") or 0), float(canvas.get_attribute("data-fps") or 0)
    yield Row(
        what=f"points that swing without a graphics card, of {POINTS:,}",
        value=shown,
        unit="points",
        floor=2000,
        aim=POINTS,
    )
    script_ms = statistics.median(page.evaluate("window.took.slice(-100)"))
    yield Row(what="JavaScript of one picture", value=round(script_ms, 2), unit="ms", floor=8, aim=2)
    yield Row(what="pictures a second at that", value=round(fps, 1), unit="1/s", floor=15, aim=30)
    page.close()


if __name__ == "__main__":
    main()
