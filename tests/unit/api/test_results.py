"""Modes, shapes and files of a scan, served from the artifact store."""

import hashlib
import io
import json
import re

import numpy as np
import pytest
from starlette.testclient import TestClient

from services.api.app import create_app
from services.api.routes.modes import thin
from tests.unit.api.service import Service, simulation

SENSORS = 50
POSITIONS = np.arange(SENSORS * 3).reshape(SENSORS, 3) / 100
SHAPE = np.linspace(-1, 1, SENSORS)[:, None]
REPORT = bytes(range(256)) * 20


def npz() -> bytes:
    buffer = io.BytesIO()
    np.savez(buffer, positions=POSITIONS, shape=SHAPE, directions=np.array([[0.0, 0.0, 1.0]]))
    return buffer.getvalue()


def document() -> bytes:
    def mode(frequency: float, shape: str | None) -> dict[str, object]:
        return {"natural_frequency_hz": frequency, "shape": shape, "verdict": "accepted"}

    leaf = {"name": "leaf_0", "modes": [mode(2.0, "shapes/leaf_0_0.npz"), mode(5.0, None)]}
    trunk = {"name": "trunk", "modes": [mode(1.0, "shapes/trunk_0.npz")]}
    return json.dumps({"frame_rate_hz": 30, "organs": [leaf, trunk]}).encode()


@pytest.fixture
def scan(service: Service) -> str:
    """A scan whose steps have made files."""
    made: str = service.submit()["id"]
    files = {"modes.json": document(), "shapes/leaf_0_0.npz": npz(), "shapes/trunk_0.npz": npz(), "report.html": REPORT}
    service.give(made, files)
    service.give(made, {"frame": b"zip", "truth": b"truth"}, kind="frame.render", frame=0)
    service.give(made, {"checkpoint": b"first"}, kind="frame.train", frame=-1)
    service.give(made, {"checkpoint": b"zero"}, kind="frame.train", frame=0)
    service.give(made, {"cloud": b"ply"}, kind="frame.extract", frame=2)
    return made


def test_modes_are_the_document_byte_for_byte(service: Service, scan: str) -> None:
    answer = service.http.get(f"/v1/scans/{scan}/modes")
    assert (answer.content, answer.headers["Content-Type"]) == (document(), "application/json")


def test_modes_of_an_unfinished_scan_say_to_wait(service: Service) -> None:
    answer = service.http.get(f"/v1/scans/{service.submit()['id']}/modes")
    assert (answer.status_code, answer.json()["code"]) == (404, "NOT_FOUND")
    assert "Wait" in answer.json()["hint"]


def test_a_shape_as_json_and_as_npz_is_the_same(service: Service, scan: str) -> None:
    text = service.http.get(f"/v1/scans/{scan}/modes/0/shape").json()
    binary = service.http.get(f"/v1/scans/{scan}/modes/0/shape?format=npz")
    arrays = np.load(io.BytesIO(binary.content))
    np.testing.assert_allclose(arrays["positions"], POSITIONS)
    np.testing.assert_allclose(text["positions_m"], POSITIONS, atol=1e-6)
    np.testing.assert_allclose(text["shape"], SHAPE, atol=1e-6)
    assert (text["organ"], text["natural_frequency_hz"], text["directions"]) == ("leaf_0", 2.0, [[0.0, 0.0, 1.0]])


def test_modes_are_counted_through_all_organs_or_within_one(service: Service, scan: str) -> None:
    through = service.http.get(f"/v1/scans/{scan}/modes/2/shape").json()
    within = service.http.get(f"/v1/scans/{scan}/modes/0/shape?organ=trunk").json()
    assert through == within
    assert through["organ"] == "trunk"


@pytest.mark.parametrize("path", ["1/shape", "3/shape", "2/shape?organ=leaf_0", "0/shape?organ=fern"])
def test_a_shape_that_is_not_there_is_404(service: Service, scan: str, path: str) -> None:
    answer = service.http.get(f"/v1/scans/{scan}/modes/{path}")
    assert (answer.status_code, answer.json()["code"]) == (404, "NOT_FOUND")


