"""Bad input is answered with the field and the remedy, as problem+json, and leaves nothing behind."""

import json
from pathlib import Path
from typing import Any

import pytest

from services.api.middleware import HIGHEST_BODY_BYTES
from tests.unit.api.service import Service, simulation

FIELDS = {"type", "title", "status", "detail", "instance", "code", "pointer", "hint", "request_id"}


def changed(path: str, value: Any) -> dict[str, Any]:
    """The small specification with one value put at a JSON pointer."""
    spec = json.loads(json.dumps(simulation()))
    *way, last = path.strip("/").split("/")
    at: Any = spec
    for part in way:
        at = at[int(part)] if isinstance(at, list) else at.setdefault(part, {})
    at[last] = value
    return spec  # type: ignore[no-any-return]


BAD = [
    ("/source/frams", 3, "frames"),
    ("/colour", 1, "keys here"),
    ("/source/frames", 0, "at least 1"),
    ("/source/frames", 10**9, "at most 100000"),
    ("/source/frame_rate_hz", 0, "at least 1e-06"),
    ("/source/motion/0/frequency_hz", 20, "frame_rate_hz >="),
    ("/source/motion/0/amplitude_m", "wide", "/v1/options"),
    ("/source/rig/width_px", 1, "at least 16"),
    ("/source/kind", "video", "simulation"),
    ("/name", "../../etc", "letters"),
    ("/reconstruction/voxel_m", -1, "above 0"),
    ("/plant", {"position": "x"}, "Add it"),
]


@pytest.mark.parametrize(("path", "value", "remedy"), BAD, ids=[f"{path}={value}" for path, value, _ in BAD])
def test_a_bad_field_is_named_with_its_remedy_and_nothing_is_stored(
    service: Service, path: str, value: Any, remedy: str
) -> None:
    answer = service.http.post("/v1/scans", json=changed(path, value))
    body = answer.json()
    assert answer.status_code == 422
    assert answer.headers["Content-Type"] == "application/problem+json"
    assert set(body) >= FIELDS
    assert (body["status"], body["code"], body["instance"]) == (422, "INVALID_SPEC", "/v1/scans")
    assert body["pointer"] == (path if path != "/plant" else "/plant/id")
    assert remedy in body["hint"]
    assert body["request_id"] == answer.headers["X-Request-Id"]
    assert service.rows() == 0


def test_every_complaint_is_listed(service: Service) -> None:
    spec = changed("/source/frames", 0) | {"colour": 1}
    body = service.http.post("/v1/scans", json=spec).json()
    assert {row["pointer"] for row in body["errors"]} == {"/source/frames", "/colour"}


@pytest.mark.parametrize("number", ["NaN", "Infinity", "-Infinity", "1e999"])
@pytest.mark.parametrize("field", ["learning_rate", "voxel_m"])
def test_a_number_that_is_none_is_refused(service: Service, number: str, field: str) -> None:
    text = json.dumps(simulation(reconstruction={field: 0.125})).replace("0.125", number)
    answer = service.http.post("/v1/scans", content=text, headers={"Content-Type": "application/json"})
    assert (answer.status_code, answer.json()["pointer"]) == (422, f"/reconstruction/{field}")
    assert service.rows() == 0


@pytest.mark.parametrize("content", ["", "{", "[]", "null", '"x"', "[" * 100_000, '{"source": ' + "9" * 5000 + "}"])
def test_what_is_no_specification_at_all_is_a_4xx(service: Service, content: str) -> None:
    answer = service.http.post("/v1/scans", content=content, headers={"Content-Type": "application/json"})
    assert answer.status_code in (400, 422)
    assert set(answer.json()) >= FIELDS
    assert service.rows() == 0


def test_half_a_surrogate_is_refused(service: Service) -> None:
    text = json.dumps(simulation(plant={"id": "a", "position": "SPOT"})).replace("SPOT", "\\ud800")
    answer = service.http.post("/v1/scans", content=text, headers={"Content-Type": "application/json"})
    assert (answer.status_code, answer.json()["pointer"]) == (422, "/plant/position")


@pytest.mark.parametrize(
    "path", ["..", "../secret", "/etc", "plants/../../secret", "missing", "link", "a\x00b", "~root"]
)
@pytest.mark.parametrize("kind", ["capture", "clouds"])
def test_a_path_outside_the_capture_roots_is_refused(service: Service, path: str, kind: str) -> None:
    (service.folder / "secret").mkdir()
    (service.folder / "captures" / "plants").mkdir()
    (service.folder / "captures" / "link").symlink_to(service.folder / "secret")
    answer = service.http.post("/v1/scans", json={"source": {"kind": kind, "path": path}})
    assert (answer.status_code, answer.json()["code"]) == (422, "SOURCE_OUTSIDE_ROOTS")
    assert answer.json()["pointer"] == "/source/path"
    assert "NERFMODAL_CAPTURE_ROOTS" in answer.json()["hint"]
    assert service.rows() == 0


def test_a_path_inside_is_taken_and_resolved(service: Service) -> None:
    inside = service.folder / "captures" / "fern"
    inside.mkdir()
    scan = service.submit({"source": {"kind": "capture", "path": "fern"}})
    assert Path(scan["spec"]["source"]["path"]) == inside.resolve()


@pytest.mark.parametrize("key", ["", "a b", "x" * 256, "ünï"])
def test_a_key_that_cannot_be_one_is_refused(service: Service, key: str) -> None:
    answer = service.http.post("/v1/scans", json=simulation(), headers={"Idempotency-Key": key.encode()})
    assert (answer.status_code, answer.json()["code"]) == (422, "INVALID_PARAMETER")
    assert "Idempotency-Key" in answer.json()["detail"]
    assert service.rows() == 0


def test_a_body_that_is_too_large_is_refused_before_it_is_parsed(service: Service) -> None:
    answer = service.http.post("/v1/scans", content=b" " * (HIGHEST_BODY_BYTES + 1))
    assert (answer.status_code, answer.json()["code"]) == (413, "BODY_TOO_LARGE")
    assert set(answer.json()) >= FIELDS


def test_a_body_that_hides_its_size_is_refused_too(service: Service) -> None:
    chunks = (b" " * 65536 for _ in range(HIGHEST_BODY_BYTES // 65536 + 2))
    answer = service.http.post("/v1/scans", content=chunks)
    assert answer.status_code == 413


@pytest.mark.parametrize(
    ("method", "path", "status", "code"),
    [("GET", "/v1/nothing", 404, "NOT_FOUND"), ("DELETE", "/v1/scans", 405, "METHOD_NOT_ALLOWED")],
)
def test_wrong_addresses_are_problems_too(service: Service, method: str, path: str, status: int, code: str) -> None:
    answer = service.http.request(method, path)
    assert (answer.status_code, answer.json()["code"]) == (status, code)
    assert set(answer.json()) >= FIELDS


def test_the_callers_request_id_comes_back_unless_it_could_do_harm(service: Service) -> None:
    assert service.http.get("/healthz", headers={"X-Request-Id": "abc-1"}).headers["X-Request-Id"] == "abc-1"
    assert service.http.get("/healthz", headers={"X-Request-Id": "a b<"}).headers["X-Request-Id"] != "a b<"


def test_what_nobody_foresaw_says_nothing_but_its_id(service: Service, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object, **__: object) -> None:
        raise RuntimeError("the password is 1234")

    monkeypatch.setattr("services.api.routes.scans.list_scans", broken)
    answer = service.http.get("/v1/scans")
    assert (answer.status_code, answer.json()["code"]) == (500, "INTERNAL")
    assert "1234" not in answer.text
    assert answer.json()["request_id"]
