"""Exports, BrAPI and treatments say what the history says; schedules and e-mail do what they promise."""

import asyncio
import csv
import io
import json
import shutil
import socket
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from aiosmtpd.controller import Controller
from scanjobs.account_tables import WebhookDelivery
from scanjobs.artifacts import ArtifactStore
from scanjobs.clock import now_s
from scanjobs.fleet.exports import csv_of
from scanjobs.fleet.joining import join
from scanjobs.fleet.plants import get_plant
from scanjobs.fleet.schedules import due_schedules, next_of_cron, run_due
from scanjobs.fleet.seeding import seed_fleet
from scanjobs.fleet.tables import Alarm, Observation, Schedule
from scanjobs.migrate import upgrade
from scanjobs.scopes import LOCAL_OWNER
from scanjobs.settings import Settings
from scanjobs.store import open_store
from sqlalchemy import delete, update
from starlette.testclient import TestClient

from services.api.app import create_app
from services.api.deliveries import Deliveries
from tests.unit.api.service import Service, simulation

NOW = 1_767_225_600.0
Json = dict[str, Any]


@pytest.fixture(scope="module")
def seeded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    settings = Settings(data_folder=tmp_path_factory.mktemp("seeded"))
    upgrade(settings.database)
    store = open_store(settings.database)
    seed_fleet(store, ArtifactStore(settings.artifacts), owner=LOCAL_OWNER, plants=4, scans=20, now=NOW)
    store.close()
    return settings.data_folder


@pytest.fixture
def fleet(seeded: Path, tmp_path: Path) -> Iterator[Service]:
    """A service that has the fleet, and tells nobody by itself."""
    settings = Settings(data_folder=Path(shutil.copytree(seeded, tmp_path / "data")))
    store, artifacts = open_store(settings.database), ArtifactStore(settings.artifacts)
    http = TestClient(create_app(settings, store, artifacts), raise_server_exceptions=False)
    yield Service(http=http, settings=settings, store=store, artifacts=artifacts, folder=tmp_path)
    store.close()


def table(text: str) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(text)))


def test_the_long_table_has_every_point_of_the_history(fleet: Service) -> None:
    rows = table(fleet.http.get("/v1/exports/observations", params={"plant": "demo-001"}).text)
    history = fleet.http.get("/v1/plants/demo-001/history").json()
    for track in history["tracks"]:
        mine = [row for row in rows if row["track"] == track["id"] and row["trait"] == "natural_frequency"]
        np.testing.assert_allclose([float(row["value"]) for row in mine], track["points"]["frequency_hz"])
        ratios = [row for row in rows if row["track"] == track["id"] and row["trait"] == "frequency_ratio"]
        np.testing.assert_allclose([float(row["value"]) for row in ratios], track["points"]["ratio"])
    assert {row["treatment"] for row in rows} == {"control"}
    assert all(row["temperature_c"] for row in rows)


def test_parquet_is_the_same_table(fleet: Service) -> None:
    answer = fleet.http.get("/v1/exports/observations", params={"format": "parquet"})
    parquet = pq.read_table(io.BytesIO(answer.content))
    rows = table(fleet.http.get("/v1/exports/observations").text)
    assert parquet.num_rows == len(rows) > 500
    np.testing.assert_allclose(parquet["value"].to_numpy(), [float(row["value"]) for row in rows])
    assert str(parquet.schema.field("at").type) == "timestamp[ms, tz=UTC]"


def test_a_crate_describes_every_file_it_has(fleet: Service) -> None:
    answer = fleet.http.get("/v1/exports/ro-crate", params={"study": "greenhouse-demo"})
    archive = zipfile.ZipFile(io.BytesIO(answer.content))
    graph = {entity["@id"]: entity for entity in json.loads(archive.read("ro-crate-metadata.json"))["@graph"]}
    assert graph["ro-crate-metadata.json"]["conformsTo"]["@id"] == "https://w3id.org/ro/crate/1.1"
    assert {"name", "description", "datePublished", "license"} <= graph["./"].keys()
    parts = {part["@id"] for part in graph["./"]["hasPart"]}
    assert parts == set(archive.namelist()) - {"ro-crate-metadata.json"}
    for name in parts:
        assert graph[name]["@type"] == "File"
        assert int(graph[name]["contentSize"]) == len(archive.read(name))
    assert len(table(archive.read("plants.csv").decode())) == 4


