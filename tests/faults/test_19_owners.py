"""Fault 19: owner B with A's ids on every route, wrong scope, revoked key, A's cursor.

The routes are those of the OpenAPI document, so a route that is added is tested with the next run. Everything of A
carries a word that must never reach B, and every row of A is compared before and after.
"""

import base64
import io
import json
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given
from hypothesis import settings as examples
from hypothesis import strategies as st
from nerfmodal.preflight.certified import FORMAT, VERSION, certificate_id
from PIL import Image
from scanjobs.account_tables import ApiKey, Capture, Upload, WebhookDelivery, WebhookEndpoint
from scanjobs.artifacts import ArtifactStore
from scanjobs.fanin import plant_next_chunk
from scanjobs.fleet.tables import Alarm, Plant, PlantEvent, Schedule, Track
from scanjobs.log_lines import append_lines
from scanjobs.migrate import upgrade
from scanjobs.owners import issue_key, revoke_key
from scanjobs.scopes import Scope
from scanjobs.settings import Settings
from scanjobs.store import Store, open_store
from scanjobs.tables import Artifact, ArtifactRef, Scan, Step
from sqlalchemy import insert, inspect, select, update
from starlette.testclient import TestClient

from services.api.app import create_app
from services.api.doorkeeper import is_guarded
from tests.unit.api.service import simulation

CANARY = "canary"
PLANT = "plant-of-a"
"""Its id, which whoever asks for it says himself."""
NAME = {"a": CANARY, "b": "b"}
OPERATORS = "/v1/workers"
"""Of nobody but the owner `local`, whatever the scopes: tests/unit/api/test_pausing.py."""
STREAMS = ("/v1/events", "/v1/scans/{scan_id}/events")
TUS = {"Tus-Resumable": "1.0.0", "Upload-Offset": "0", "Upload-Length": "3"}
BYTES = "application/offset+octet-stream"
WEBHOOK = {"url": "https://93.184.216.34/hook", "description": CANARY}
ROWS = (Scan, Step, Upload, Capture, ApiKey, WebhookEndpoint, WebhookDelivery, Track, Alarm, Schedule, PlantEvent)


@dataclass
class House:
    """A service, what A has in it, and the keys of others."""

    http: TestClient
    store: Store
    ids: dict[str, str]
    keys: dict[str, str]
    cursors: dict[str, str]
    operations: list[tuple[str, str]]
    before: str
    steps: list[str]

    def rows_of_a(self) -> str:
        """Every row of A, as text."""
        with self.store.read() as session:
            found = [
                {column.key: getattr(row, column.key) for column in inspect(entity).columns}
                for entity in ROWS
                for row in session.scalars(select(entity).where(inspect(entity).primary_key[0].in_(self.of_a(entity))))
            ]
        for row in found:
            row.pop("last_used_at", None)
        return json.dumps(found, default=str, sort_keys=True)

    def of_a(self, entity: Any) -> list[str]:
        """Ids of A's rows in a table."""
        return [value for value in self.ids.values() if value] if entity is not Step else self.steps


def bearer(secret: str) -> dict[str, str]:
    return {"Authorization": f"Bearer {secret}"}


@pytest.fixture(scope="module")
def house(tmp_path_factory: pytest.TempPathFactory) -> Iterator[House]:
    folder = tmp_path_factory.mktemp("house")
    settings = Settings(data_folder=folder / "data", keyless=False, webhooks_to_private_addresses=False)
    upgrade(settings.database)
    store = open_store(settings.database)
    app = create_app(settings, store, ArtifactStore(settings.artifacts))
    http = TestClient(app)
    keys = keys_of(store)
    mine = bearer(keys["a"])
    ids, cursors, steps = belongings(http, store, ArtifactStore(settings.artifacts), mine, folder)
    paths = http.get("/openapi.json").json()["paths"]
    operations = [(method.upper(), path) for path in paths if is_guarded(path) for method in paths[path]]
    made = House(http, store, ids, keys, cursors, operations, "", steps)
    made.before = made.rows_of_a()
    yield made
    store.close()


def keys_of(store: Store) -> dict[str, str]:
    def issue(owner: str, *scopes: Scope, **values: Any) -> Any:
        return store.write(lambda session: issue_key(session, owner=owner, name=NAME[owner], scopes=scopes, **values))

    dead = issue("b", Scope.ADMIN)
    store.write(lambda session: revoke_key(session, dead.key.id, owner="b"))
    expired = issue("b", Scope.ADMIN, expires_in_s=60.0)
    store.write(
        lambda session: session.execute(update(ApiKey).where(ApiKey.id == expired.key.id).values(expires_at=1.0))
    )
    return {
        "a": issue("a", Scope.ADMIN, requests_per_minute=10**6).secret,
        "read": issue("b", Scope.READ, requests_per_minute=10**6).secret,
        "submit": issue("b", Scope.SUBMIT, requests_per_minute=10**6).secret,
        "admin": issue("b", Scope.ADMIN, requests_per_minute=10**6).secret,
        "revoked": dead.secret,
        "expired": expired.secret,
    }


