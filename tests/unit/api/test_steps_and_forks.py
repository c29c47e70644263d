"""Steps in pages, what they wrote, retries of frames, forks by merge patch, and scans that are forgotten."""

from typing import Any

import pytest
from scanjobs.log_lines import append_lines
from scanjobs.repository import get_scan, list_steps

from services.api.routes.forks import merged
from tests.unit.api.service import Service, simulation


def steps_of(service: Service, scan: str, **params: Any) -> list[dict[str, Any]]:
    """Every step, page by page."""
    found: list[dict[str, Any]] = []
    cursor = None
    while True:
        asked = params | ({"cursor": cursor} if cursor else {})
        page = service.http.get(f"/v1/scans/{scan}/steps", params=asked).json()
        found += page["items"]
        cursor = page["next_cursor"]
        if cursor is None:
            return found


@pytest.mark.parametrize("limit", [1, 3, 500])
def test_steps_come_in_pages_each_once_and_in_order(service: Service, limit: int) -> None:
    scan = service.submit()["id"]
    with service.store.read() as session:
        expected = [row.id for row in list_steps(session, get_scan(session, scan))]
    found = [row["id"] for row in steps_of(service, scan, limit=limit)]
    assert sorted(found) == sorted(expected)
    depths = [("frame.render", "frame.train", "frame.extract", "scan.identify").index(row["step"])
              for row in steps_of(service, scan, limit=limit)]  # fmt: skip
    assert depths == sorted(depths)


def test_steps_are_filtered_by_kind_and_state(service: Service) -> None:
    scan = service.submit()["id"]
    assert {row["frame"] for row in steps_of(service, scan, step="frame.render", state="ready")} == {0, 1, 2}
    assert steps_of(service, scan, state="failed") == []


def test_a_cursor_of_another_scan_is_refused(service: Service) -> None:
    one, two = service.submit()["id"], service.submit()["id"]
    cursor = service.http.get(f"/v1/scans/{one}/steps", params={"limit": 1}).json()["next_cursor"]
    answer = service.http.get(f"/v1/scans/{two}/steps", params={"cursor": cursor})
    assert (answer.status_code, answer.json()["code"]) == (422, "INVALID_CURSOR")


def test_logs_are_followed_line_by_line(service: Service) -> None:
    scan = service.submit()["id"]
    first, second = (row["id"] for row in steps_of(service, scan)[:2])

    def write(step: str, *lines: str) -> None:
        service.store.write(
            lambda session: append_lines(session, scan_id=scan, step_id=step, token=1, level="info", lines=lines)
        )

    write(first, "one", "two\x00", "x" * 5000)
    page = service.http.get(f"/v1/scans/{scan}/logs").json()
    assert [row["text"] for row in page["items"]] == ["one", "two", "x" * 1000]
    assert page["items"][0]["step"] == "frame.render"
    write(second, "three")
    rest = service.http.get(f"/v1/scans/{scan}/logs", params={"after": page["after"]}).json()
    assert [row["text"] for row in rest["items"]] == ["three"]
    assert service.http.get(f"/v1/scans/{scan}/logs", params={"after": rest["after"]}).json()["items"] == []
    alone = service.http.get(f"/v1/scans/{scan}/logs", params={"step": second}).json()
    assert [row["text"] for row in alone["items"]] == ["three"]


def test_a_fork_changes_what_it_says_and_keeps_the_rest(service: Service) -> None:
    parent = service.submit(simulation(tags=["a"], plant={"id": "p"}))
    answer = service.http.post(
        f"/v1/scans/{parent['id']}/fork", json={"identification": {"max_modes": 3}, "plant": None, "tags": ["b"]}
    )
    fork = answer.json()
    assert (answer.status_code, fork["tags"], fork["plant"]) == (202, ["b"], None)
    assert answer.headers["Location"] == f"/v1/scans/{fork['id']}"
    assert fork["spec"]["identification"]["max_modes"] == 3
    for part in ("source", "reconstruction", "organs", "seed"):
        assert fork["spec"][part] == parent["spec"][part]
    with service.store.read() as session:
        assert get_scan(session, fork["id"]).root_id == parent["id"]


def test_a_fork_that_makes_no_sense_is_refused_with_its_field(service: Service) -> None:
    parent = service.submit()["id"]
    answer = service.http.post(f"/v1/scans/{parent}/fork", json={"source": {"frames": 0}})
    assert (answer.status_code, answer.json()["pointer"]) == (422, "/source/frames")
    assert service.rows() == 1


def test_a_fork_is_idempotent_too(service: Service) -> None:
    parent = service.submit()["id"]
    headers = {"Idempotency-Key": "k"}
    ids = {
        service.http.post(f"/v1/scans/{parent}/fork", json={"seed": 1}, headers=headers).json()["id"] for _ in range(3)
    }
    assert len(ids) == 1
    other = service.http.post(f"/v1/scans/{parent}/fork", json={"seed": 2}, headers=headers)
    assert (other.status_code, other.json()["code"]) == (409, "IDEMPOTENCY_CONFLICT")


@pytest.mark.parametrize(
    ("target", "patch", "expected"),
    [
        ({"a": "b"}, {"a": "c"}, {"a": "c"}),
        ({"a": "b"}, {"b": "c"}, {"a": "b", "b": "c"}),
        ({"a": "b"}, {"a": None}, {}),
        ({"a": "b", "b": "c"}, {"a": None}, {"b": "c"}),
        ({"a": ["b"]}, {"a": "c"}, {"a": "c"}),
        ({"a": "c"}, {"a": ["b"]}, {"a": ["b"]}),
        ({"a": {"b": "c"}}, {"a": {"b": "d", "c": None}}, {"a": {"b": "d"}}),
        ({"a": [{"b": "c"}]}, {"a": [1]}, {"a": [1]}),
        (["a", "b"], ["c", "d"], ["c", "d"]),
        ({"a": "b"}, ["c"], ["c"]),
        ({"a": "foo"}, None, None),
        ({"e": None}, {"a": 1}, {"e": None, "a": 1}),
        ([1, 2], {"a": "b", "c": None}, {"a": "b"}),
        ({}, {"a": {"bb": {"ccc": None}}}, {"a": {"bb": {}}}),
    ],
)
def test_merge_patches_as_rfc_7396_lists_them(target: Any, patch: Any, expected: Any) -> None:
    assert merged(target, patch) == expected


def test_a_scan_that_has_ended_can_be_forgotten(service: Service) -> None:
    scan = service.submit()["id"]
    early = service.http.delete(f"/v1/scans/{scan}")
    assert (early.status_code, early.json()["code"]) == (409, "ILLEGAL_TRANSITION")
    service.http.post(f"/v1/scans/{scan}/cancel")
    assert service.http.delete(f"/v1/scans/{scan}").status_code == 204
    assert service.http.get(f"/v1/scans/{scan}").status_code == 404
    assert service.http.get("/v1/scans").json()["items"] == []


def test_a_retry_of_frames_computes_these_afresh(service: Service) -> None:
    scan = service.submit()["id"]
    service.http.post(f"/v1/scans/{scan}/cancel")
    answer = service.http.post(f"/v1/scans/{scan}/retry", params={"from": "frame.train", "frames": [0, 2]})
    assert (answer.status_code, answer.json()["generation"]) == (202, 1)
    bad = service.http.post(f"/v1/scans/{scan}/retry", params={"from": "frame.train", "frames": [-1]})
    assert (bad.status_code, bad.json()["code"]) == (422, "INVALID_PARAMETER")