@pytest.mark.parametrize("path", ["x/shape", "-1/shape", "0/shape?format=stl", "0/shape?max_points=0"])
def test_a_bad_parameter_is_422(service: Service, scan: str, path: str) -> None:
    assert service.http.get(f"/v1/scans/{scan}/modes/{path}").status_code == 422


@pytest.mark.parametrize("most", [1, 2, 7, 50, 999])
def test_thinning_keeps_sensor_and_value_together(most: int) -> None:
    arrays = thin({"positions": POSITIONS, "shape": SHAPE, "directions": np.eye(3)}, most)
    assert len(arrays["positions"]) == len(arrays["shape"]) == min(most, SENSORS)
    for position, value in zip(arrays["positions"], arrays["shape"], strict=True):
        sensor = int(np.flatnonzero((position == POSITIONS).all(axis=1))[0])
        assert value == SHAPE[sensor]
    assert len(arrays["directions"]) == 3


def test_files_are_listed_with_names_that_differ(service: Service, scan: str) -> None:
    items = service.http.get(f"/v1/scans/{scan}/artifacts").json()["items"]
    names = [item["name"] for item in items]
    assert len(set(names)) == len(names)
    assert set(names) >= {"modes.json", "report.html", "shapes/leaf_0_0.npz"}
    assert {name.split(".")[0] for name in names} >= {
        "truth",
        "frames/frame_0000",
        "checkpoints/first",
        "checkpoints/frame_0000",
        "clouds/frame_0002",
    }


def test_every_listed_file_is_served_with_the_listed_digest(service: Service, scan: str) -> None:
    for item in service.http.get(f"/v1/scans/{scan}/artifacts").json()["items"]:
        answer = service.http.get(f"/v1/scans/{scan}/artifacts/{item['name']}")
        assert answer.status_code == 200
        assert hashlib.sha256(answer.content).hexdigest() == item["sha256"]
        assert answer.headers["ETag"] == f'"{item["sha256"]}"'
        assert len(answer.content) == item["size"]


@pytest.mark.parametrize(
    ("range_", "first", "last"),
    [("bytes=0-9", 0, 9), ("bytes=5000-", 5000, 5119), ("bytes=-20", 5100, 5119), ("bytes=10-99999", 10, 5119)],
)
def test_ranges(service: Service, scan: str, range_: str, first: int, last: int) -> None:
    answer = service.http.get(f"/v1/scans/{scan}/artifacts/report.html", headers={"Range": range_})
    assert answer.status_code == 206
    assert answer.content == REPORT[first : last + 1]
    assert answer.headers["Content-Range"] == f"bytes {first}-{last}/{len(REPORT)}"


def test_a_range_behind_the_end_is_416(service: Service, scan: str) -> None:
    answer = service.http.get(f"/v1/scans/{scan}/artifacts/report.html", headers={"Range": "bytes=99999-"})
    assert (answer.status_code, answer.json()["code"]) == (416, "RANGE_NOT_SATISFIABLE")
    assert answer.headers["Content-Range"] == f"bytes */{len(REPORT)}"


def test_a_range_of_another_version_gives_the_whole_file(service: Service, scan: str) -> None:
    headers = {"Range": "bytes=10-19", "If-Range": '"other"'}
    answer = service.http.get(f"/v1/scans/{scan}/artifacts/report.html", headers=headers)
    assert (answer.status_code, answer.content) == (200, REPORT)


@pytest.mark.parametrize("name", ["nothing", "../../nerfmodal.db", "%2e%2e%2fnerfmodal.db", "/etc/passwd", "shapes"])
def test_a_name_that_no_step_made_is_404(service: Service, scan: str, name: str) -> None:
    assert service.http.get(f"/v1/scans/{scan}/artifacts/{name}").status_code == 404


