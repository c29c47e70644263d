"""Captures as found in the wild, and what is wrong with broken ones: the file and the remedy are named."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from nerfmodal.capture import check_pictures, open_capture, read_frame, split_held_out
from nerfmodal.errors import InvalidCapture
from nerfmodal.geometry.cameras import semi_spherical_rig
from nerfmodal.io.frames import encode_png
from nerfmodal.io.transforms import camera_entry
from nerfmodal.spec import RigSpec

FOX = Path(__file__).parents[3] / ".." / "shared" / "captures" / "fox"
Entries = list[dict[str, Any]]


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
    capture = open_capture(tmp_path)
    assert capture.times == (0.0, 1 / 30, 2 / 30)
    assert [len(views) for views in capture.frames] == [4, 4, 4]
    assert read_frame(capture, 2).images.shape == (4, 16, 16, 3)


def test_a_smaller_picture_keeps_its_rays(tmp_path: Path) -> None:
    write_capture(tmp_path)
    frame = read_frame(open_capture(tmp_path), 0, shrink=2)
    full = read_frame(open_capture(tmp_path), 0)
    assert frame.images.shape == (4, 8, 8, 3)
    assert frame.rig.cameras[0].focal_x == full.rig.cameras[0].focal_x / 2


def test_absent_pictures_are_left_out_and_named(tmp_path: Path) -> None:
    entries = write_capture(tmp_path)
    save(tmp_path, [*entries, entries[0] | {"file_path": "images/gone.png", "camera_id": "gone"}])
    assert open_capture(tmp_path).absent == ("images/gone.png",)


def test_every_nth_view_is_held_out(tmp_path: Path) -> None:
    write_capture(tmp_path, cameras=9)
    trained, held = split_held_out(read_frame(open_capture(tmp_path), 0), 8)
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
        open_capture(folder)
    assert caught.value.where
    assert caught.value.hint


def test_no_transforms_means_no_poses(tmp_path: Path) -> None:
    with pytest.raises(InvalidCapture, match="no poses"):
        open_capture(tmp_path)


@pytest.mark.parametrize("content", ["{", "[]", '{"frames": []}'])
def test_a_broken_file_is_named(tmp_path: Path, content: str) -> None:
    (tmp_path / "transforms.json").write_text(content)
    with pytest.raises(InvalidCapture, match=r"transforms\.json"):
        open_capture(tmp_path)


def test_two_cameras_are_too_few(tmp_path: Path) -> None:
    entries = write_capture(tmp_path)
    save(tmp_path, entries[:2])
    with pytest.raises(InvalidCapture, match="only 2"):
        open_capture(tmp_path)


def test_pictures_of_two_sizes_are_refused(tmp_path: Path) -> None:
    entries = write_capture(tmp_path)
    (tmp_path / entries[0]["file_path"]).write_bytes(encode_png(np.zeros((8, 16, 3), np.uint8)))
    entries[0]["h"] = 8
    save(tmp_path, entries)
    with pytest.raises(InvalidCapture, match="different sizes"):
        open_capture(tmp_path)


def test_a_truncated_picture_is_named(tmp_path: Path) -> None:
    entries = write_capture(tmp_path)
    path = tmp_path / entries[1]["file_path"]
    path.write_bytes(path.read_bytes()[:-300])
    with pytest.raises(InvalidCapture, match="cam01"):
        check_pictures(open_capture(tmp_path))


def test_a_file_that_is_no_picture_is_named(tmp_path: Path) -> None:
    entries = write_capture(tmp_path)
    (tmp_path / entries[2]["file_path"]).write_bytes(b"")
    with pytest.raises(InvalidCapture, match="cam02"):
        open_capture(tmp_path)


@pytest.mark.skipif(not FOX.is_dir(), reason="the photographs of ../shared/captures/fox are not here")
def test_the_fox_has_fifty_of_its_sixty_seven_pictures() -> None:
    capture = open_capture(FOX)
    assert (len(capture.frames), len(capture.frames[0]), len(capture.absent)) == (1, 50, 17)
    assert capture.frames[0][0].camera.model == "opencv"
