"""A fleet on PostgreSQL: seeded, listed, corrected, exported and removed as on SQLite."""

from pathlib import Path

from scanjobs.artifacts import ArtifactStore
from scanjobs.fleet.seeding import remove_fleet, seed_fleet
from scanjobs.fsck import check
from scanjobs.migrate import upgrade
from scanjobs.scopes import LOCAL_OWNER
from scanjobs.settings import Settings
from scanjobs.store import open_store
from starlette.testclient import TestClient

from services.api.app import create_app

NOW = 1_767_225_600.0
READS = (
    "/v1/plants?sort=-ratio&limit=2&text=demo",
    "/v1/fleet",
    "/v1/fleet/treatments",
    "/v1/plants/demo-002/history",
    "/v1/plants/demo-002/environment",
    "/v1/tracks?plant=demo-002",
    "/v1/alarms",
    "/v1/exports/observations",
    "/v1/exports/ro-crate",
    "/brapi/v2/observations?pageSize=10",
    "/brapi/v2/observationunits?page=1&pageSize=2",
)


def test_a_fleet_on_postgresql(database_url: str, tmp_path: Path) -> None:
    settings = Settings(data_folder=tmp_path, database_url=database_url)
    upgrade(settings.database)
    store, artifacts = open_store(settings.database), ArtifactStore(settings.artifacts)
    seed_fleet(store, artifacts, owner=LOCAL_OWNER, plants=3, scans=18, now=NOW)
    http = TestClient(create_app(settings, store, artifacts))
    for path in READS:
        assert http.get(path).status_code == 200, path
    cursor = http.get("/v1/plants?limit=2").json()["next_cursor"]
    assert len(http.get("/v1/plants", params={"limit": 2, "cursor": cursor}).json()["items"]) == 1
    leaf = next(one for one in http.get("/v1/tracks?plant=demo-001").json()["items"] if one["organ"] == "leaf_0")
    scan = http.get("/v1/plants/demo-001/history").json()["tracks"][0]["points"]["scan"][9]
    assert http.patch(f"/v1/tracks/{leaf['id']}", json={"name": "first"}).status_code == 200
    assert http.patch(f"/v1/tracks/{leaf['id']}", json={"confirm": {"scan": scan}}).status_code in (200, 404)
    record = {"records": [{"at": "2026-01-01T00:00:00Z", "mass_g": 1.5}]}
    for _ in range(2):
        assert http.post("/v1/environment", json=record).json() == {"stored": 1}
    schedule = {"plant": "demo-001", "cron": "0 6 * * *", "spec": {"source": {"kind": "clouds", "path": "x"}}}
    assert http.post("/v1/schedules", json=schedule).status_code == 201
    with store.read() as session:
        assert check(session, artifacts) == ()
    assert remove_fleet(store, owner=LOCAL_OWNER) == 3
    assert http.get("/v1/plants").json()["items"] == []
    store.close()
