"""Resumable uploads: tus 1.0 as its text says, and nothing lost or doubled when lines break."""

import base64
import hashlib
import threading
from concurrent.futures import ThreadPoolExecutor

import pytest
from httpx2 import Response
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scanjobs.account_tables import Upload
from scanjobs.uploads import file_of, held, remove_expired
from sqlalchemy import update

from tests.unit.api.service import Service

TUS = {"Tus-Resumable": "1.0.0"}
BYTES = {"Content-Type": "application/offset+octet-stream"}


def begin(service: Service, length: int, name: str = "a.bin", **headers: str) -> Response:
    metadata = "filename " + base64.b64encode(name.encode()).decode()
    sent = {**TUS, "Upload-Length": str(length), "Upload-Metadata": metadata, **headers}
    return service.http.post("/v1/uploads", headers=sent)


def send(service: Service, where: str, offset: int, content: bytes, **headers: str) -> Response:
    sent = {**TUS, **BYTES, "Upload-Offset": str(offset), **headers}
    return service.http.patch(where, headers=sent, content=content)


def offset_of(service: Service, where: str) -> int:
    return int(service.http.head(where, headers=TUS).headers["Upload-Offset"])


def stored(service: Service, where: str) -> bytes:
    return file_of(service.settings, where.rsplit("/", 1)[1]).read_bytes()


def test_options_say_what_is_spoken(service: Service) -> None:
    answer = service.http.options("/v1/uploads")
    assert (answer.status_code, answer.headers["Tus-Version"]) == (204, "1.0.0")
    assert "creation-with-upload" in answer.headers["Tus-Extension"]
    assert int(answer.headers["Tus-Max-Size"]) == service.settings.upload_limit_mb * 10**6