def test_text_that_a_spreadsheet_would_compute_stays_text() -> None:
    [line] = table(b"".join(csv_of([{"a": "=1+1", "b": -2.5}], ("a", "b"))).decode())
    assert line == {"a": "'=1+1", "b": "-2.5"}


def test_brapi_pages_join_to_the_whole_and_count_it(fleet: Service) -> None:
    for call in ("studies", "trials", "observationunits", "variables", "observations"):
        found: list[Json] = []
        page = 0
        while True:
            body = fleet.http.get(f"/brapi/v2/{call}", params={"page": page, "pageSize": 67}).json()
            found += body["result"]["data"]
            page += 1
            if page >= body["metadata"]["pagination"]["totalPages"]:
                break
        assert len(found) == body["metadata"]["pagination"]["totalCount"], call
        name = next(key for key in found[0] if key.endswith("DbId"))
        assert len({row[name] for row in found}) == len(found), call
    unit = fleet.http.get("/brapi/v2/observations", params={"observationUnitDbId": "demo-002", "pageSize": 5}).json()
    assert {row["observationUnitDbId"] for row in unit["result"]["data"]} == {"demo-002"}
    assert fleet.http.get("/brapi/v2/serverinfo").json()["result"]["calls"][0]["versions"] == ["2.1"]
    assert fleet.http.get("/brapi/v2/commoncropnames").json()["result"]["data"] == ["Euterpe oleracea"]


def test_brapi_asks_for_a_key_too(fleet: Service) -> None:
    assert fleet.locked().get("/brapi/v2/studies").status_code == 401


def test_treatments_are_boxes_of_their_plants(fleet: Service) -> None:
    items = fleet.http.get("/v1/fleet/treatments").json()["items"]
    assert {row["treatment"]: row["plants"] for row in items} == {"control": 2, "drought": 1, "recovery": 1}
    for row in items:
        for box in (*row["by_day"], row["latest"]):
            assert box["min"] <= box["q1"] <= box["median"] <= box["q3"] <= box["max"]


def schedule(service: Service, **values: Any) -> Json:
    service.http.post("/v1/plants", json={"id": "p"})
    spec = {"source": {"kind": "clouds", "path": "{plant}/{date}"}}
    answer = service.http.post("/v1/schedules", json={"plant": "p", "every_hours": 6, "spec": spec} | values)
    assert answer.status_code == 201, answer.text
    made: Json = answer.json()
    return made


def make_due(service: Service, ago_s: float) -> None:
    service.store.write(lambda session: session.execute(update(Schedule).values(next_due_at=now_s() - ago_s)))


def run(service: Service) -> list[str | None]:
    with service.store.read() as session:
        due = due_schedules(session)
    return [service.store.write(lambda session, one=one: run_due(session, service.settings, one)) for one in due]


def test_a_due_scan_waits_for_its_source_and_is_submitted_once(service: Service) -> None:
    made = schedule(service, spec=simulation())
    make_due(service, 10.0)
    assert (run(service), run(service)) == (["submitted"], [])
    [scan] = service.http.get("/v1/scans", params={"plant": "p"}).json()["items"]
    shown = service.http.get(f"/v1/schedules/{made['id']}").json()
    assert (shown["last"]["scan"], shown["last"]["state"]) == (scan["id"], "submitted")


def test_a_source_that_is_late_is_waited_for_and_then_missed(service: Service) -> None:
    made = schedule(service, grace_minutes=30)
    make_due(service, 60.0)
    assert run(service) == [None]
    make_due(service, 31 * 60.0)
    assert run(service) == ["missed"]
    plant = service.http.get("/v1/plants/p").json()
    assert (plant["missed_scans"], plant["alarms"], plant["worst"]) == (1, 1, "notice")
    [alarm] = service.http.get("/v1/alarms").json()["items"]
    assert (alarm["kind"], alarm["state"]) == ("scan_missed", "open")
    service.http.patch(f"/v1/schedules/{made['id']}", json={"spec": simulation()})
    make_due(service, 5.0)
    assert run(service) == ["submitted"]
    assert service.http.get(f"/v1/alarms/{alarm['id']}").json()["closed_by"] == "data"
    states = [row["state"] for row in service.http.get(f"/v1/schedules/{made['id']}/runs").json()["items"]]
    assert states == ["submitted", "missed"]


