"""Captures as found in the wild, and what is wrong with broken ones: the file and the remedy are named."""

import json
import struct
import zlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from nerfmodal.capture import Capture, open_capture, split_held_out
from nerfmodal.errors import InvalidCapture
from nerfmodal.geometry.cameras import semi_spherical_rig
from nerfmodal.io.frames import encode_png, write_frame
from nerfmodal.io.frames import read_frame as read_stored
from nerfmodal.io.transforms import camera_entry
from nerfmodal.spec import CaptureSource, RigSpec
from PIL import Image

FOX = Path(__file__).parents[3] / ".." / "shared" / "captures" / "fox"
Entries = list[dict[str, Any]]


def opened(folder: Path, **options: Any) -> Capture:
    return open_capture(CaptureSource.model_validate({"kind": "capture", "path": str(folder), **options}))


def write_capture(folder: Path, frames: int = 1, cameras: int = 4) -> Entries:
    rig = semi_spherical_rig(RigSpec(cameras=cameras, width_px=16, height_px=16))
    rng = np.random.default_rng(0)
    entries: Entries = []
    for frame in range(frames):
        for camera in rig.cameras:
            path = folder / f"images/{frame}_{camera.name}.png"
            path.parent.mkdir(exist_ok=True)
            path.write_bytes(encode_png(rng.integers(0, 256, (16, 16, 3), dtype=np.uint8)))
            entry = camera_entry(camera) | {"file_path": str(path.relative_to(folder)), "frame_index": frame}
            entries.append(entry)
    save(folder, entries, frame_rate_hz=30)
    return entries


def save(folder: Path, entries: Entries, **top: Any) -> None:
    (folder / "transforms.json").write_text(json.dumps({"frames": entries, **top}))


def test_a_dynamic_capture_is_sorted_into_instants(tmp_path: Path) -> None:
    write_capture(tmp_path, frames=3)
    capture = opened(tmp_path)
    assert capture.times == (0.0, 1 / 30, 2 / 30)
    assert [len(row) for row in capture.pictures] == [4, 4, 4]
    assert capture.read(2).images.shape == (4, 16, 16, 3)


def test_a_smaller_picture_keeps_its_rays(tmp_path: Path) -> None:
    write_capture(tmp_path)
    frame = opened(tmp_path).read(0, shrink=2)
    full = opened(tmp_path).read(0)
    assert frame.images.shape == (4, 8, 8, 3)
    assert frame.rig.cameras[0].focal_x == full.rig.cameras[0].focal_x / 2


def test_absent_pictures_are_left_out_and_named(tmp_path: Path) -> None:
    entries = write_capture(tmp_path)
    save(tmp_path, [*entries, entries[0] | {"file_path": "images/gone.png", "camera_id": "gone"}])
    assert opened(tmp_path).absent == ("images/gone.png",)


def test_every_nth_view_is_held_out(tmp_path: Path) -> None:
    write_capture(tmp_path, cameras=9)
    trained, held = split_held_out(opened(tmp_path).read(0), 8)
    assert held is not None
    assert [camera.name for camera in held.rig.cameras] == ["cam00", "cam08"]
    assert len(trained.images) == 7
    assert split_held_out(trained, None) == (trained, None)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"transform_matrix": None}, "pose"),
        ({"transform_matrix": np.full((4, 4), np.nan).tolist()}, "pose"),
        ({"transform_matrix": np.diag([2.0, 2, 2, 1]).tolist()}, "rigid"),
        ({"fl_x": None}, "focal"),
        ({"fl_x": -3.0}, "focal"),
        ({"file_path": "../outside.png"}, "climbs out"),
        ({"file_path": None}, "file_path"),
        ({"camera_model": "SPHERICAL"}, "camera_model"),
        ({"w": 17}, "16 x 16"),
        ({"camera_id": "cam01"}, "two pictures"),
    ],
)
def test_a_broken_entry_is_named(tmp_path: Path, change: dict[str, Any], said: str) -> None:
    (tmp_path / "capture").mkdir()
    (tmp_path / "outside.png").write_bytes(b"")
    folder = tmp_path / "capture"
    entries = write_capture(folder)
    entries[0] = {key: value for key, value in (entries[0] | change).items() if value is not None}
    save(folder, entries)
    with pytest.raises(InvalidCapture, match=said) as caught:
        opened(folder)
    assert caught.value.where
    assert caught.value.hint


def test_an_empty_folder_is_no_capture(tmp_path: Path) -> None:
    with pytest.raises(InvalidCapture, match="is no capture"):
        opened(tmp_path)