def belongings(
    http: TestClient, store: Store, artifacts: ArtifactStore, mine: dict[str, str], folder: Path
) -> tuple[dict[str, str], dict[str, str], list[str]]:
    """One of everything that one can have, and a cursor of every list."""
    spec = simulation(name=CANARY, plant={"id": PLANT, "position": CANARY}, tags=[CANARY])
    scans = [http.post("/v1/scans", json=spec, headers=mine).json()["id"] for _ in range(2)]
    while store.write(partial(plant_next_chunk, scan_id=scans[0])):
        continue
    with store.read() as session:
        steps = list(session.scalars(select(Step.id).where(Step.scan_id == scans[0])))
    give_modes(store, artifacts, scans[0], folder)
    line = {"scan_id": scans[0], "step_id": steps[0], "token": 1, "level": "info", "lines": [CANARY]}
    store.write(lambda session: append_lines(session, **line))
    uploads = [upload(http, mine) for _ in range(3)]
    captures = [capture(http, mine, uploads.pop())]
    hooks = [http.post("/v1/webhooks", json=WEBHOOK, headers=mine).json()["id"]]
    deliveries = [http.post(f"/v1/webhooks/{hooks[0]}/test", headers=mine).json()["id"] for _ in range(2)]
    key = http.post("/v1/keys", json={"name": CANARY}, headers=mine).json()["id"]
    lists = {"scans": "/v1/scans", "steps": f"/v1/scans/{scans[0]}/steps", "uploads": "/v1/uploads"}
    lists["deliveries"] = f"/v1/webhooks/{hooks[0]}/deliveries"
    cursors = {
        name: http.get(path, params={"limit": 1}, headers=mine).json()["next_cursor"] for name, path in lists.items()
    }
    assert all(cursors.values())
    ids = {
        "scan_id": scans[0],
        "upload_id": uploads[0],
        "capture_id": captures[0],
        "webhook_id": hooks[0],
        "delivery_id": deliveries[0],
        "key_id": key,
        "rig_id": certificate(http, mine),
        **watched(http, store, mine),
    }
    return ids, cursors, steps


def watched(http: TestClient, store: Store, mine: dict[str, str]) -> dict[str, str]:
    """A plant with something of everything that a plant has; its scans have made it."""
    where = f"/v1/plants/{PLANT}"
    http.patch(where, json={"name": CANARY, "treatment": CANARY, "tags": [CANARY], "study": CANARY}, headers=mine)
    event = http.post(f"{where}/events", json={"kind": "note", "note": CANARY}, headers=mine).json()["id"]
    record = {"at": "2026-01-01T06:00:00Z", "values": {CANARY: 1}}
    assert http.post(f"{where}/environment", json={"records": [record]}, headers=mine).is_success
    assert http.post("/v1/environment", json={"records": [record]}, headers=mine).is_success
    body = {"plant": PLANT, "every_hours": 8000, "spec": simulation(name=CANARY)}
    schedule = http.post("/v1/schedules", json=body, headers=mine).json()["id"]
    track, alarm = "0190c0de-0000-7000-8000-00000000000a", "0190c0de-0000-7000-8000-00000000000b"
    evidence = dict.fromkeys(("since", "detected_at", "delay_scans", "delay_s", "since_scan", "detected_scan"))
    evidence |= dict.fromkeys(("change_percent", "change_percent_std", "confidence", "recovered_at"))
    evidence |= {"title": CANARY, "what": CANARY, "charts": [], "tracks": [track]}

    def work(session: Any) -> None:
        key = session.scalars(select(Plant.key).where(Plant.id == PLANT, Plant.owner == "a")).one()
        seen = {"born_at": 1.0, "last_seen_at": 1.0, "scans": 1, "missed": 0, "doubtful_links": 0}
        values = {"id": track, "plant_key": key, "number": 1, "organ": CANARY, "active": True, "frequency_hz": 1.0}
        session.execute(insert(Track).values(values | seen))
        row = {"id": alarm, "owner": "a", "plant_key": key, "kind": "drift", "severity": "notice", "state": "open"}
        session.execute(insert(Alarm).values(row | {"evidence": evidence, "opened_at": 1.0, "note": CANARY}))

    store.write(work)
    ids = {"plant_id": PLANT, "track_id": track, "alarm_id": alarm}
    return ids | {"event_id": event, "schedule_id": schedule}