def test_a_rotten_file_is_an_error_not_an_answer(service: Service, scan: str) -> None:
    digest = hashlib.sha256(REPORT).hexdigest()
    path = service.artifacts.place(digest)
    path.chmod(0o644)
    path.write_bytes(REPORT[::-1])
    answer = service.http.get(f"/v1/scans/{scan}/artifacts/report.html")
    assert (answer.status_code, answer.json()["code"]) == (500, "ARTIFACT_DAMAGED")


def test_a_page_from_a_scan_is_sandboxed(service: Service, scan: str) -> None:
    answer = service.http.get(f"/v1/scans/{scan}/artifacts/report.html")
    assert answer.headers["Content-Security-Policy"].startswith("sandbox")
    assert answer.headers["X-Content-Type-Options"] == "nosniff"


def test_options_and_presets_speak_of_the_same_specification(service: Service) -> None:
    schema = service.http.get("/v1/options").json()
    presets = service.http.get("/v1/presets").json()["items"]
    assert {preset["name"] for preset in presets} == {"default", "quick", "paper", "paper-coupled", "paper-off-bin"}
    assert set(presets[0]["spec"]) == set(schema["properties"])
    service.submit(presets[1]["spec"])


def test_info_says_what_runs_and_no_secret(service: Service) -> None:
    body = service.http.get("/v1/info").json()
    assert (body["database"], body["broker"], body["workers"]) == ("sqlite", "memory", [])


def test_ready_tells_the_truth_about_the_database(service: Service) -> None:
    said = service.http.get("/readyz").json()
    assert (said["status"], set(said["checks"].values())) == ("ok", {"ok"})
    empty = service.settings.model_copy(update={"database_url": f"sqlite:///{service.folder}/empty.db"})
    with TestClient(create_app(empty)) as http:
        answer = http.get("/readyz")
        assert (answer.status_code, answer.json()["status"]) == (503, "unavailable")
        assert answer.json()["checks"]["tables"] != "ok"
        assert http.get("/healthz").status_code == 200


def test_the_openapi_document_builds_and_names_every_route(service: Service) -> None:
    document = service.http.get("/openapi.json").json()
    assert document["openapi"].startswith("3.1")
    assert set(document["paths"]) >= {
        "/v1/scans",
        "/v1/scans/{scan_id}/modes/{k}/shape",
        "/v1/scans/{scan_id}/artifacts/{name}",
        "/v1/keys/{key_id}/rotate",
        "/v1/info",
        "/healthz",
        "/readyz",
    }
    submit = document["paths"]["/v1/scans"]["post"]
    assert "Idempotency-Key" in str(submit["parameters"])
    assert set(submit["responses"]) == {"202", "400", "401", "403", "409", "413", "422", "429", "503"}
    for status in ("409", "422"):
        assert list(submit["responses"][status]["content"]) == ["application/problem+json"]
    assert "pointer" in document["components"]["schemas"]["Problem"]["properties"]


def test_every_reference_in_the_openapi_document_leads_somewhere(service: Service) -> None:
    document = service.http.get("/openapi.json").json()
    named = set(re.findall(r"#/components/schemas/([A-Za-z-_]+)", json.dumps(document)))
    assert named <= set(document["components"]["schemas"])


def test_modes_so_far_are_told_before_the_end_and_replaced_by_it(service: Service) -> None:
    source = simulation()["source"] | {"frames": 40}
    scan_id = service.submit(simulation(source=source, partial_every=16))["id"]
    address = f"/v1/scans/{scan_id}/modes"
    assert service.http.get(address).status_code == 404
    for frames in (16, 32):
        document = json.dumps({"partial": {"frames": frames}, "organs": []}).encode()
        service.give(scan_id, {"so_far/modes.json": document}, frame=frames)
    assert service.http.get(address).json()["partial"] == {"frames": 32}
    service.give(scan_id, {"modes.json": b'{"organs": []}'})
    assert "partial" not in service.http.get(address).json()
