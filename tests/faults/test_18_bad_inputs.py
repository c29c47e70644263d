"""Fault 18: bad inputs are answered with a 4xx that names the field; disk and memory stay; no step is made.

Each case says in its comment which guard it is for; with the guard taken out the case fails (shown once for each).
"""

import io
import json
import os
import stat
import struct
import zipfile
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from PIL import Image
from scanjobs.artifacts import ArtifactStore
from scanjobs.settings import Settings
from scanjobs.store import open_store
from scanjobs.tables import Scan, Step
from starlette.testclient import TestClient

from services.api.app import create_app
from tests.conftest import copy_database

GROWTH_BYTES = 50 * 10**6
IDENTITY = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
Files = dict[str, bytes]


class Door:
    """A service, and how much of the machine it takes."""

    def __init__(self, http: TestClient, settings: Settings, counts: Callable[[], tuple[int, int]]) -> None:
        self.http = http
        self.settings = settings
        self.counts = counts

    def disk(self) -> int:
        return sum(path.stat().st_size for path in self.settings.data_folder.rglob("*") if path.is_file())


@pytest.fixture
def door(tmp_path: Path, migrated_sqlite: Path) -> Iterator[Door]:
    settings = Settings(data_folder=tmp_path / "data", capture_roots=(tmp_path / "roots",))
    (tmp_path / "roots").mkdir()
    copy_database(migrated_sqlite, settings.data_folder)
    store = open_store(settings.database)

    def counts() -> tuple[int, int]:
        with store.read() as session:
            return session.query(Scan).count(), session.query(Step).count()

    app = create_app(settings, store, ArtifactStore(settings.artifacts))
    with TestClient(app) as http:
        yield Door(http, settings, counts)
    store.close()


def resident_bytes() -> int:
    """Memory of this process, where the service runs too."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def picture(width: int = 32, height: int = 24, kind: str = "PNG") -> bytes:
    buffer = io.BytesIO()
    Image.new("RGB", (width, height), (10, 200, 30)).save(buffer, kind)
    return buffer.getvalue()


def transforms(**changes: Any) -> dict[str, Any]:
    """Three cameras, two frames."""
    frames = [
        {"file_path": f"images/{camera}_{index}.png", "camera_id": camera, "frame_index": index, "time_s": index / 30}
        | {"transform_matrix": IDENTITY}
        for index in range(2)
        for camera in ("a", "b", "c")
    ]
    return {"fl_x": 40.0, "fl_y": 40.0, "cx": 16.0, "cy": 12.0, "w": 32, "h": 24, "frames": frames} | changes


def capture(document: Any = None, **others: bytes) -> Files:
    """The files of a capture."""
    files = {frame["file_path"]: picture() for frame in transforms()["frames"]}
    text = document if isinstance(document, bytes) else json.dumps(document or transforms()).encode()
    return files | {"transforms.json": text} | others


def zipped(files: Files, **members: zipfile.ZipInfo) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            archive.writestr(members.get(name, zipfile.ZipInfo(name)), content)
    return buffer.getvalue()


def with_frame(place: int, **changes: Any) -> Files:
    document = transforms()
    document["frames"][place] |= changes
    return capture(document)


def symlink(name: str) -> zipfile.ZipInfo:
    info = zipfile.ZipInfo(name)
    info.create_system = 3
    info.external_attr = (stat.S_IFLNK | 0o777) << 16
    return info


def bomb() -> bytes:
    """200 MB in 200 kB."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive, archive.open("a.bin", "w") as member:
        for _ in range(200):
            member.write(bytes(10**6))
    return buffer.getvalue()


