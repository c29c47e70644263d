"""API keys: shown once, hashed, scoped, rotated, expired and revoked; rates; and who needs none."""

import logging

import pytest
from scanjobs.account_tables import ApiKey
from scanjobs.scopes import Scope
from sqlalchemy import update
from starlette.testclient import TestClient

from services.api.app import create_app
from services.api.doorkeeper import is_guarded
from services.api.rates import Rates
from tests.unit.api.service import Service, simulation


def bearer(secret: str) -> dict[str, str]:
    return {"Authorization": f"Bearer {secret}"}


def test_without_a_key_nothing_of_the_api_answers(service: Service) -> None:
    http = service.locked()
    paths = service.http.get("/openapi.json").json()["paths"]
    guarded = [(method, path) for path, methods in paths.items() if is_guarded(path) for method in methods]
    assert len(guarded) > 10
    for method, path in guarded:
        answer = http.request(method.upper(), path)
        assert answer.status_code == 401, (method, path)
        assert answer.headers["WWW-Authenticate"].startswith("Bearer")
        assert method == "head" or answer.json()["code"] == "UNAUTHORIZED"
    assert http.get("/healthz").status_code == 200


@pytest.mark.parametrize("header", ["", "Bearer", "Bearer ", "Bearer nm_x", "Basic YTpi", "nm_" + "a" * 43])
def test_what_is_no_key_is_refused_even_where_none_is_needed(service: Service, header: str) -> None:
    assert service.http.get("/v1/scans", headers={"Authorization": header}).status_code == 401


def test_a_key_in_the_address_counts_for_nothing(service: Service) -> None:
    secret = service.key("a")
    for name in ("key", "access_token", "token", "authorization"):
        assert service.locked().get("/v1/scans", params={name: secret}).status_code == 401


@pytest.mark.parametrize(
    ("scope", "allowed"),
    [(Scope.READ, (200, 403, 403)), (Scope.SUBMIT, (200, 202, 403)), (Scope.ADMIN, (200, 202, 200))],
)
def test_scopes_open_what_they_say(service: Service, scope: Scope, allowed: tuple[int, ...]) -> None:
    http, headers = service.locked(), bearer(service.key("a", scope))
    answers = (
        http.get("/v1/scans", headers=headers),
        http.post("/v1/scans", json=simulation(), headers=headers),
        http.get("/v1/keys", headers=headers),
    )
    assert tuple(answer.status_code for answer in answers) == allowed


def test_a_secret_is_shown_once_and_never_stored_or_logged(service: Service, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.DEBUG)
    made = service.http.post("/v1/keys", json={"name": "notebook"})
    secret = made.json()["secret"]
    assert made.status_code == 201
    assert secret.startswith("nm_")
    listed = service.http.get("/v1/keys").text
    shown = service.http.get(made.headers["Location"])
    assert shown.json()["name"] == "notebook"
    assert service.http.get("/v1/scans", headers=bearer(secret)).status_code == 200
    assert secret not in listed + shown.text + caplog.text
    files = [path for path in service.folder.rglob("*") if path.is_file()]
    assert not any(secret.encode() in path.read_bytes() for path in files)


def test_a_revoked_key_is_refused_at_once(service: Service) -> None:
    made = service.http.post("/v1/keys", json={"name": "k"}).json()
    assert service.http.get("/v1/scans", headers=bearer(made["secret"])).status_code == 200
    for _ in range(2):
        assert service.http.delete(f"/v1/keys/{made['id']}").json()["revoked_at"] is not None
    assert service.http.get("/v1/scans", headers=bearer(made["secret"])).status_code == 401


def test_an_expired_key_is_refused(service: Service) -> None:
    secret = service.key("a", expires_in_s=3600.0)
    assert service.locked().get("/v1/scans", headers=bearer(secret)).status_code == 200
    service.store.write(lambda session: session.execute(update(ApiKey).values(expires_at=ApiKey.created_at - 1)))
    assert service.locked().get("/v1/scans", headers=bearer(secret)).status_code == 401


