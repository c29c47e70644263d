"""Plants, history, tracks and alarms over HTTP, on a small fleet that was seeded as scans would have left it."""

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from scanjobs.artifacts import ArtifactStore
from scanjobs.fleet.joining import join, touched_plants
from scanjobs.fleet.plants import get_plant
from scanjobs.fleet.seeding import remove_fleet, seed_fleet
from scanjobs.fsck import check
from scanjobs.migrate import upgrade
from scanjobs.scopes import LOCAL_OWNER
from scanjobs.settings import Settings
from scanjobs.store import open_store
from starlette.testclient import TestClient

from services.api.app import create_app
from tests.unit.api.service import Service, simulation

PLANTS, SCANS = 8, 22
NOW = 1_767_225_600.0
Json = dict[str, Any]


@pytest.fixture(scope="module")
def seeded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The data folder of a fleet, to be copied."""
    settings = Settings(data_folder=tmp_path_factory.mktemp("seeded"))
    upgrade(settings.database)
    store = open_store(settings.database)
    seed_fleet(store, ArtifactStore(settings.artifacts), owner=LOCAL_OWNER, plants=PLANTS, scans=SCANS, now=NOW)
    store.close()
    return settings.data_folder


@pytest.fixture
def fleet(seeded: Path, tmp_path: Path) -> Iterator[Service]:
    """A service that has the fleet."""
    folder = Path(shutil.copytree(seeded, tmp_path / "data"))
    settings = Settings(data_folder=folder)
    store, artifacts = open_store(settings.database), ArtifactStore(settings.artifacts)
    with TestClient(create_app(settings, store, artifacts), raise_server_exceptions=False) as http:
        yield Service(http=http, settings=settings, store=store, artifacts=artifacts, folder=tmp_path)
    store.close()


def get(service: Service, path: str, **query: Any) -> Json:
    answer = service.http.get(path, params=query)
    assert answer.status_code == 200, answer.text
    body: Json = answer.json()
    return body


def pages(service: Service, **query: Any) -> Iterator[Json]:
    cursor = None
    while True:
        page = get(service, "/v1/plants", **query, **({"cursor": cursor} if cursor else {}))
        yield from page["items"]
        cursor = page["next_cursor"]
        if cursor is None:
            return


def drifting(service: Service) -> Json:
    """The first drift alarm."""
    found: Json = get(service, "/v1/alarms", kind="drift")["items"][-1]
    return found


def test_a_seeded_fleet_is_sound_and_seeded_once(fleet: Service) -> None:
    again = seed_fleet(fleet.store, fleet.artifacts, owner=LOCAL_OWNER, plants=PLANTS, scans=SCANS, now=NOW)
    with fleet.store.read() as session:
        assert check(session, fleet.artifacts) == ()
    assert (again.plants, get(fleet, "/v1/fleet")["plants"]) == (0, PLANTS)
    assert remove_fleet(fleet.store, owner=LOCAL_OWNER) == PLANTS
    assert (get(fleet, "/v1/fleet")["plants"], fleet.rows()) == (0, 0)


def test_every_sort_lists_every_plant_once_in_order(fleet: Service) -> None:
    for sort in ("id", "-id", "name", "position", "-treatment", "last_scan", "frequency", "-ratio", "-alarms"):
        rows = list(pages(fleet, sort=sort, limit=3))
        assert len({row["id"] for row in rows}) == len(rows) == PLANTS, sort
        key = {"frequency": None, "last_scan": None}.get(sort.lstrip("-"), sort.lstrip("-"))
        if key is not None:
            values = [row[key].lower() if isinstance(row[key], str) else row[key] for row in rows]
            assert values == sorted(values, reverse=sort.startswith("-")), sort


def test_a_cursor_of_another_sort_is_refused(fleet: Service) -> None:
    cursor = get(fleet, "/v1/plants", limit=2)["next_cursor"]
    answer = fleet.http.get("/v1/plants", params={"sort": "-ratio", "cursor": cursor})
    assert (answer.status_code, answer.json()["code"]) == (422, "INVALID_CURSOR")


def test_filters_leave_what_they_name(fleet: Service) -> None:
    every = list(pages(fleet))
    for query, keeps in (
        ({"treatment": "drought"}, lambda row: row["treatment"] == "drought"),
        ({"tag": "bench-1"}, lambda row: "bench-1" in row["tags"]),
        ({"alarm": True}, lambda row: row["alarms"] > 0),
        ({"state": "failed"}, lambda row: row["last_scan"]["status"] == "failed"),
        ({"text": "Í 3"}, lambda row: row["name"] == "Açaí 3"),
        ({"text": "DEMO-00"}, lambda _: True),
        ({"text": "%"}, lambda _: False),
        ({"study": "nowhere"}, lambda _: False),
        ({"state": "none"}, lambda _: False),
    ):
        found = {row["id"] for row in pages(fleet, **query)}
        if query != {"text": "Í 3"}:  # SQLite lowers ASCII alone
            assert found == {row["id"] for row in every if keeps(row)}, query


def test_facets_count_what_the_filters_find(fleet: Service) -> None:
    facets = get(fleet, "/v1/fleet")
    for name, count in facets["treatments"].items():
        assert len(list(pages(fleet, treatment=name))) == count
    for name, count in facets["states"].items():
        assert len(list(pages(fleet, state=name))) == count
    assert facets["alarms"] == len(list(pages(fleet, alarm=True)))


def test_a_plant_is_made_changed_and_removed(service: Service) -> None:
    body = {"id": "fern-1", "name": "Fern", "tags": ["b", "a"], "reference": {"scans": 8}}
    made = service.http.post("/v1/plants", json=body)
    assert (made.status_code, made.headers["Location"], made.json()["tags"]) == (201, "/v1/plants/fern-1", ["a", "b"])
    assert service.http.post("/v1/plants", json=body).json()["code"] == "PLANT_EXISTS"
    changed = service.http.patch("/v1/plants/fern-1", json={"name": None, "treatment": "dry", "tags": ["c"]}).json()
    assert (changed["name"], changed["treatment"], changed["tags"]) == ("fern-1", "dry", ["c"])
    assert changed["reference"] == {"from": None, "until": None, "scans": 8}
    assert len(list(pages(service, tag="c"))) == 1
    assert service.http.delete("/v1/plants/fern-1").status_code == 204
    assert service.http.get("/v1/plants/fern-1").status_code == 404


def test_a_scan_that_names_a_plant_makes_it_and_is_followed(service: Service) -> None:
    scan = service.submit(simulation(plant={"id": "acai-7", "treatment": "dry", "position": "A3"}))
    [row] = pages(service)
    assert (row["id"], row["treatment"], row["scans"], row["last_scan"]["status"]) == ("acai-7", "dry", 1, "queued")
    service.http.post(f"/v1/scans/{scan['id']}/cancel")
    assert next(pages(service))["last_scan"]["status"] == "canceled"
    service.http.delete(f"/v1/scans/{scan['id']}")
    with service.store.read() as session:
        [key] = touched_plants(session)
    join(service.store, service.artifacts, key)
    assert (next(pages(service))["scans"], next(pages(service))["last_scan"]) == (0, None)


def test_history_has_columns_of_equal_length_and_every_mode(fleet: Service) -> None:
    plant = drifting(fleet)["plant"]
    history = get(fleet, f"/v1/plants/{plant}/history")
    points = 0
    for track in history["tracks"]:
        lengths = {len(column) for column in track["points"].values()}
        assert lengths == {track["scans"]}
        points += track["scans"]
    assert points + len(history["loose"]) == sum(scan["modes"] for scan in history["scans"])
    assert len(history["scans"]) == SCANS
    assert set(history["environment"]["columns"]) >= {"temperature_c", "soil_water_percent", "mass_g"}
    assert {chart["chart"] for chart in history["drift"]["charts"]} >= {"ewma", "cusum_up", "cusum_down"}
    assert any(event["kind"] == "watering" for event in history["events"])
    newest = get(fleet, f"/v1/plants/{plant}/history", max_points=3)
    assert [scan["id"] for scan in newest["scans"]] == [scan["id"] for scan in history["scans"][-3:]]


def test_an_alarm_is_acknowledged_and_closed_and_its_plant_counts_it(fleet: Service) -> None:
    alarm = drifting(fleet)
    where = f"/v1/alarms/{alarm['id']}"
    assert alarm["change_percent"] is not None
    assert alarm["delay_scans"] >= 1
    noted = fleet.http.patch(where, json={"state": "acknowledged", "note": "watered"}).json()
    assert (noted["state"], noted["note"]) == ("acknowledged", "watered")
    assert get(fleet, f"/v1/plants/{alarm['plant']}")["alarms"] >= 1
    closed = fleet.http.patch(where, json={"state": "closed"}).json()
    assert (closed["state"], closed["closed_by"]) == ("closed", "user")
    assert fleet.http.patch(where, json={"note": "late"}).status_code == 409
    assert get(fleet, f"/v1/plants/{alarm['plant']}")["alarms"] == 0
    kinds = [row["kind"] for row in get(fleet, "/v1/alarms", plant=alarm["plant"], state="open")["items"]]
    assert "drift" not in kinds


def test_a_merged_split_and_moved_track_stays_so_through_recomputation(fleet: Service) -> None:
    tracks = get(fleet, "/v1/tracks", plant="demo-001")["items"]
    leaf = next(track for track in tracks if track["organ"] == "leaf_0")
    where = f"/v1/tracks/{leaf['id']}"
    scans = points_of(fleet, "demo-001", leaf["id"])["scan"]
    halves = fleet.http.patch(where, json={"split_at": {"scan": scans[10]}}).json()["items"]
    made = next(track for track in halves if track["id"] not in {one["id"] for one in tracks})
    assert (points_of(fleet, "demo-001", leaf["id"])["scan"], made["scans"]) == (scans[:10], len(scans) - 10)
    recompute(fleet)
    assert points_of(fleet, "demo-001", made["id"])["scan"] == scans[10:]
    whole = fleet.http.patch(f"/v1/tracks/{made['id']}", json={"merge_into": leaf["id"]}).json()["items"]
    assert made["id"] not in {track["id"] for track in whole}
    assert points_of(fleet, "demo-001", leaf["id"])["scan"] == scans
    out = {"scan": scans[3], "organ": "leaf_0", "mode": points_of(fleet, "demo-001", leaf["id"])["mode"][3], "to": None}
    assert fleet.http.patch(where, json={"move": out}).status_code == 200
    recompute(fleet)
    assert points_of(fleet, "demo-001", leaf["id"])["scan"] == scans[:3] + scans[4:]


def test_two_modes_of_one_scan_do_not_meet_in_a_track(fleet: Service) -> None:
    first, second = get(fleet, "/v1/tracks", plant="demo-001")["items"][:2]
    answer = fleet.http.patch(f"/v1/tracks/{first['id']}", json={"merge_into": second["id"]})
    assert (answer.status_code, answer.json()["code"]) == (409, "TRACKS_MEET")


def test_a_track_is_called_what_a_person_says(fleet: Service) -> None:
    track = get(fleet, "/v1/tracks", plant="demo-001")["items"][0]
    fleet.http.patch(f"/v1/tracks/{track['id']}", json={"name": "first bending"})
    recompute(fleet)
    assert get(fleet, f"/v1/tracks/{track['id']}")["name"] == "first bending"
    assert fleet.http.patch(f"/v1/tracks/{track['id']}", json={}).status_code == 422


def test_environment_is_merged_read_as_csv_and_refused_by_line(service: Service) -> None:
    service.http.post("/v1/plants", json={"id": "p"})
    at = "2026-01-01T06:00:00Z"
    table = f"at,temperature_c,co2_ppm\n{at},21.5,410\n2026-01-01T07:00:00Z,22,\n"
    csv = {"Content-Type": "text/csv"}
    where = "/v1/plants/p/environment"
    assert service.http.post(where, content=table, headers=csv).json() == {"stored": 2}
    assert service.http.post(
        "/v1/environment", json={"records": [{"at": at, "temperature_c": 1, "mass_g": 5}]}
    ).is_success
    assert service.http.post(where, json={"records": [{"at": at, "humidity_percent": 60}]}).is_success
    series = get(service, where)
    assert series["columns"] == ["temperature_c", "humidity_percent", "mass_g", "co2_ppm"]
    assert series["values"]["temperature_c"] == [21.5, 22.0], "its own goes before the house's"
    assert series["values"]["mass_g"] == [5.0, None]
    bad = service.http.post(where, content=f"at,mass_g\n{at},heavy\n", headers=csv)
    assert (bad.status_code, "line 2" in bad.json()["detail"]) == (422, True)
    unknown = service.http.post("/v1/environment", content=f"at,plant,mass_g\n{at},q,1\n", headers=csv)
    assert unknown.status_code == 404
    assert service.http.post(where, content="x", headers={"Content-Type": "text/plain"}).status_code == 415


def test_unreadable_results_are_a_problem_of_their_scan_alone(service: Service) -> None:
    scan = service.submit(simulation(plant={"id": "p"}))["id"]
    service.give(scan, {"modes.json": b"{"})
    service.move(scan, state="succeeded")
    assert join(service.store, service.artifacts, key_of(service, "p"))
    assert get(service, "/v1/plants/p/history")["tracks"] == []


def key_of(service: Service, plant: str) -> str:
    with service.store.read() as session:
        return get_plant(session, plant, owner=LOCAL_OWNER).key


def points_of(service: Service, plant: str, track: str) -> Json:
    tracks = get(service, f"/v1/plants/{plant}/history")["tracks"]
    points: Json = next(one for one in tracks if one["id"] == track)["points"]
    return points


def recompute(service: Service) -> None:
    """Another way of watching computes tracks and charts afresh."""
    service.http.patch("/v1/plants/demo-001", json={"monitoring": {"false_alarms_per_year": 0.2}})


def test_work_is_the_same_twice(fleet: Service) -> None:
    before = get(fleet, "/v1/plants/demo-001/history")
    join(fleet.store, fleet.artifacts, key_of(fleet, "demo-001"))
    assert get(fleet, "/v1/plants/demo-001/history") == before
