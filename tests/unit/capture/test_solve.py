"""Cameras solved from textured walls and a floor, whose true rig is known; and pictures that cannot be solved."""

from pathlib import Path

import numpy as np
import pytest
from nerfmodal.capture import open_capture
from nerfmodal.capture.metric import similarity
from nerfmodal.capture.solve import moved, turn_to_z
from nerfmodal.errors import InvalidCapture
from nerfmodal.geometry.cameras import look_at, unproject
from nerfmodal.geometry.rays import pixel_centers
from nerfmodal.io.frames import encode_png
from nerfmodal.spec import CaptureSource
from nerfmodal.types import Camera
from scipy.ndimage import gaussian_filter, map_coordinates

pytest.importorskip("pycolmap", reason="pycolmap is not installed: pip install 'nerfmodal[capture]'")
TEXELS = 150
"""Texture samples a metre."""


def rig(count: int) -> list[Camera]:
    """Cameras on an arc of 75 degrees before a corner of the room."""
    cameras = []
    for k, turn in enumerate(np.radians(np.linspace(-82, -7, count))):
        place = np.array([2.4 * np.cos(turn), 2.4 * np.sin(turn), 1.0 + 0.3 * (k % 2)])
        cameras.append(
            Camera(
                name=f"cam{k}",
                width=320,
                height=240,
                focal_x=300.0,
                focal_y=300.0,
                center_x=160.0,
                center_y=120.0,
                camera_to_world=look_at(place, np.array([-0.3, 0.3, 0.5])),
            )
        )
    return cameras


def picture(camera: Camera, textures: list[np.ndarray]) -> np.ndarray:
    """What a camera sees of the planes z = 0, x = -1 and y = 1, each with a texture."""
    rays = unproject(camera, pixel_centers(camera))
    place = camera.camera_to_world[:3, 3]
    best, color = np.full(len(rays), np.inf), np.zeros(len(rays))
    for axis, level, texture in ((2, 0.0, textures[0]), (0, -1.0, textures[1]), (1, 1.0, textures[2])):
        with np.errstate(divide="ignore"):
            depth = (level - place[axis]) / rays[:, axis]
        nearer = (depth > 0) & (depth < best)
        spots = np.delete(place + depth[nearer, None] * rays[nearer], axis, axis=1) * TEXELS
        color[nearer] = map_coordinates(texture, spots.T, order=1, mode="wrap")
        best[nearer] = depth[nearer]
    return np.repeat(color.reshape(camera.height, camera.width, 1), 3, axis=2).clip(0, 255).astype(np.uint8)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    rng = np.random.default_rng(0)
    textures = []
    for _ in range(3):
        layers = [s * gaussian_filter(rng.normal(size=(600, 600)), s, mode="wrap") for s in (1.0, 2.5, 6.0)]
        textures.append(127 + 110 * np.sum(layers, axis=0))
    below = tmp_path_factory.mktemp("capture")
    for camera in rig(6):
        (below / f"{camera.name}.png").write_bytes(encode_png(picture(camera, textures)))
    return below


def test_pictures_without_poses_are_solved_and_brought_to_metres(folder: Path, tmp_path: Path) -> None:
    true = np.array([camera.camera_to_world[:3, 3] for camera in rig(6)])
    apart = float(np.linalg.norm(true[0] - true[5]))
    scale = {"kind": "cameras", "between": ["cam0", "cam5"], "distance_m": apart}
    source = CaptureSource.model_validate({"kind": "capture", "path": str(folder), "scale": scale, "one_lens": True})
    capture = open_capture(source, tmp_path)
    found = np.array([camera.camera_to_world[:3, 3] for camera in capture.rig.cameras])
    size, rotation, shift = similarity(found, true)
    assert size == pytest.approx(1.0, abs=5e-3)
    np.testing.assert_allclose(size * found @ rotation.T + shift, true, atol=0.02)
    assert capture.rig.cameras[0].focal_x == pytest.approx(300.0, rel=0.01)
    assert rotation[2, 2] > np.cos(np.radians(25))  # +z is up, as far as the cameras tell
    kept = list(tmp_path.glob("rig_*.json"))
    assert len(kept) == 1
    again = open_capture(source, tmp_path)
    for one, other in zip(capture.rig.cameras, again.rig.cameras, strict=True):
        np.testing.assert_array_equal(one.camera_to_world, other.camera_to_world)


def test_pictures_of_nothing_are_refused(tmp_path: Path) -> None:
    for k in range(3):
        (tmp_path / f"cam{k}.png").write_bytes(encode_png(np.full((60, 80, 3), 30 * k, np.uint8)))
    with pytest.raises(InvalidCapture, match="cannot be solved") as caught:
        open_capture(CaptureSource(kind="capture", path=str(tmp_path)), tmp_path / "out")
    assert "textured" in str(caught.value.hint)
    assert not (tmp_path / "out").exists()


def test_who_is_told_can_stop_it(tmp_path: Path) -> None:
    for k in range(3):
        (tmp_path / f"cam{k}.png").write_bytes(encode_png(np.full((60, 80, 3), 30 * k, np.uint8)))

    def stop(what: str) -> None:
        raise KeyboardInterrupt(what)

    with pytest.raises(KeyboardInterrupt, match="finding features"):
        open_capture(CaptureSource(kind="capture", path=str(tmp_path)), tmp_path / "out", stop)


def test_a_world_is_turned_to_its_up() -> None:
    for up in ([0.0, 0.0, 1.0], [0.0, 0.0, -1.0], [0.6, 0.0, 0.8], [1.0, 0.0, 0.0]):
        turn = turn_to_z(np.array(up))
        np.testing.assert_allclose(turn @ up, [0, 0, 1], atol=1e-12)
        np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)


def test_a_moved_world_looks_the_same() -> None:
    camera = rig(3)[1]
    turn = turn_to_z(np.array([0.6, 0.0, 0.8]))
    (other,) = moved([camera], 2.0, turn, np.array([1.0, 2.0, 3.0]))
    ray = unproject(camera, np.array([[10.0, 20.0]]))[0]
    seen = 2.0 * turn @ (camera.camera_to_world[:3, 3] + 1.5 * ray) + [1.0, 2.0, 3.0]
    again = other.camera_to_world[:3, 3] + 3.0 * unproject(other, np.array([[10.0, 20.0]]))[0]
    np.testing.assert_allclose(again, seen)