def give_modes(store: Store, artifacts: ArtifactStore, scan: str, folder: Path) -> None:
    """Let the scan have a result."""
    path = folder / "modes.json"
    path.write_text(json.dumps({"organs": [{"name": CANARY, "modes": []}]}))
    stored = artifacts.put(path)

    def work(session: Any) -> None:
        step = session.scalars(select(Step.id).where(Step.scan_id == scan, Step.kind == "scan.identify")).one()
        values = {"digest": stored.digest, "size": stored.size, "media_type": "application/json"}
        session.execute(insert(Artifact).values(values | {"state": "stored", "created_at": 0.0}))
        role = {"step_id": step, "role": "modes.json", "name": "modes.json", "digest": stored.digest}
        session.execute(insert(ArtifactRef).values(role))

    store.write(work)


def upload(http: TestClient, headers: dict[str, str]) -> str:
    buffer = io.BytesIO()
    Image.new("RGB", (8, 8)).save(buffer, "PNG")
    name = base64.b64encode(f"{CANARY}.png".encode()).decode()
    sent = headers | TUS | {"Upload-Length": str(len(buffer.getvalue())), "Content-Type": BYTES}
    answer = http.post("/v1/uploads", headers=sent | {"Upload-Metadata": f"filename {name}"}, content=buffer.getvalue())
    return str(answer.headers["Location"].rsplit("/", 1)[1])


def capture(http: TestClient, headers: dict[str, str], upload_id: str) -> str:
    body = {"name": CANARY, "files": [{"upload": upload_id, "name": f"{CANARY}.png"}]}
    answer = http.post("/v1/captures", json=body, headers=headers)
    assert answer.status_code == 201, answer.text
    return str(answer.json()["id"])


def certificate(http: TestClient, headers: dict[str, str]) -> str:
    """The rig of a certificate."""
    content = {
        "format": FORMAT,
        "format_version": VERSION,
        "rig_digest": "ab" * 32,
        "cameras": [],
        "frame_rate_hz": 9.0,
    }
    content["remark"] = CANARY
    answer = http.post("/v1/rigs", json=content | {"id": certificate_id(content)}, headers=headers)
    assert answer.status_code == 201, answer.text
    return str(answer.json()["rig"])


def scope_of(method: str, path: str) -> Scope:
    """What a route needs."""
    if path.startswith("/v1/keys"):
        return Scope.ADMIN
    if path == "/v1/preflight":  # asks, and stores nothing
        return Scope.READ
    return Scope.READ if method in ("GET", "HEAD", "OPTIONS") else Scope.SUBMIT


def ask(house: House, key: str | None, method: str, path: str, ids: dict[str, str]) -> Any:
    """A request that is right but for whose it is."""
    where = path.replace("{name}", "modes.json").replace("{k}", "0").replace("{frame}", "0")
    for name, value in ids.items():
        where = where.replace(f"{{{name}}}", value)
    bodies: dict[str, Any] = {
        "/v1/scans": simulation(),
        "/v1/keys": {"name": "b"},
        "/v1/webhooks": WEBHOOK | {"description": "b"},
        "/v1/captures": {"files": [{"upload": ids["upload_id"]}]},
        "/v1/plants": {"id": "b"},
        "/v1/plants/{plant_id}/events": {"kind": "note"},
        "/v1/plants/{plant_id}/environment": {"records": []},
        "/v1/environment": {"records": []},
        "/v1/tracks/{track_id}": {"name": "b"},
        "/v1/schedules": {"plant": ids["plant_id"], "every_hours": 8000, "spec": simulation()},
    }
    where += f"?plant={ids['plant_id']}" if path == "/v1/tracks" else ""
    headers = (bearer(house.keys[key]) if key else {}) | TUS
    if "uploads" in path and method == "PATCH":
        return house.http.patch(where, headers=headers | {"Content-Type": BYTES}, content=b"xyz")
    return house.http.request(method, where, headers=headers, json=bodies.get(path, {}))


def test_the_owner_himself_is_let_in(house: House) -> None:
    """So that a 404 for B says whose it is, not that nothing is there."""
    for method, path in house.operations:
        if method == "GET" and path not in STREAMS and "shape" not in path and "frames/" not in path:
            expected = 403 if path.startswith(OPERATORS) else 200
            assert ask(house, "a", method, path, house.ids).status_code == expected, path


