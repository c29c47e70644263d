"""Pictures of cameras and points of clouds, one by one: the bytes are those of the artifacts."""

import io
import json
import zipfile
from dataclasses import replace
from pathlib import Path
from urllib.parse import quote

import numpy as np
import pytest
from nerfmodal.io import write_cloud, write_frame
from nerfmodal.io.frames import encode_png
from nerfmodal.io.transforms import camera_entry
from PIL import Image
from scanjobs.messages import EXTRACT, RENDER
from starlette.testclient import TestClient

from tests.fixtures.scans import small_cloud, small_frame
from tests.unit.api.service import Service

FRAME, CLOUD = small_frame(), small_cloud()


@pytest.fixture
def scan(service: Service, tmp_path: Path) -> str:
    """A scan whose frame 1 has pictures and a cloud."""
    found = str(service.submit()["id"])
    write_frame(tmp_path / "frame.zip", FRAME)
    write_cloud(tmp_path / "cloud.ply", CLOUD)
    service.give(found, {"frame": (tmp_path / "frame.zip").read_bytes()}, kind=RENDER, frame=1)
    service.give(found, {"cloud": (tmp_path / "cloud.ply").read_bytes()}, kind=EXTRACT, frame=1)
    return found


def points_of(http: TestClient, scan: str, most: int) -> tuple[np.ndarray, np.ndarray]:
    """Positions and colours of an answer's bytes."""
    content = http.get(f"/v1/scans/{scan}/frames/1/cloud", params={"max_points": most}).content
    count = len(content) // 15
    return (
        np.frombuffer(content, "<f4", 3 * count).reshape(-1, 3),
        np.frombuffer(content, np.uint8, offset=12 * count).reshape(-1, 3),
    )


def test_every_camera_s_picture_is_served_exactly(service: Service, scan: str):
    listed = service.http.get(f"/v1/scans/{scan}/frames/1/pictures").json()["items"]
    assert [one["camera"] for one in listed] == [camera.name for camera in FRAME.rig.cameras]
    assert {(one["width"], one["height"]) for one in listed} == {(64, 48)}
    for one, image in zip(listed, FRAME.images, strict=True):
        answer = service.http.get(f"/v1/scans/{scan}/frames/1/pictures/{one['camera']}")
        assert answer.headers["Content-Type"] == "image/png"
        np.testing.assert_array_equal(np.asarray(Image.open(io.BytesIO(answer.content))), image)


def test_a_camera_called_after_a_file_in_a_folder_has_its_picture_too(service: Service, tmp_path: Path):
    camera = replace(FRAME.rig.cameras[0], name="left/0001.png")
    frame = replace(FRAME, rig=replace(FRAME.rig, cameras=(camera,)), images=FRAME.images[:1])
    with zipfile.ZipFile(tmp_path / "frame.zip", "w") as archive:
        entry = camera_entry(camera) | {"file_path": "images/0.png", "frame_index": 0, "time_s": 0.0}
        archive.writestr("transforms.json", json.dumps({"frames": [entry]}))
        archive.writestr("images/0.png", encode_png(frame.images[0]))
    scan = str(service.submit()["id"])
    service.give(scan, {"frame": (tmp_path / "frame.zip").read_bytes()}, kind=RENDER, frame=0)
    [listed] = service.http.get(f"/v1/scans/{scan}/frames/0/pictures").json()["items"]
    answer = service.http.get(f"/v1/scans/{scan}/frames/0/pictures/{quote(listed['camera'], safe='')}")
    np.testing.assert_array_equal(np.asarray(Image.open(io.BytesIO(answer.content))), frame.images[0])


def test_a_whole_cloud_is_every_point_with_its_colour(service: Service, scan: str):
    positions, colors = points_of(service.http, scan, 100_000)
    order, wanted = np.lexsort(positions.T), np.lexsort(CLOUD.points.astype("f4").T)
    np.testing.assert_array_equal(positions[order], CLOUD.points.astype("f4")[wanted])
    np.testing.assert_array_equal(colors[order], np.round(255 * CLOUD.colors).astype(np.uint8)[wanted])


def test_fewer_points_are_the_beginning_of_more_and_an_even_choice(service: Service, scan: str):
    few, _ = points_of(service.http, scan, 1000)
    many, _ = points_of(service.http, scan, 4000)
    np.testing.assert_array_equal(many[:1000], few)
    spread = CLOUD.points.std(axis=0) / np.sqrt(1000)
    assert (np.abs(few.mean(axis=0) - CLOUD.points.mean(axis=0)) < 5 * spread).all()


@pytest.mark.parametrize("path", ["pictures/cam00", "cloud"])
def test_what_is_known_is_not_sent_again(service: Service, scan: str, path: str):
    first = service.http.get(f"/v1/scans/{scan}/frames/1/{path}")
    again = service.http.get(f"/v1/scans/{scan}/frames/1/{path}", headers={"If-None-Match": first.headers["ETag"]})
    assert (first.status_code, again.status_code, again.content) == (200, 304, b"")


@pytest.mark.parametrize("path", ["0/pictures", "0/cloud", "1/pictures/nobody", "7/pictures"])
def test_what_is_not_there_is_a_404(service: Service, scan: str, path: str):
    answer = service.http.get(f"/v1/scans/{scan}/frames/{path}")
    assert (answer.status_code, answer.json()["code"]) == (404, "NOT_FOUND")


def test_another_owner_sees_neither(service: Service, scan: str):
    other = service.locked()
    headers = {"Authorization": f"Bearer {service.key('somebody')}"}
    for path in ("pictures", "pictures/cam00", "cloud"):
        assert other.get(f"/v1/scans/{scan}/frames/1/{path}", headers=headers).status_code == 404
