"""/metrics, /healthz and /readyz tell the truth, and every request leaves one line with its id."""

import logging
import shutil

import pytest
from prometheus_client.parser import text_string_to_metric_families
from scanjobs.settings import Settings
from scanjobs.store import open_store
from sqlalchemy import event
from starlette.testclient import TestClient

from services.api.app import create_app
from tests.unit.api.service import Service, simulation


def sample(text: str, name: str, **labels: str) -> float | None:
    """One sample of an exposition."""
    for family in text_string_to_metric_families(text):
        for one in family.samples:
            if one.name == name and one.labels == labels:
                return float(one.value)
    return None


def test_metrics_count_what_waits_and_time_what_was_asked(service: Service):
    service.submit()
    service.http.get("/v1/scans")
    answer = service.http.get("/metrics")
    assert answer.headers["content-type"].startswith("text/plain")
    assert sample(answer.text, "nerfmodal_scans", state="queued") == 1
    assert sample(answer.text, "nerfmodal_steps", queue="render", state="ready") == 3
    asked = {"method": "GET", "route": "/v1/scans", "status": "200"}
    assert sample(answer.text, "nerfmodal_http_seconds_count", **asked) == 1
    assert sample(answer.text, "nerfmodal_database_up") == 1


def test_ids_and_unknown_paths_make_no_series_of_their_own(service: Service):
    for number in range(5):
        service.http.get(f"/nothing/{number}")
        service.http.get(f"/v1/scans/00000000-0000-7000-8000-00000000000{number}")
    text = service.http.get("/metrics").text
    missing = {"method": "GET", "route": "/v1/scans/{scan_id}", "status": "404"}
    assert sample(text, "nerfmodal_http_seconds_count", **missing) == 5
    assert sample(text, "nerfmodal_http_seconds_count", method="any", route="none", status="404") == 5


def test_every_request_leaves_a_line_with_its_id(service: Service, caplog: pytest.LogCaptureFixture):
    with caplog.at_level(logging.INFO, "nerfmodal.access"):
        service.http.get("/v1/info", headers={"X-Request-Id": "abc-1"})
    [line] = [record for record in caplog.records if record.name == "nerfmodal.access"]
    assert (line.route, line.status) == ("/v1/info", 200)  # type: ignore[attr-defined]


def test_ready_says_what_is_wrong_with_the_tables(service: Service):
    """Tables without a revision are not known to be this version's."""
    service.store.write(lambda session: session.connection().exec_driver_sql("DELETE FROM alembic_version"))
    answer = service.http.get("/readyz")
    assert answer.status_code == 503
    assert "revision none" in answer.json()["checks"]["tables"]


def test_ready_is_degraded_but_true_without_broker_or_room(service: Service):
    """Both are delay, not failure: the answer is 200, and says so."""
    for changes, name in (({"broker_url": "redis://127.0.0.1:1/0"}, "broker"), ({"disk_low_mb": 10**12}, "disk")):
        settings = service.settings.model_copy(update=changes)
        with TestClient(create_app(settings, service.store, service.artifacts)) as http:
            answer = http.get("/readyz")
        assert (answer.status_code, answer.json()["status"]) == (200, "degraded")
        assert {key for key, words in answer.json()["checks"].items() if words != "ok"} == {name}


def test_ready_fails_where_the_artifacts_cannot_be_written(service: Service):
    shutil.rmtree(service.settings.artifacts)
    answer = service.http.get("/readyz")
    assert answer.status_code == 503
    assert answer.headers["Retry-After"] == "5"
    assert answer.json()["checks"]["artifacts"] != "ok"


def test_ready_fails_without_a_database_and_names_no_address(service: Service):
    settings = Settings(
        data_folder=service.folder / "other", database_url="postgresql+psycopg://u:geheim@127.0.0.1:1/x"
    )
    store = open_store(settings.database)
    with TestClient(create_app(settings, store, service.artifacts), raise_server_exceptions=False) as http:
        answer = http.get("/readyz")
        text = http.get("/metrics").text
    store.close()
    assert answer.status_code == 503
    assert answer.json()["checks"]["database"] == "it cannot be reached"
    assert "geheim" not in answer.text
    assert sample(text, "nerfmodal_database_up") == 0


@pytest.mark.parametrize("frames", [4, 4000])
def test_submitting_costs_the_same_however_long_the_plan_is(service: Service, frames: int):
    """One row of the scan and one of its birth; the plan is written down by the next tick of a worker."""
    written: list[str] = []
    event.listen(service.store.engine, "before_cursor_execute", lambda *given: written.append(given[2]))
    spec = simulation() | {"source": simulation()["source"] | {"frames": frames}}
    body = service.http.post("/v1/scans", json=spec).json()
    assert [text.split()[2] for text in written if text.startswith("INSERT")] == ["scan", "event"]
    promised = {row["step"]: row["total"] for row in body["progress"]}
    service.plant()
    planted = {row["step"]: row["total"] for row in service.http.get(f"/v1/scans/{body['id']}").json()["progress"]}
    assert planted == promised
    assert promised["frame.train"] == frames + 1
