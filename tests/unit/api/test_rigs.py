"""Certificates of rigs: kept for their owner, refused where they were changed, and taken by preflight."""

import json
from typing import Any

import pytest
from nerfmodal.preflight.certified import FORMAT, VERSION, certificate_id

from tests.unit.api.service import Json, Service, simulation

RIG = "ab" * 32


def certificate(**content: Any) -> Json:
    """A small whole one."""
    document = {
        "format": FORMAT,
        "format_version": VERSION,
        "rig_digest": RIG,
        "cameras": [{}, {}, {}],
        "frame_rate_hz": 30.0,
        "noise_per_grain": 0.12,
    }
    document |= content
    return {"id": certificate_id(document), "created": "2025-01-02T03:04:05+00:00"} | document


def test_a_certificate_is_kept_and_given_back(service: Service) -> None:
    kept = service.http.post("/v1/rigs", json=certificate())
    assert (kept.status_code, kept.headers["Location"]) == (201, f"/v1/rigs/{RIG}/certificate")
    assert (kept.json()["cameras"], kept.json()["certificate"]) == (3, certificate()["id"])
    assert service.http.get(kept.headers["Location"]).json() == certificate()
    assert service.http.post("/v1/rigs", json=certificate()).json() == kept.json()
    assert [row["rig"] for row in service.http.get("/v1/rigs").json()["items"]] == [RIG]


def test_the_newest_speaks_for_its_rig(service: Service) -> None:
    for noise in (0.12, 0.05):
        service.http.post("/v1/rigs", json=certificate(noise_per_grain=noise))
    assert service.http.get(f"/v1/rigs/{RIG}/certificate").json()["noise_per_grain"] == 0.05
    assert len(service.http.get("/v1/rigs").json()["items"]) == 2


@pytest.mark.parametrize(
    "document",
    [
        {},
        certificate() | {"noise_per_grain": 0.01},
        certificate(format_version=2),
        certificate(rig_digest="x"),
        certificate(cameras=3),
        certificate(frame_rate_hz="30"),
        certificate(noise_per_grain="low"),
    ],
)
def test_what_is_no_whole_certificate_is_refused(service: Service, document: Json) -> None:
    answer = service.http.post("/v1/rigs", json=document)
    assert (answer.status_code, answer.json()["code"]) == (422, "INVALID_INPUT")
    assert answer.json()["hint"]
    assert service.http.get("/v1/rigs").json() == {"items": []}


def test_a_number_that_json_cannot_hold_is_refused(service: Service) -> None:
    text = json.dumps(certificate() | {"noise_per_grain": float("nan")})
    answer = service.http.post("/v1/rigs", content=text, headers={"Content-Type": "application/json"})
    assert answer.status_code == 422


def test_what_is_not_there_is_404(service: Service) -> None:
    for rig in ("cd" * 32, "nonsense"):
        answer = service.http.get(f"/v1/rigs/{rig}/certificate")
        assert (answer.status_code, answer.json()["code"]) == (404, "NOT_FOUND")


def test_preflight_takes_the_noise_of_a_kept_certificate(service: Service) -> None:
    spec = simulation(rig_certificate=certificate()["id"])
    before = service.http.post("/v1/preflight", json=spec).json()["optics"]
    service.http.post("/v1/rigs", json=certificate())
    after = service.http.post("/v1/preflight", json=spec).json()["optics"]
    assert after["noise_m"] == pytest.approx(2 * before["noise_m"])
    assert after["noise_basis"] == "the rig's certificate"
