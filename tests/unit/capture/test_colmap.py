"""COLMAP models of every camera model that is read, held to pycolmap's own projection; and broken ones."""

from pathlib import Path

import numpy as np
import pytest
from nerfmodal.capture import Capture, open_capture
from nerfmodal.capture.colmap import COUNTS, lens_of, read_model, rotation_of
from nerfmodal.errors import InvalidCapture
from nerfmodal.geometry.cameras import project
from nerfmodal.io.frames import encode_png
from nerfmodal.spec import CaptureSource
from nerfmodal.types import Camera, Frame

from tests.fixtures.formats import colmap_pose, drawn, write_colmap_text, write_videos

PARAMETERS = {
    "SIMPLE_PINHOLE": [50.0, 31.0, 23.0],
    "PINHOLE": [50.0, 52.0, 31.0, 23.0],
    "SIMPLE_RADIAL": [50.0, 31.0, 23.0, 0.08],
    "RADIAL": [50.0, 31.0, 23.0, 0.08, -0.02],
    "OPENCV": [50.0, 52.0, 31.0, 23.0, 0.08, -0.02, 0.003, -0.001],
    "OPENCV_FISHEYE": [50.0, 52.0, 31.0, 23.0, 0.04, -0.01, 0.003, -0.001],
}


@pytest.fixture(scope="module")
def film() -> list[Frame]:
    return drawn(frames=3)


def opened(folder: Path, **options: object) -> Capture:
    return open_capture(CaptureSource.model_validate({"kind": "capture", "path": str(folder), **options}))


@pytest.mark.parametrize("model", COUNTS)
def test_points_fall_where_colmap_says(model: str) -> None:
    pycolmap = pytest.importorskip("pycolmap", reason="pycolmap is not installed: pip install 'nerfmodal[capture]'")
    theirs = pycolmap.Camera(model=model, width=64, height=48, params=PARAMETERS[model])
    lens = lens_of(model, 64, 48, tuple(PARAMETERS[model]), "here")
    ours = Camera(
        name="a",
        width=64,
        height=48,
        focal_x=lens.focal[0],
        focal_y=lens.focal[1],
        center_x=lens.center[0],
        center_y=lens.center[1],
        camera_to_world=np.diag([1.0, -1.0, -1.0, 1.0]),
        model=lens.model,
        distortion=lens.distortion,
    )
    points = np.random.default_rng(0).uniform([-0.5, -0.5, 0.9], [0.5, 0.5, 2.0], (30, 3))
    np.testing.assert_allclose(project(ours, points)[0], theirs.img_from_cam(points), atol=1e-9)


def test_a_quaternion_turns_as_its_matrix() -> None:
    rng = np.random.default_rng(0)
    for _ in range(20):
        rotation = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        rotation *= np.sign(np.linalg.det(rotation))
        pose = np.eye(4)
        pose[:3, :3] = rotation @ np.diag([1.0, -1.0, -1.0])
        camera = Camera(
            name="a",
            width=1,
            height=1,
            focal_x=1.0,
            focal_y=1.0,
            center_x=0.0,
            center_y=0.0,
            camera_to_world=pose,
        )
        np.testing.assert_allclose(rotation_of(colmap_pose(camera)[:4]), rotation.T, atol=1e-9)


def test_a_still_scene_has_one_camera_for_each_picture(tmp_path: Path, film: list[Frame]) -> None:
    write_colmap_text(tmp_path, film[:1])
    images = tmp_path / "images"
    for camera in film[0].rig.cameras:
        (images / camera.name / "0000.png").rename(images / f"{camera.name}.png")
        (images / camera.name).rmdir()
    text = (tmp_path / "sparse/0/images.txt").read_text()
    (tmp_path / "sparse/0/images.txt").write_text(text.replace("/0000.png", ".png"))
    capture = opened(tmp_path)
    assert [camera.name for camera in capture.rig.cameras] == ["cam00", "cam01", "cam02", "cam03"]
    assert len(capture) == 1


def test_videos_take_the_poses_of_their_first_pictures(tmp_path: Path, film: list[Frame]) -> None:
    write_colmap_text(tmp_path / "solved", film[:1])
    write_videos(tmp_path / "capture", film)
    (tmp_path / "solved/sparse").rename(tmp_path / "capture/sparse")
    text = (tmp_path / "capture/sparse/0/images.txt").read_text()
    (tmp_path / "capture/sparse/0/images.txt").write_text(text.replace("/0000.png", ".png"))
    capture = opened(tmp_path / "capture", synchronise="clocks")
    assert (len(capture), capture.missing) == (3, ())


