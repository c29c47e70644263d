"""What the API keeps out of its process, and whose scans it shows."""

import subprocess
import sys

import pytest
from fastapi import FastAPI

from services.api.dependencies import current_owner
from tests.unit.api.service import Service

STRANGERS = {"torch", "open3d", "bpy", "numba", "matplotlib", "celery", "kombu"}
SCIENCE = {"pipeline", "io", "simulate", "capture", "field", "cloud", "surface", "identify"}


def test_the_api_loads_no_science_and_cannot_publish() -> None:
    names = STRANGERS | {f"nerfmodal.{name}" for name in SCIENCE}
    code = f"import sys, services.api.main; print(sorted({names!r} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


@pytest.fixture
def scan_of_somebody_else(service: Service) -> str:
    """A finished scan of the local owner, looked for by another one from now on."""
    scan: str = service.submit(**{"Idempotency-Key": "k"})["id"]
    service.give(scan, {"modes.json": b'{"organs": []}'})
    app = service.http.app
    assert isinstance(app, FastAPI)
    app.dependency_overrides[current_owner] = lambda: "somebody"
    return scan


@pytest.mark.parametrize(
    ("method", "tail"),
    [
        ("GET", ""),
        ("GET", "/steps"),
        ("GET", "/modes"),
        ("GET", "/modes/0/shape"),
        ("GET", "/artifacts"),
        ("GET", "/artifacts/modes.json"),
        ("POST", "/cancel"),
        ("POST", "/retry"),
    ],
)
def test_somebody_elses_scan_is_not_there(service: Service, scan_of_somebody_else: str, method: str, tail: str) -> None:
    answer = service.http.request(method, f"/v1/scans/{scan_of_somebody_else}{tail}")
    assert (answer.status_code, answer.json()["code"]) == (404, "NOT_FOUND")


def test_somebody_elses_scans_are_in_no_list_and_keys_do_not_meet(service: Service, scan_of_somebody_else: str) -> None:
    assert service.http.get("/v1/scans").json()["items"] == []
    mine = service.submit(**{"Idempotency-Key": "k"})["id"]
    assert mine != scan_of_somebody_else
    assert [scan["id"] for scan in service.http.get("/v1/scans").json()["items"]] == [mine]