@pytest.mark.parametrize("content", ["{", "[]", '{"frames": []}'])
def test_a_broken_file_is_named(tmp_path: Path, content: str) -> None:
    (tmp_path / "transforms.json").write_text(content)
    with pytest.raises(InvalidCapture, match=r"transforms\.json"):
        opened(tmp_path)


def test_two_cameras_are_too_few(tmp_path: Path) -> None:
    entries = write_capture(tmp_path)
    save(tmp_path, entries[:2])
    with pytest.raises(InvalidCapture, match="only 2"):
        opened(tmp_path)


def test_pictures_of_two_sizes_are_refused(tmp_path: Path) -> None:
    entries = write_capture(tmp_path)
    (tmp_path / entries[0]["file_path"]).write_bytes(encode_png(np.zeros((8, 16, 3), np.uint8)))
    entries[0]["h"] = 8
    save(tmp_path, entries)
    with pytest.raises(InvalidCapture, match="different sizes"):
        opened(tmp_path)


def test_a_truncated_picture_is_named(tmp_path: Path) -> None:
    entries = write_capture(tmp_path)
    path = tmp_path / entries[1]["file_path"]
    path.write_bytes(path.read_bytes()[:-300])
    with pytest.raises(InvalidCapture, match="cam01"):
        opened(tmp_path).check(lambda *_: None)


def test_a_file_that_is_no_picture_is_named(tmp_path: Path) -> None:
    entries = write_capture(tmp_path)
    (tmp_path / entries[2]["file_path"]).write_bytes(b"")
    with pytest.raises(InvalidCapture, match="cam02"):
        opened(tmp_path)


@pytest.mark.skipif(not FOX.is_dir(), reason="the photographs of ../shared/captures/fox are not here")
def test_the_fox_has_fifty_of_its_sixty_seven_pictures() -> None:
    capture = opened(FOX)
    assert (len(capture), len(capture.rig.cameras), len(capture.absent)) == (1, 50, 17)
    assert capture.rig.cameras[0].model == "opencv"


def test_a_lost_picture_is_missing_and_its_frame_has_fewer_cameras(tmp_path: Path) -> None:
    entries = write_capture(tmp_path, frames=2)
    (tmp_path / entries[5]["file_path"]).unlink()  # cam01 of frame 1
    capture = opened(tmp_path)
    assert capture.missing == (("cam01", 1),)
    frame = capture.read(1)
    assert [camera.name for camera in frame.rig.cameras] == ["cam00", "cam02", "cam03"]
    assert frame.images.shape[0] == 3


def test_held_out_views_stay_the_same_when_a_camera_is_lost(tmp_path: Path) -> None:
    entries = write_capture(tmp_path, frames=2, cameras=6)
    (tmp_path / entries[7]["file_path"]).unlink()  # cam01 of frame 1
    capture = opened(tmp_path)
    trained, held = split_held_out(capture.read(1), 3, capture.rig)
    assert held is not None
    assert [camera.name for camera in held.rig.cameras] == ["cam00", "cam03"]
    assert [camera.name for camera in trained.rig.cameras] == ["cam02", "cam04", "cam05"]


def test_most_pictures_missing_means_a_broken_copy(tmp_path: Path) -> None:
    entries = write_capture(tmp_path, frames=2)
    for entry in entries[:5]:
        (tmp_path / entry["file_path"]).unlink()
    with pytest.raises(InvalidCapture, match="only 3 of its 8"):
        opened(tmp_path)


def test_masks_say_which_pixels_count(tmp_path: Path) -> None:
    entries = write_capture(tmp_path)
    mask = np.full((16, 16, 3), 255, np.uint8)
    mask[:5, :3] = 0
    (tmp_path / "mask.png").write_bytes(encode_png(mask))
    entries[2]["mask_path"] = "mask.png"
    save(tmp_path, entries)
    counts = opened(tmp_path).read(0).counts
    assert counts is not None
    assert counts[[0, 1, 3]].all()
    np.testing.assert_array_equal(counts[2], mask[:, :, 0] > 0)
    small = opened(tmp_path).read(0, 2).counts
    assert small is not None
    assert (~small[2]).sum() == 3 * 2  # a pixel counts where all that it was made of do


@pytest.mark.parametrize(
    ("mask", "said"), [("gone.png", "not there"), ("../mask.png", "climbs out"), ("small.png", "8 x 8")]
)
def test_a_broken_mask_is_named(tmp_path: Path, mask: str, said: str) -> None:
    entries = write_capture(tmp_path)
    (tmp_path / "small.png").write_bytes(encode_png(np.zeros((8, 8, 3), np.uint8)))
    entries[0]["mask_path"] = mask
    save(tmp_path, entries)
    with pytest.raises(InvalidCapture, match=said):
        opened(tmp_path).read(0)


