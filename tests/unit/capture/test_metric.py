"""Metres out of distances whose truth is known: cameras in another unit come back to where they were."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from nerfmodal.capture import open_capture
from nerfmodal.capture.metric import board_points, in_metres, similarity, triangulate
from nerfmodal.capture.solve import moved, turn_to_z
from nerfmodal.errors import InvalidCapture, InvalidSpec
from nerfmodal.geometry.cameras import look_at, project, semi_spherical_rig, unproject
from nerfmodal.spec import CameraDistance, CaptureSource, Checkerboard, PointDistance, RigSpec
from nerfmodal.types import Camera

from tests.fixtures.formats import drawn, write_transforms

RIG = semi_spherical_rig(RigSpec(cameras=5, width_px=320, height_px=240, radius_m=1.2, target_m=(0.05, 0.03, 0.0)))
UNKNOWN = 3.7
"""Units of the solved world in a metre."""
BOARD = Checkerboard(kind="checkerboard", columns=7, rows=5, square_m=0.06)


def solved() -> tuple[Camera, ...]:
    """The rig as structure from motion might give it: another unit, turned and shifted."""
    turn = turn_to_z(np.array([0.48, 0.6, 0.64]))
    return moved(RIG.cameras, UNKNOWN, turn, np.array([1.0, -2.0, 0.5]))


def distances(cameras: tuple[Camera, ...]) -> np.ndarray:
    places = np.array([camera.camera_to_world[:3, 3] for camera in cameras])
    return np.linalg.norm(places[:, None] - places, axis=2)


def test_the_distance_of_two_cameras_gives_metres() -> None:
    true = distances(RIG.cameras)
    scale = CameraDistance(kind="cameras", between=("cam01", "cam03"), distance_m=float(true[1, 3]))
    np.testing.assert_allclose(distances(in_metres(solved(), scale, {}, "here")), true)


def test_the_distance_of_two_points_gives_metres() -> None:
    points = np.array([[0.1, 0.0, 0.2], [-0.2, 0.1, 0.5]])
    pixels = {camera.name: project(camera, points)[0] for camera in RIG.cameras[:3]}
    scale = PointDistance(
        kind="points",
        first_px={name: tuple(seen[0]) for name, seen in pixels.items()},
        second_px={name: tuple(seen[1]) for name, seen in pixels.items()},
        distance_m=float(np.linalg.norm(points[0] - points[1])),
    )
    np.testing.assert_allclose(distances(in_metres(solved(), scale, {}, "here")), distances(RIG.cameras))


def test_a_checkerboard_gives_metres_an_origin_and_an_up() -> None:
    pytest.importorskip("cv2", reason="opencv-python-headless is not installed: pip install 'nerfmodal[capture]'")
    overhead = [look_at(np.array(place), np.array([0.18, 0.12, 0.0])) for place in VIEWS]
    cameras = tuple(replace(RIG.cameras[k], camera_to_world=pose) for k, pose in enumerate(overhead))
    pictures = {camera.name: board_picture(camera) for camera in cameras}
    unknown = moved(cameras, UNKNOWN, turn_to_z(np.array([0.48, 0.6, 0.64])), np.array([1.0, -2.0, 0.5]))
    found = in_metres(unknown, BOARD, pictures, "here")
    np.testing.assert_allclose(distances(found), distances(cameras), rtol=2e-3)
    heights = [camera.camera_to_world[2, 3] for camera in found]
    np.testing.assert_allclose(heights, [place[2] for place in VIEWS], rtol=4e-3)


VIEWS = [(0.5, 0.0, 0.7), (0.0, 0.5, 0.8), (-0.2, -0.2, 0.7), (0.5, 0.4, 0.75), (0.2, 0.1, 0.9)]


def board_picture(camera: Camera) -> np.ndarray:
    """Nine rays a pixel to the plane z = 0, where a board of white and black squares lies on grey."""
    total = np.zeros(camera.height * camera.width)
    columns, rows = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    for across in (1, 3, 5):
        for down in (1, 3, 5):
            pixels = np.stack([columns.ravel() + across / 6, rows.ravel() + down / 6], axis=1)
            rays = unproject(camera, pixels)
            spots = camera.camera_to_world[:3, 3] - rays * (camera.camera_to_world[2, 3] / rays[:, 2])[:, None]
            squares = np.floor(spots[:, :2] / BOARD.square_m).astype(int) + 1
            inside = (squares >= 0).all(axis=1) & (squares[:, 0] <= BOARD.columns) & (squares[:, 1] <= BOARD.rows)
            total += np.where(inside, np.where(squares.sum(axis=1) % 2, 230.0, 20.0), 230.0)
    grey = (total / 9).reshape(camera.height, camera.width)
    return np.repeat(grey[:, :, None], 3, axis=2).astype(np.uint8)


def test_a_board_that_nobody_sees_is_refused() -> None:
    pytest.importorskip("cv2", reason="opencv-python-headless is not installed: pip install 'nerfmodal[capture]'")
    nothing = {camera.name: np.zeros((240, 320, 3), np.uint8) for camera in RIG.cameras}
    with pytest.raises(InvalidCapture, match="found in 0 of 5") as caught:
        in_metres(solved(), BOARD, nothing, "here")
    assert "inner corners" in str(caught.value.hint)


def test_an_unknown_camera_is_named() -> None:
    scale = CameraDistance(kind="cameras", between=("cam01", "left"), distance_m=1.0)
    with pytest.raises(InvalidSpec, match="'left'") as caught:
        in_metres(solved(), scale, {}, "here")
    assert caught.value.where == "/source/scale/between"


def test_one_picture_is_no_triangulation() -> None:
    scale = PointDistance(
        kind="points", first_px={"cam01": (1, 2)}, second_px={"cam01": (1, 2), "cam02": (3, 4)}, distance_m=1.0
    )
    with pytest.raises(InvalidSpec, match="one picture"):
        in_metres(solved(), scale, {}, "here")


def test_rays_meet_where_they_came_from() -> None:
    place = np.array([0.3, -0.2, 0.4])
    rays = []
    for camera in RIG.cameras:
        away = place - camera.camera_to_world[:3, 3]
        rays.append((camera.camera_to_world[:3, 3], away / np.linalg.norm(away)))
    np.testing.assert_allclose(triangulate(rays), place, atol=1e-12)


def test_a_similarity_is_found_back() -> None:
    rng = np.random.default_rng(0)
    source, turn = rng.normal(size=(9, 3)), turn_to_z(np.array([0.6, 0.0, 0.8]))
    scale, rotation, shift = similarity(source, 2.5 * source @ turn.T + [1.0, 2.0, 3.0])
    assert scale == pytest.approx(2.5)
    np.testing.assert_allclose(rotation, turn, atol=1e-12)
    np.testing.assert_allclose(shift, [1.0, 2.0, 3.0])


def test_board_points_lie_a_square_apart() -> None:
    points = board_points(BOARD)
    assert len(points) == 35
    np.testing.assert_allclose(points[1] - points[0], [0.06, 0, 0])
    np.testing.assert_allclose(points[7] - points[0], [0, 0.06, 0])


def test_a_capture_is_opened_in_metres(tmp_path: Path) -> None:
    film = drawn(1)
    write_transforms(tmp_path, film)
    scale = {"kind": "cameras", "between": ["cam00", "cam02"], "distance_m": 5.0}
    source = CaptureSource.model_validate({"kind": "capture", "path": str(tmp_path), "scale": scale})
    capture = open_capture(source)
    assert distances(capture.rig.cameras)[0, 2] == pytest.approx(5.0)
    assert capture.read(0).rig.cameras[0].camera_to_world[0, 3] == capture.rig.cameras[0].camera_to_world[0, 3]
