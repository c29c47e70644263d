"""Videos written here with time stamps, losses, repeats and sound that are known."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from nerfmodal.capture import Capture, open_capture
from nerfmodal.capture.video import read_stamps
from nerfmodal.errors import InvalidCapture
from nerfmodal.spec import CaptureSource
from nerfmodal.types import Frame

from tests.fixtures.formats import RATE, drawn, write_dynerf, write_rig_and_videos, write_video, write_videos

FRAMES = 24
NOISE = 2.5
"""Grey levels, root mean square, that the codec leaves."""


@pytest.fixture(scope="module")
def film() -> list[Frame]:
    return drawn(frames=FRAMES)


def opened(folder: Path, **options: Any) -> Capture:
    return open_capture(CaptureSource.model_validate({"kind": "capture", "path": str(folder), **options}))


def rewrite(folder: Path, film: list[Frame], camera: int, kept: list[int], shift: float = 0.0, **more: Any) -> None:
    """The video of a camera again, of the frames `kept` alone, on a clock that shows `shift` s more."""
    name = film[0].rig.cameras[camera].name
    pictures = [film[k].images[camera] for k in kept]
    write_video(folder / f"{name}.mp4", pictures, [film[k].time + shift for k in kept], **more)


def is_picture(capture: Capture, index: int, camera: int, true: np.ndarray) -> bool:
    frame = capture.read(index)
    names = [one.name for one in frame.rig.cameras]
    seen = frame.images[names.index(f"cam{camera:02d}")].astype(float)
    return bool(np.sqrt(((seen - true) ** 2).mean()) < NOISE)


def test_a_lost_picture_is_missing_and_every_other_stays_in_its_place(tmp_path: Path, film: list[Frame]) -> None:
    write_rig_and_videos(tmp_path, film)
    rewrite(tmp_path, film, 2, [k for k in range(FRAMES) if k not in (5, 6, 17)])
    capture = opened(tmp_path)
    assert capture.missing == (("cam02", 5), ("cam02", 6), ("cam02", 17))
    assert [camera.name for camera in capture.read(5).rig.cameras] == ["cam00", "cam01", "cam03"]
    for index in (4, 7, 16, 18, 3):
        assert is_picture(capture, index, 2, film[index].images[2])


def test_a_picture_that_fills_in_for_a_lost_one_is_missing(tmp_path: Path, film: list[Frame]) -> None:
    write_rig_and_videos(tmp_path, film)
    name = film[0].rig.cameras[1].name
    pictures = [film[8 if k == 9 else k].images[1] for k in range(FRAMES)]
    write_video(tmp_path / f"{name}.mp4", pictures, [one.time for one in film])
    assert opened(tmp_path).missing == (("cam01", 9),)


def test_given_offsets_bring_late_cameras_together(tmp_path: Path, film: list[Frame]) -> None:
    write_rig_and_videos(tmp_path, film)
    rewrite(tmp_path, film, 3, list(range(4, FRAMES)), shift=0.613)
    capture = opened(tmp_path, offsets_s={"cam03": 0.605})
    assert len(capture) == FRAMES - 4
    assert is_picture(capture, 0, 3, film[4].images[3])
    assert is_picture(capture, 9, 0, film[13].images[0])
    clock = capture.clocks[3]
    assert (clock.camera, clock.found_by) == ("cam03", "given")
    assert clock.residual == pytest.approx(0.008, abs=1e-4)  # reported, not hidden


def test_sound_brings_cameras_together(tmp_path: Path, film: list[Frame]) -> None:
    """Everybody hears the same noise; each camera began at another moment."""
    rng = np.random.default_rng(0)
    noise = 0.2 * rng.normal(size=16_000 * 3)
    began = [0, 3, 5, 1]
    write_rig_and_videos(tmp_path, film)
    for camera, k in enumerate(began):
        start = round(16_000 * k / RATE)
        heard = noise[start : start + 16_000] + 0.02 * rng.normal(size=16_000)
        rewrite(tmp_path, film, camera, list(range(k, FRAMES)), shift=-k / RATE, sound=heard)
    (tmp_path / "rig.json").write_text(json.dumps(without_offsets(tmp_path)))
    capture = opened(tmp_path)
    assert {clock.found_by for clock in capture.clocks} == {"audio"}
    for clock, k in zip(capture.clocks, began, strict=True):
        assert clock.offset == pytest.approx((began[0] - k) / RATE, abs=0.003)
    for camera in range(4):
        assert is_picture(capture, 0, camera, film[5].images[camera])


def without_offsets(folder: Path) -> dict[str, Any]:
    document: dict[str, Any] = json.loads((folder / "rig.json").read_text())
    for entry in document["cameras"]:
        del entry["offset_s"]
    return document


def test_what_was_found_is_kept_and_read_again(tmp_path: Path, film: list[Frame]) -> None:
    write_rig_and_videos(tmp_path / "capture", film)
    source = CaptureSource(kind="capture", path=str(tmp_path / "capture"))
    told: list[str] = []
    first = open_capture(source, tmp_path / "out", told.append)
    assert len(told) == 4
    again = open_capture(source, tmp_path / "out", told.append)
    assert len(told) == 4
    assert again.times == first.times
    assert again.pictures == first.pictures
    assert not (tmp_path / "capture/.nerfmodal").exists()
    open_capture(source.model_copy(update={"synchronise": "clocks"}), tmp_path / "out", told.append)
    assert len(told) == 8  # another question has another answer


def test_pictures_of_another_size_scale_the_lens(tmp_path: Path, film: list[Frame]) -> None:
    write_rig_and_videos(tmp_path, film)
    document = json.loads((tmp_path / "rig.json").read_text())
    for entry in document["cameras"]:
        for key in ("w", "h", "fl_x", "fl_y", "cx", "cy"):
            entry[key] *= 2
    (tmp_path / "rig.json").write_text(json.dumps(document))
    camera = opened(tmp_path).rig.cameras[0]
    true = film[0].rig.cameras[0]
    assert (camera.width, camera.focal_x, camera.center_y) == (true.width, true.focal_x, true.center_y)


def test_a_video_that_is_no_video_is_named(tmp_path: Path, film: list[Frame]) -> None:
    write_rig_and_videos(tmp_path, film)
    for content in (b"", b"not a video at all", (tmp_path / "cam01.mp4").read_bytes()[:900]):
        (tmp_path / "cam01.mp4").write_bytes(content)
        with pytest.raises(InvalidCapture, match=r"cam01\.mp4.*cannot be decoded") as caught:
            opened(tmp_path)
        assert "ffmpeg" in str(caught.value.hint)
    assert not (tmp_path / ".nerfmodal").exists()  # nothing half-written


def test_a_video_broken_in_the_middle_is_named(tmp_path: Path, film: list[Frame]) -> None:
    write_rig_and_videos(tmp_path, film)
    path = tmp_path / "cam02.mp4"
    content = bytearray(path.read_bytes())
    start = content.index(b"mdat") + 4
    middle = start + (len(content) - start) // 3
    content[middle : middle + 4000] = b"\xff" * 4000
    path.write_bytes(bytes(content))
    with pytest.raises(InvalidCapture, match=r"cam02\.mp4"):
        opened(tmp_path)


def test_a_camera_without_video_is_named(tmp_path: Path, film: list[Frame]) -> None:
    write_rig_and_videos(tmp_path, film)
    (tmp_path / "cam03.mp4").unlink()
    with pytest.raises(InvalidCapture, match="'cam03' has no video") as caught:
        opened(tmp_path)
    assert "rig.json#/cameras/3" in str(caught.value.where)


def test_dynerf_needs_a_row_for_every_video(tmp_path: Path, film: list[Frame]) -> None:
    write_dynerf(tmp_path, film)
    (tmp_path / "cam03.mp4").unlink()
    with pytest.raises(InvalidCapture, match="4 poses for 3 cameras"):
        opened(tmp_path)


@pytest.mark.parametrize(
    ("change", "said"),
    [(np.nan, "finite"), (0.0, "positive"), (-40.0, "positive")],
)
def test_dynerf_with_broken_numbers_names_the_row(tmp_path: Path, film: list[Frame], change: float, said: str) -> None:
    write_dynerf(tmp_path, film)
    rows = np.load(tmp_path / "poses_bounds.npy")
    rows[2, 0 if np.isnan(change) else 14] = change
    np.save(tmp_path / "poses_bounds.npy", rows)
    with pytest.raises(InvalidCapture, match=said) as caught:
        opened(tmp_path)
    assert "row 2" in str(caught.value.where)


@pytest.mark.parametrize("content", [b"", b"\x93NUMPY\x01\x00garbage"])
def test_dynerf_with_a_broken_file_is_named(tmp_path: Path, film: list[Frame], content: bytes) -> None:
    write_videos(tmp_path, film[:2])
    (tmp_path / "poses_bounds.npy").write_bytes(content)
    with pytest.raises(InvalidCapture, match="poses_bounds"):
        opened(tmp_path)


def test_a_full_disk_leaves_nothing(tmp_path: Path, film: list[Frame], monkeypatch: pytest.MonkeyPatch) -> None:
    write_rig_and_videos(tmp_path, film)

    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(InvalidCapture, match="No space left"):
        opened(tmp_path)
    assert list((tmp_path / ".nerfmodal").iterdir()) == []


def test_time_stamps_are_the_containers_own(tmp_path: Path, film: list[Frame]) -> None:
    times = np.cumsum(np.random.default_rng(1).uniform(0.02, 0.06, FRAMES))
    write_video(tmp_path / "a.mp4", [one.images[0] for one in film], times.tolist())
    stamps = read_stamps(tmp_path / "a.mp4").times
    np.testing.assert_allclose(np.diff(stamps), np.diff(times), atol=3e-5)
    assert stamps[0] == pytest.approx(times[0], abs=6e-4)  # MP4 writes the start in milliseconds