def test_each_camera_may_have_a_lens_of_its_own(tmp_path: Path) -> None:
    entries = write_capture(tmp_path)
    entries[1] |= {"camera_model": "OPENCV_FISHEYE", "fl_x": 9.0, "fl_y": 9.5, "k1": 0.02, "k4": -0.001}
    entries[2] |= {"camera_model": "OPENCV", "k1": -0.1, "p1": 0.001, "k3": 0.002}
    save(tmp_path, entries)
    cameras = opened(tmp_path).rig.cameras
    assert [camera.model for camera in cameras] == ["pinhole", "fisheye", "opencv", "pinhole"]
    assert (cameras[1].focal_x, cameras[1].focal_y) == (9.0, 9.5)
    assert cameras[1].distortion == (0.02, 0.0, 0.0, -0.001, 0.0, 0.0)
    assert cameras[2].distortion == (-0.1, 0.0, 0.002, 0.0, 0.001, 0.0)


def test_a_rig_that_moves_is_refused(tmp_path: Path) -> None:
    entries = write_capture(tmp_path, frames=2)
    pose = np.array(entries[6]["transform_matrix"])
    pose[0, 3] += 0.4
    entries[6]["transform_matrix"] = pose.tolist()
    save(tmp_path, entries)
    with pytest.raises(InvalidCapture, match=r"cam02.*moved"):
        opened(tmp_path)


def test_cameras_that_look_away_are_refused(tmp_path: Path) -> None:
    entries = write_capture(tmp_path, cameras=6)
    for entry in entries:  # OpenCV's axes taken for OpenGL's
        entry["transform_matrix"] = (np.array(entry["transform_matrix"]) @ np.diag([1.0, -1, -1, 1])).tolist()
    save(tmp_path, entries)
    with pytest.raises(InvalidCapture, match="look away") as caught:
        opened(tmp_path)
    assert "OpenGL" in str(caught.value.hint)


def test_a_camera_with_pictures_of_two_sizes_is_refused(tmp_path: Path) -> None:
    entries = write_capture(tmp_path, frames=2)
    (tmp_path / entries[5]["file_path"]).write_bytes(encode_png(np.zeros((8, 16, 3), np.uint8)))
    with pytest.raises(InvalidCapture, match="16 x 8 pixels where its camera 'cam01'"):
        opened(tmp_path).check(lambda *_: None)


def test_a_decompression_bomb_is_refused_by_its_header(tmp_path: Path) -> None:
    entries = write_capture(tmp_path)
    path = tmp_path / entries[1]["file_path"]
    header = struct.pack(">IIBBBBB", 60_000, 60_000, 8, 2, 0, 0, 0)
    chunk = b"IHDR" + header
    end = b"\x00\x00\x00\x00IEND" + struct.pack(">I", zlib.crc32(b"IEND"))
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + struct.pack(">I", 13) + chunk + struct.pack(">I", zlib.crc32(chunk)) + end)
    assert path.stat().st_size < 100
    with pytest.raises(InvalidCapture, match="cam01") as caught:
        opened(tmp_path)
    assert "pixels" in caught.value.message


def test_sixteen_bits_keep_their_brightness_and_clear_pixels_are_white(tmp_path: Path) -> None:
    entries = write_capture(tmp_path)
    Image.fromarray(np.full((16, 16), 0x8000, np.uint16)).save(tmp_path / entries[0]["file_path"])
    clear = np.zeros((16, 16, 4), np.uint8)
    clear[:8, :, :] = [200, 10, 10, 255]
    Image.fromarray(clear).save(tmp_path / entries[1]["file_path"])
    images = opened(tmp_path).read(0).images
    assert (images[0] == 0x80).all()
    assert (images[1, :8] == [200, 10, 10]).all()
    assert (images[1, 8:] == 255).all()


def test_times_must_increase(tmp_path: Path) -> None:
    entries = write_capture(tmp_path, frames=2)
    save(tmp_path, [entry | {"time_s": 0.5} for entry in entries], frame_rate_hz=30)
    with pytest.raises(InvalidCapture, match="do not increase"):
        opened(tmp_path)


def test_a_frame_keeps_its_masks_and_region_in_a_file(tmp_path: Path) -> None:
    write_capture(tmp_path)
    frame = opened(tmp_path).read(0)
    counts = np.ones(frame.images.shape[:3], dtype=bool)
    counts[1, 2:7, 3] = False
    told = replace(frame, counts=counts, region=np.array([[0.0, 0.1, 0.2], [1.0, 1.1, 1.2]]))
    write_frame(tmp_path / "frame.zip", told)
    back = read_stored(tmp_path / "frame.zip")
    np.testing.assert_array_equal(back.counts, counts)
    np.testing.assert_array_equal(back.region, told.region)