def test_rotation_gives_the_same_rights_and_lets_the_old_key_go_on_for_a_while(service: Service) -> None:
    old = service.http.post("/v1/keys", json={"name": "k", "scopes": ["read"], "requests_per_minute": 77}).json()
    new = service.http.post(f"/v1/keys/{old['id']}/rotate", json={"grace_s": 3600}).json()
    assert (new["scopes"], new["requests_per_minute"], new["name"]) == (["read"], 77, "k")
    for secret in (old["secret"], new["secret"]):
        assert service.locked().get("/v1/scans", headers=bearer(secret)).status_code == 200
    again = service.http.post(f"/v1/keys/{old['id']}/rotate", json={})
    assert (again.status_code, again.json()["code"]) == (409, "ILLEGAL_TRANSITION")
    last = service.http.post(f"/v1/keys/{new['id']}/rotate", json={"grace_s": 0}).json()
    assert service.locked().get("/v1/scans", headers=bearer(new["secret"])).status_code == 401
    assert service.locked().get("/v1/scans", headers=bearer(last["secret"])).status_code == 200


def test_the_last_use_is_noted(service: Service) -> None:
    secret = service.key("a")
    service.locked().get("/v1/keys", headers=bearer(secret))
    [row] = service.locked().get("/v1/keys", headers=bearer(secret)).json()["items"]
    assert row["last_used_at"] is not None


def test_too_many_requests_are_told_when_to_go_on(service: Service) -> None:
    http, headers = service.locked(), bearer(service.key("a", requests_per_minute=1))
    assert http.get("/v1/presets", headers=headers).status_code == 200
    refused = http.get("/v1/presets", headers=headers)
    assert (refused.status_code, refused.json()["code"]) == (429, "TOO_MANY_REQUESTS")
    assert 30 < int(refused.headers["Retry-After"]) <= 60
    other = bearer(service.key("a"))
    assert http.get("/v1/presets", headers=other).status_code == 200


def test_a_bucket_grants_its_rate_and_no_more() -> None:
    now = [0.0]
    rates = Rates(lambda: now[0])
    granted = 0
    for _ in range(60_000):  # ten minutes, a hundred requests a second
        granted += rates.wait_s("k", 120) == 0
        now[0] += 0.01
    assert granted == pytest.approx(120 * 10 + 20, abs=1)
    wait_s = rates.wait_s("k", 120)
    now[0] += wait_s * 1.001
    assert rates.wait_s("k", 120) == 0


def test_wrong_keys_are_slowed_down(service: Service) -> None:
    http = service.locked()
    answers = [http.get("/v1/scans", headers=bearer("nm_" + "a" * 43)) for _ in range(40)]
    assert [answer.status_code for answer in answers[:10]] == [401] * 10
    assert "too many wrong keys" in next(answer.json()["detail"] for answer in answers if answer.status_code == 429)


@pytest.mark.parametrize(
    ("client", "headers", "status"),
    [
        ("127.0.0.1", {}, 200),
        ("::1", {}, 200),
        ("192.168.1.7", {}, 401),
        ("8.8.8.8", {}, 401),
        ("127.0.0.1", {"X-Forwarded-For": "127.0.0.1"}, 401),
        ("127.0.0.1", {"Forwarded": "for=8.8.8.8"}, 401),
        ("127.0.0.1", {"Origin": "https://evil.example"}, 401),
        ("127.0.0.1", {"Origin": "null"}, 401),
        ("127.0.0.1", {"Origin": "http://testserver"}, 200),
    ],
)
def test_only_a_caller_on_this_machine_needs_no_key(
    service: Service, client: str, headers: dict[str, str], status: int
) -> None:
    app = create_app(service.settings, service.store, service.artifacts)
    assert TestClient(app, client=(client, 5)).get("/v1/scans", headers=headers).status_code == status


@pytest.mark.parametrize(
    "body",
    [{}, {"name": ""}, {"name": "k", "scopes": []}, {"name": "k", "scopes": ["root"]}, {"name": "k", "colour": 1},
     {"name": "k", "expires_in_s": -1}, {"name": "\ud800"}, {"name": "k", "expires_in_s": 1e999}],
)  # fmt: skip
def test_a_key_that_makes_no_sense_is_not_made(service: Service, body: dict[str, object]) -> None:
    import json

    content = json.dumps(body)
    answer = service.http.post("/v1/keys", content=content, headers={"Content-Type": "application/json"})
    assert answer.status_code == 422
    assert answer.json()["pointer"] is not None
    assert service.http.get("/v1/keys").json()["items"] == []


def test_answers_carry_the_headers_that_keep_browsers_careful(service: Service) -> None:
    headers = service.http.get("/v1/scans").headers
    assert headers["X-Content-Type-Options"] == "nosniff"
    assert headers["X-Frame-Options"] == "DENY"
    assert headers["Content-Security-Policy"].startswith("default-src 'none'")
    assert headers["Cache-Control"] == "no-store"
    assert "Strict-Transport-Security" not in headers