def test_a_model_that_lacks_half_of_the_pictures_is_refused(tmp_path: Path, film: list[Frame]) -> None:
    write_colmap_text(tmp_path, film)
    path = tmp_path / "sparse/0/images.txt"
    path.write_text("\n".join(path.read_text().splitlines()[:6]) + "\n")  # two of four
    with pytest.raises(InvalidCapture, match=r"poses for 2 of 4 cameras; without: cam02, cam03") as caught:
        opened(tmp_path, frame_rate_hz=25)
    assert "overlap" in str(caught.value.hint)


def test_a_picture_without_a_pose_is_absent(tmp_path: Path, film: list[Frame]) -> None:
    write_colmap_text(tmp_path, film)
    (tmp_path / "images/extra").mkdir()
    (tmp_path / "images/extra/0000.png").write_bytes(encode_png(film[0].images[0]))
    assert opened(tmp_path, frame_rate_hz=25).absent == ("extra",)


def test_copies_and_masks_are_no_cameras(tmp_path: Path, film: list[Frame]) -> None:
    write_colmap_text(tmp_path, film)
    for name in ("images_4", "masks", ".thumbnails"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "0000.png").write_bytes(encode_png(film[0].images[0]))
    capture = opened(tmp_path, frame_rate_hz=25)
    assert (len(capture.rig.cameras), capture.absent) == (4, ())


def test_folders_need_a_rate(tmp_path: Path, film: list[Frame]) -> None:
    write_colmap_text(tmp_path, film)
    with pytest.raises(InvalidCapture, match="no times"):
        opened(tmp_path)


def test_a_gap_in_the_numbers_is_a_missing_picture(tmp_path: Path, film: list[Frame]) -> None:
    write_colmap_text(tmp_path, film)
    (tmp_path / "images/cam02/0001.png").unlink()
    assert opened(tmp_path, frame_rate_hz=25).missing == (("cam02", 1),)


def test_counts_that_differ_without_numbers_are_refused(tmp_path: Path, film: list[Frame]) -> None:
    write_colmap_text(tmp_path, film)
    for number, letter in enumerate("abc"):
        for camera in film[0].rig.cameras:
            folder = tmp_path / "images" / camera.name
            (folder / f"{number:04d}.png").rename(folder / f"{letter}.png")
    (tmp_path / "images/cam02/b.png").unlink()
    with pytest.raises(InvalidCapture, match=r"'cam02' has 2 pictures and 'cam00' has 3") as caught:
        opened(tmp_path, frame_rate_hz=25)
    assert "number" in str(caught.value.hint)


@pytest.mark.parametrize(
    ("file", "content", "said"),
    [
        ("cameras.txt", "1 FOV 64 48 50 50 32 24 0.1\n", "camera model FOV"),
        ("cameras.txt", "1 PINHOLE 64\n", "no COLMAP model"),
        ("cameras.txt", "2 PINHOLE 64 48 50 50 32 24\n", "no COLMAP model"),
        ("images.txt", "1 nan 0 0 0 0 0 0 1 cam00/0000.png\n\n", "not finite"),
        ("images.txt", "1 1 0 0 0\n\n", "no COLMAP model"),
    ],
)
def test_a_broken_model_is_named(tmp_path: Path, film: list[Frame], file: str, content: str, said: str) -> None:
    write_colmap_text(tmp_path, film[:1])
    (tmp_path / "sparse/0" / file).write_text(content)
    with pytest.raises(InvalidCapture, match=said) as caught:
        opened(tmp_path)
    assert "sparse/0" in str(caught.value.where)


def test_half_a_model_is_named(tmp_path: Path, film: list[Frame]) -> None:
    write_colmap_text(tmp_path, film[:1])
    (tmp_path / "sparse/0/images.txt").unlink()
    with pytest.raises(InvalidCapture, match=r"images\.txt"):
        opened(tmp_path)


def test_a_truncated_binary_model_is_named(tmp_path: Path) -> None:
    (tmp_path / "cameras.bin").write_bytes(b"\x01\x00\x00")
    (tmp_path / "images.bin").write_bytes(b"")
    with pytest.raises(InvalidCapture, match="no COLMAP model"):
        read_model(tmp_path)