@settings(max_examples=15, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(content=st.binary(max_size=4000), data=st.data())
def test_any_cut_into_pieces_gives_the_same_file(service: Service, content: bytes, data: st.DataObject) -> None:
    where = begin(service, len(content)).headers["Location"]
    at = 0
    while at < len(content):
        end = data.draw(st.integers(at + 1, len(content)))
        answer = send(service, where, at, content[at:end])
        assert (answer.status_code, answer.headers["Upload-Offset"]) == (204, str(end))
        at = offset_of(service, where)
    detail = service.http.get(where).json()
    assert (detail["complete"], detail["sha256"]) == (True, hashlib.sha256(content).hexdigest())
    assert stored(service, where) == content


def test_the_first_bytes_may_come_with_the_creation(service: Service) -> None:
    answer = service.http.post("/v1/uploads", headers={**TUS, **BYTES, "Upload-Length": "3"}, content=b"abc")
    assert (answer.status_code, answer.headers["Upload-Offset"]) == (201, "3")
    assert service.http.get(answer.headers["Location"]).json()["complete"]


@pytest.mark.parametrize("offset", [0, 2, 4])
def test_bytes_that_do_not_continue_are_refused(service: Service, offset: int) -> None:
    where = begin(service, 6).headers["Location"]
    send(service, where, 0, b"abc")
    answer = send(service, where, offset, b"def")
    assert (answer.status_code, answer.json()["code"]) == (409, "UPLOAD_CONFLICT")
    assert "byte 3" in answer.json()["hint"]
    assert send(service, where, 3, b"def").status_code == 204
    assert stored(service, where) == b"abcdef"


def test_more_bytes_than_announced_are_refused_and_not_kept(service: Service) -> None:
    where = begin(service, 4).headers["Location"]
    answer = send(service, where, 0, b"12345")
    assert (answer.status_code, answer.json()["code"]) == (413, "TOO_LARGE")
    assert offset_of(service, where) == 0
    assert send(service, where, 0, b"1234").status_code == 204


@pytest.mark.parametrize("algorithm", ["sha256", "sha1", "md5"])
def test_bytes_with_another_checksum_are_refused_and_not_kept(service: Service, algorithm: str) -> None:
    where = begin(service, 3).headers["Location"]
    right = base64.b64encode(hashlib.new(algorithm, b"abc").digest()).decode()
    wrong = send(service, where, 0, b"abd", **{"Upload-Checksum": f"{algorithm} {right}"})
    assert (wrong.status_code, wrong.json()["code"]) == (460, "CHECKSUM_MISMATCH")
    assert offset_of(service, where) == 0
    assert send(service, where, 0, b"abc", **{"Upload-Checksum": f"{algorithm} {right}"}).status_code == 204


def test_bytes_behind_what_was_confirmed_count_for_nothing(service: Service) -> None:
    """A power failure between the bytes and the row: guard: `truncate` in `_begin`."""
    where = begin(service, 6).headers["Location"]
    send(service, where, 0, b"abc")
    with file_of(service.settings, where.rsplit("/", 1)[1]).open("ab") as file:
        file.write(b"XYZXYZ")
    assert send(service, where, 3, b"def").status_code == 204
    assert stored(service, where) == b"abcdef"


def test_two_who_send_the_same_bytes_do_not_mix(service: Service) -> None:
    where = begin(service, 6).headers["Location"]
    path = file_of(service.settings, where.rsplit("/", 1)[1])
    with held(path):
        answer = send(service, where, 0, b"abcdef")
    assert (answer.status_code, answer.json()["code"]) == (423, "UPLOAD_BUSY")


def test_of_many_at_once_one_wins(service: Service) -> None:
    where = begin(service, 3000).headers["Location"]
    barrier = threading.Barrier(6)

    def attempt(number: int) -> int:
        barrier.wait()
        return send(service, where, 0, bytes([number]) * 3000).status_code

    with ThreadPoolExecutor(6) as pool:
        codes = sorted(pool.map(attempt, range(6)))
    assert codes[0] == 204
    assert set(codes[1:]) <= {409, 423}
    assert len(set(stored(service, where))) == 1
    assert service.http.get(where).json()["sha256"] == hashlib.sha256(stored(service, where)).hexdigest()


@pytest.mark.parametrize(
    ("headers", "status", "code"),
    [
        ({"Tus-Resumable": "0.2.2"}, 412, "TUS_VERSION"),
        ({"Upload-Length": "-1"}, 422, "INVALID_PARAMETER"),
        ({"Upload-Length": "x"}, 422, "INVALID_PARAMETER"),
        ({"Upload-Length": str(10**12)}, 413, "TOO_LARGE"),
        ({"Upload-Metadata": "filename !!"}, 400, "INVALID_METADATA"),
        ({"Upload-Checksum": "crc AAAA"}, 400, "INVALID_CHECKSUM"),
    ],
)
def test_what_makes_no_sense_is_refused(service: Service, headers: dict[str, str], status: int, code: str) -> None:
    answer = begin(service, 3, **headers)
    assert (answer.status_code, answer.json()["code"]) == (status, code)
    assert service.http.get("/v1/uploads").json()["items"] == []


def test_a_quota_is_held_even_before_the_bytes_come(service: Service) -> None:
    service.settings.__dict__["owner_quota_mb"] = 1
    assert begin(service, 600_000).status_code == 201
    answer = begin(service, 600_000)
    assert (answer.status_code, answer.json()["code"]) == (507, "QUOTA_EXCEEDED")
    [row] = service.http.get("/v1/uploads").json()["items"]
    service.http.delete(f"/v1/uploads/{row['id']}", headers=TUS)
    assert begin(service, 600_000).status_code == 201


def test_a_terminated_upload_is_gone_with_its_bytes(service: Service) -> None:
    where = begin(service, 6).headers["Location"]
    send(service, where, 0, b"abc")
    assert service.http.delete(where, headers=TUS).status_code == 204
    assert service.http.head(where, headers=TUS).status_code == 404
    assert list(service.settings.uploads.iterdir()) == []


def test_an_expired_upload_is_forgotten(service: Service) -> None:
    where = begin(service, 6).headers["Location"]
    send(service, where, 0, b"abc")
    service.store.write(lambda session: session.execute(update(Upload).values(expires_at=0.0)))
    assert service.http.head(where, headers=TUS).status_code == 404
    assert service.store.write(lambda session: remove_expired(session, service.settings)) == 1
    assert list(service.settings.uploads.iterdir()) == []


def test_uploads_are_listed_in_pages(service: Service) -> None:
    made = [begin(service, 1).headers["Location"].rsplit("/", 1)[1] for _ in range(5)]
    first = service.http.get("/v1/uploads", params={"limit": 3}).json()
    second = service.http.get("/v1/uploads", params={"limit": 3, "cursor": first["next_cursor"]}).json()
    assert [row["id"] for row in first["items"] + second["items"]] == made[::-1]
    assert second["next_cursor"] is None