def lying_bomb() -> bytes:
    """A directory that says one byte of a member of 100 MB."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive, archive.open("a.bin", "w") as member:
        for _ in range(100):
            member.write(bytes(10**6))
    raw = bytearray(buffer.getvalue())
    at = raw.rfind(b"PK\x01\x02")
    raw[at + 24 : at + 28] = struct.pack("<L", 1)
    return bytes(raw)


def crowd() -> bytes:
    """A directory of 300,000 names that take 14 MB: each would become an object of half a kilobyte."""
    entry = struct.pack("<4s6H3L5H2L", b"PK\x01\x02", 20, 20, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0) + b"a"
    directory = entry * 300_000
    return directory + struct.pack("<4s4H2LH", b"PK\x05\x06", 0, 0, 0xFFFF, 0xFFFF, len(directory), 0, 0)


def encrypted() -> bytes:
    raw = bytearray(zipped(capture()))
    at = raw.find(b"PK\x01\x02")
    raw[at + 8] |= 1
    return bytes(raw)


def huge_png() -> bytes:
    """14,000 × 14,000 pixels in a header of a few bytes."""
    raw = bytearray(picture())
    raw[16:24] = struct.pack(">2L", 14_000, 14_000)
    raw[29:33] = struct.pack(">L", zlib.crc32(raw[12:29]))
    return bytes(raw)


NAN = json.dumps(transforms()).replace("40.0", "NaN", 1).encode()
INFINITE = json.dumps(transforms()).replace("40.0", "1e999", 1).encode()
NAN_POSE = json.dumps(transforms()).replace("[1, 0, 0, 0]", "[NaN, 0, 0, 0]", 1).encode()
DEEP = b'{"frames":' + b"[" * 200_000
MANY = b'{"frames":[' + b"{}," * 2_900_000 + b"{}]}"

ARCHIVES: dict[str, tuple[bytes | Callable[[], bytes], str]] = {
    "climbing out": (zipped({"../../evil.png": picture()}), "leads out"),  # safe_name
    "absolute": (zipped({"/etc/evil.png": picture()}), "leads out"),  # safe_name
    "windows": (zipped({"..\\evil.png": picture()}), "leads out"),  # safe_name
    "symlink": (
        zipped({"link.png": b"/etc/passwd"}, **{"link.png": symlink("link.png")}),
        "a link or a device",
    ),  # _check_member
    "bomb": (bomb, "times its size"),  # HIGHEST_RATIO
    "lying bomb": (lying_bomb, "archive"),  # the count in _write
    "crowd": (crowd, "more than"),  # _count_entries
    "encrypted": (encrypted, "encrypted"),  # _check_member
    "same name twice": (zipped({"a/B.png": picture(), "a/b.png": picture()}), "same name"),  # _check_names
    "file as folder": (zipped({"a": b"x", "a/b.png": picture()}), "folder that is a file"),  # _check_names
    "no archive": (b"PK no", "cannot be read"),  # BadZipFile
    "cut off": (zipped(capture())[:400], "cannot be read"),  # BadZipFile
    "empty": (zipped({}), "empty"),  # _checked
    "unknown kind": (zipped({"run.sh": b"rm"}), "no kind"),  # _check_kind
    "pickle": (zipped({"a.pkl": b"cos\nsystem\n"}), "no kind"),  # _check_kind
    "huge picture": (zipped(capture(**{"images/a_0.png": huge_png()})), "pixels"),  # LARGEST_PICTURE
    "truncated jpeg": (zipped({"a.jpg": picture(512, 512, "JPEG")[:-40]}), "ends in the middle"),  # ENDINGS
    "truncated png": (zipped({"a.png": picture(64, 64)[:-30]}), "ends in the middle"),  # ENDINGS
    "no picture": (zipped({"a.png": b"GIF89a" * 9}), "no picture"),  # look_at
    "mixed sizes": (zipped(capture(**{"images/b_1.png": picture(64, 48)})), "says w"),  # _check_picture
    "nan": (zipped(capture(NAN)), "NaN"),  # parse_constant
    "infinite": (zipped(capture(INFINITE)), "positive number"),  # _number
    "nan pose": (zipped(capture(NAN_POSE)), "NaN"),  # parse_constant
    "no matrix": (zipped(with_frame(2, transform_matrix=[[1, 2]])), "matrix"),  # _check_frame
    "frame 1e9": (zipped(with_frame(2, frame_index=10**9)), "frame number"),  # HIGHEST_FRAMES
    "two cameras": (zipped(capture(transforms(frames=transforms()["frames"][:2]))), "2 cameras"),  # FEWEST_CAMERAS
    "duplicate frame": (zipped(with_frame(3, camera_id="a", frame_index=0)), "twice"),  # _check_views
    "picture not sent": (zipped(with_frame(0, file_path="images/x.png")), "not sent"),  # _check_picture
    "picture elsewhere": (zipped(with_frame(0, file_path="../../../etc/passwd.png")), "not sent"),  # _find
    "deep json": (zipped(capture(DEEP)), "JSON"),  # RecursionError
    "long json": (zipped(capture(MANY)), "too long"),  # HIGHEST_TRANSFORMS_BYTES
}


def send(door: Door, archive: bytes) -> Any:
    return door.http.post("/v1/captures/archive", content=archive, headers={"Content-Type": "application/zip"})


def test_a_good_capture_is_taken_so_that_the_others_are_refused_for_what_they_are(door: Door) -> None:
    answer = send(door, zipped(capture()))
    assert answer.status_code == 201, answer.text
    body = answer.json()
    assert body["facts"] == {"files": 7, "pictures": 6, "cameras": 3, "frames": 2}
    scan = door.http.post("/v1/scans", json={"source": body["source"]})
    assert scan.status_code == 202, scan.text
    folder = Path(scan.json()["spec"]["source"]["path"])
    assert {path.name for path in folder.iterdir()} == {"images", "transforms.json"}


@pytest.mark.parametrize("name", ARCHIVES)
def test_a_bad_archive_is_refused_and_leaves_nothing(door: Door, name: str) -> None:
    given, words = ARCHIVES[name]
    archive = given() if callable(given) else given
    send(door, b"PK no")  # what is loaded once is loaded
    memory, disk = resident_bytes(), door.disk()
    answer = send(door, archive)
    assert answer.status_code == 422, answer.text
    assert answer.json()["pointer"] in ("/archive", "/files")
    assert words in answer.json()["detail"]
    assert resident_bytes() - memory < GROWTH_BYTES
    assert door.disk() - disk < 10**6
    assert door.counts() == (0, 0)
    assert not any(path.is_file() for path in door.settings.captures.rglob("*"))
    assert door.http.get("/v1/captures").json()["items"] == []


SPECS: dict[str, tuple[dict[str, Any], str]] = {
    "1e9 frames": ({"kind": "simulation", "frames": 10**9, "frame_rate_hz": 30, "motion": []}, "/source/frames"),
    "path out": ({"kind": "capture", "path": "../../../etc"}, "/source/path"),
    "no capture": ({"kind": "capture", "path": "capture:0190c0de-0000-7000-8000-000000000000"}, "/source/path"),
    "capture climbing": ({"kind": "capture", "path": "capture:../../etc"}, "/source/path"),
    "wide picture": (
        {"kind": "simulation", "frames": 2, "frame_rate_hz": 9, "motion": [], "rig": {"width_px": 10**9}},
        "/source/rig/width_px",
    ),
}


@pytest.mark.parametrize("name", SPECS)
def test_a_bad_specification_is_refused_and_makes_no_step(door: Door, name: str) -> None:
    source, pointer = SPECS[name]
    answer = door.http.post("/v1/scans", json={"source": source})
    assert (answer.status_code, answer.json()["pointer"]) == (422, pointer)
    assert door.counts() == (0, 0)


def test_files_of_uploads_are_looked_at_too(door: Door) -> None:
    tus = {"Tus-Resumable": "1.0.0", "Content-Type": "application/offset+octet-stream"}
    files = []
    for name, content in capture(**{"images/c_1.png": huge_png()}).items():
        answer = door.http.post("/v1/uploads", headers={**tus, "Upload-Length": str(len(content))}, content=content)
        files.append({"upload": answer.headers["Location"].rsplit("/", 1)[1], "name": name})
    answer = door.http.post("/v1/captures", json={"files": files})
    assert (answer.status_code, answer.json()["pointer"]) == (422, "/files")
    assert "pixels" in answer.json()["detail"]
    climbing = [{**files[0], "name": "../x.png"}, *files[1:]]
    answer = door.http.post("/v1/captures", json={"files": climbing})
    assert (answer.status_code, answer.json()["pointer"]) == (422, "/files/0/name")
    assert not any(path.is_file() for path in door.settings.captures.rglob("*"))