WHOSE = st.sampled_from(["read", "submit", "admin", "revoked", "expired", None])


@given(data=st.data(), key=WHOSE, swap=st.booleans())
@examples(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.too_slow])
def test_nothing_of_a_reaches_b_whatever_b_asks(house: House, data: st.DataObject, key: str | None, swap: bool) -> None:
    """In any order, and with an id of another kind in the place of the scan's.

    Guards: those of the next test. Seen to fail: without `owner` in `get_scan`, without the question for the scope,
    and with wrong keys let in.
    """
    operations = [(method, path) for method, path in house.operations if path not in STREAMS]  # they would not end
    method, path = data.draw(st.sampled_from(operations))
    check(house, key, method, path, house.ids | ({"scan_id": house.ids["upload_id"]} if swap else {}))


@pytest.mark.parametrize("key", ["read", "submit", "admin", "revoked", "expired", None])
def test_every_route_with_every_key(house: House, key: str | None) -> None:
    """Guards: `owner` in every query, `Doorkeeper`, `owner_who_may`.

    Seen to fail: without `owner` in `get_scan` A's scan is told to B; with wrong keys let in as the local owner they
    submit scans; without the question for the scope a `read` key does.
    """
    for method, path in house.operations:
        check(house, key, method, path, house.ids)
    assert house.rows_of_a() == house.before


def check(house: House, key: str | None, method: str, path: str, ids: dict[str, str]) -> None:
    if path in STREAMS and key in ("read", "submit", "admin") and "{" not in path:
        return  # a stream of B's own, without end: tests/unit/api/test_events.py
    answer = ask(house, key, method, path, ids)
    assert CANARY not in answer.text
    if key in ("revoked", "expired", None):
        assert answer.status_code in (401, 429), (method, path)
    elif path.startswith(OPERATORS) or not may(Scope(key), scope_of(method, path)):
        assert answer.status_code == 403, (method, path)
    elif "{" in path:
        assert answer.status_code == 404, (method, path, answer.text)
    else:
        assert answer.status_code < 500, (method, path, answer.text)


def may(given_scope: Scope, needed: Scope) -> bool:
    order = list(Scope)
    return order.index(given_scope) >= order.index(needed)


@pytest.mark.parametrize("name", ["scans", "uploads"])
def test_a_cursor_of_a_is_no_cursor_of_b(house: House, name: str) -> None:
    """Guard: the owner in `Cursors._mac`. Seen to fail: without it B is given a page."""
    params = {"cursor": house.cursors[name]}
    answer = house.http.get(f"/v1/{name}", params=params, headers=bearer(house.keys["admin"]))
    assert (answer.status_code, answer.json()["code"]) == (422, "INVALID_CURSOR")
    assert house.http.get(f"/v1/{name}", params=params, headers=bearer(house.keys["a"])).status_code == 200


@given(data=st.data())
@examples(max_examples=60, deadline=None)
def test_a_cursor_that_was_changed_is_none(house: House, data: st.DataObject) -> None:
    """Guard: the comparison in `Cursors.read`. Seen to fail: without it changed cursors are read."""
    cursor = house.cursors["scans"]
    at = data.draw(st.integers(0, len(cursor) - 2))  # the last character has bits that say nothing
    other = data.draw(st.sampled_from("ABCDabcd0123-_").filter(lambda char: char != cursor[at]))
    changed = cursor[:at] + other + cursor[at + 1 :]
    answer = house.http.get("/v1/scans", params={"cursor": changed}, headers=bearer(house.keys["a"]))
    assert (answer.status_code, answer.json()["code"]) == (422, "INVALID_CURSOR")


def test_a_capture_of_a_is_no_source_of_b(house: House) -> None:
    """Guard: the owner in `locate_source`; neither by its id nor by its folder.

    Seen to fail: with A as the owner whoever asks, B's scan is taken.
    """
    folder = house.http.get(f"/v1/captures/{house.ids['capture_id']}", headers=bearer(house.keys["a"])).json()
    for path in (folder["source"]["path"], f"{house_captures(house)}/{house.ids['capture_id']}"):
        body = {"source": {"kind": "capture", "path": path}}
        answer = house.http.post("/v1/scans", json=body, headers=bearer(house.keys["admin"]))
        assert (answer.status_code, answer.json()["pointer"]) == (422, "/source/path")
        assert house.http.post("/v1/scans", json=body, headers=bearer(house.keys["a"])).status_code == 202


def house_captures(house: House) -> Path:
    settings: Settings = house.http.app.state.parts.settings  # type: ignore[attr-defined]
    return settings.captures