def test_cron_keeps_the_hour_of_its_zone_through_summer_time() -> None:
    before, after = 1_774_656_000.0, 1_774_828_800.0  # 28 and 30 March 2026, 00:00 UTC
    assert (next_of_cron("0 6 * * *", "Europe/Paris", before) % 86400) / 3600 == 5
    assert (next_of_cron("0 6 * * *", "Europe/Paris", after) % 86400) / 3600 == 4


@pytest.mark.parametrize(
    "wrong",
    [{"cron": "0 6 * * *"}, {"every_hours": None}, {"cron": "0 6 31 2 *", "every_hours": None}, {"time_zone": "Mars"}],
)
def test_times_that_never_come_are_refused(service: Service, wrong: Json) -> None:
    service.http.post("/v1/plants", json={"id": "p"})
    body = {"plant": "p", "every_hours": 6, "spec": simulation()} | wrong
    assert service.http.post("/v1/schedules", json=body).status_code == 422


class Mailbox:
    """What an SMTP server took; it refuses the first message for now."""

    def __init__(self) -> None:
        self.messages: list[str] = []
        self.refusals = 1

    async def handle_DATA(self, server: object, session: object, envelope: Any) -> str:  # noqa: ARG002
        if self.refusals:
            self.refusals -= 1
            return "451 try again later"
        self.messages.append(envelope.content.decode())
        return "250 OK"


def test_alarms_go_out_by_e_mail_and_are_tried_again(fleet: Service) -> None:
    mailbox = Mailbox()
    port = free_port()
    controller = Controller(mailbox, hostname="127.0.0.1", port=port)
    controller.start()
    try:
        settings = fleet.settings.model_copy(update={"smtp_url": f"smtp://127.0.0.1:{port}"})
        http = TestClient(create_app(settings, fleet.store, fleet.artifacts))
        hook = {"url": "mailto:grower@example.org", "types": ["alarm.opened"]}
        assert http.post("/v1/webhooks", json=hook).status_code == 201
        assert http.post("/v1/webhooks", json={"url": "mailto:a@b.org,c@d.org"}).status_code == 422
        open_an_alarm(fleet)
        sender = Deliveries(fleet.store, settings)
        assert asyncio.run(sender.send_due())
        fleet.store.write(lambda session: session.execute(update(WebhookDelivery).values(next_at=0.0)))
        assert asyncio.run(sender.send_due())
    finally:
        controller.stop()
    [message] = mailbox.messages
    assert "To: grower@example.org" in message
    assert "lower" in message
    assert "alarm.opened" in message or "message.json" in message


def free_port() -> int:
    """A port that nobody listens at now; the controller wants to know its own before it starts."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
    return port


def open_an_alarm(fleet: Service) -> None:
    """Let the data of one plant say that it drifts."""

    def work(session: Any) -> None:
        plant = get_plant(session, "demo-001", owner=LOCAL_OWNER)
        last = sorted({row.at for row in session.query(Observation).filter_by(plant_key=plant.key)})[-6]
        lowered = update(Observation).where(Observation.plant_key == plant.key, Observation.at >= last)
        session.execute(delete(Alarm).where(Alarm.plant_key == plant.key))
        session.execute(lowered.values(frequency_hz=Observation.frequency_hz * 0.94))

    fleet.store.write(work)
    with fleet.store.read() as session:
        key = get_plant(session, "demo-001", owner=LOCAL_OWNER).key
    join(fleet.store, fleet.artifacts, key)


def test_mail_is_refused_where_there_is_no_server(service: Service) -> None:
    answer = service.http.post("/v1/webhooks", json={"url": "mailto:a@example.org"})
    assert (answer.status_code, answer.json()["code"]) == (422, "NO_MAIL_SERVER")
