"""Metres for a rig that was solved without a unit: from two cameras, two points, or a checkerboard.

Points are triangulated as the place nearest to the rays through their pixels (least squares). A checkerboard's corners
are found by OpenCV; all its corners are triangulated and the board is fitted to them (S. Umeyama, 1991).
"""

from collections.abc import Mapping, Sequence
from typing import Any, assert_never

import numpy as np
from jaxtyping import Float, UInt8

from nerfmodal.capture.solve import moved
from nerfmodal.errors import InvalidCapture, InvalidSpec, MissingExtra
from nerfmodal.geometry.cameras import unproject
from nerfmodal.spec import CameraDistance, Checkerboard, PointDistance, Scale
from nerfmodal.types import Camera

WHERE = "/source/scale"
FEWEST_VIEWS = 2
WORST_BOARD = 0.05
"""Corners may lie this share of a square off the fitted board (RMS); more means that it was not one board."""

Pictures = Mapping[str, UInt8[np.ndarray, "height width 3"]]


def in_metres(cameras: Sequence[Camera], scale: Scale, pictures: Pictures, where: str) -> tuple[Camera, ...]:
    """The cameras in metres; `pictures` are those of frame 0 by camera, which only a checkerboard needs.

    Raises
    ------
    InvalidSpec
        When `scale` names a camera that is not solved.
    InvalidCapture
        When the board is not found in two pictures.
    """
    match scale:
        case CameraDistance():
            first, second = (_named(cameras, name, "between") for name in scale.between)
            apart = float(np.linalg.norm(first.camera_to_world[:3, 3] - second.camera_to_world[:3, 3]))
            return _scaled(cameras, scale.distance_m, apart, "between")
        case PointDistance():
            ends = [_point(cameras, pixels, key) for pixels, key in _ends(scale)]
            return _scaled(cameras, scale.distance_m, float(np.linalg.norm(ends[0] - ends[1])), "first_px")
        case Checkerboard():
            return _by_board(cameras, scale, pictures, where)
        case _:
            assert_never(scale)


def triangulate(rays: Sequence[tuple[np.ndarray, np.ndarray]]) -> Float[np.ndarray, " 3"]:
    """The point nearest to all rays, given as (origin (3,), unit direction (3,))."""
    across = [np.eye(3) - np.outer(direction, direction) for _, direction in rays]
    right = sum(one @ origin for one, (origin, _) in zip(across, rays, strict=True))
    return np.linalg.lstsq(np.sum(across, axis=0), np.asarray(right), rcond=None)[0]


def similarity(
    source: Float[np.ndarray, "points 3"], target: Float[np.ndarray, "points 3"]
) -> tuple[float, Float[np.ndarray, "3 3"], Float[np.ndarray, " 3"]]:
    """Scale, rotation and shift that bring `source` nearest to `target` (Umeyama 1991, eq 40-43)."""
    a, b = source - source.mean(axis=0), target - target.mean(axis=0)
    left, spread, right = np.linalg.svd(b.T @ a / len(a))
    sign = np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right))])
    rotation = left @ sign @ right
    scale = float(np.trace(np.diag(spread) @ sign) / (a**2).sum() * len(a))
    return scale, rotation, target.mean(axis=0) - scale * rotation @ source.mean(axis=0)


def find_board(picture: UInt8[np.ndarray, "height width 3"], board: Checkerboard) -> np.ndarray | None:
    """Pixels (corners, 2) of the inner corners, row by row; None where the board is not seen whole.

    Raises
    ------
    MissingExtra
        Without OpenCV.
    """
    cv2 = _import_cv2()
    grey = cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY)
    found, corners = cv2.findChessboardCornersSB(grey, (board.columns, board.rows), flags=cv2.CALIB_CB_ACCURACY)
    return np.asarray(corners, dtype=float).reshape(-1, 2) + 0.5 if found else None  # OpenCV's first pixel is at 0


def board_points(board: Checkerboard) -> Float[np.ndarray, "corners 3"]:
    """Inner corners in the board's frame (m): x along a row, y down the rows, z into the board."""
    rows, columns = np.mgrid[0 : board.rows, 0 : board.columns]
    flat = np.stack([columns.ravel(), rows.ravel(), np.zeros(rows.size)], axis=1)
    return board.square_m * flat


def _by_board(cameras: Sequence[Camera], board: Checkerboard, pictures: Pictures, where: str) -> tuple[Camera, ...]:
    found = {camera.name: find_board(pictures[camera.name], board) for camera in cameras if camera.name in pictures}
    seen = {name: corners for name, corners in found.items() if corners is not None}
    if len(seen) < FEWEST_VIEWS:
        raise InvalidCapture(
            f"the checkerboard of {board.columns} x {board.rows} inner corners is found in {len(seen)} of "
            f"{len(found)} first pictures.",
            where=where,
            hint="Two cameras must see all of it; count the inner corners, not the squares, or give a distance.",
        )
    corners = _triangulated_board(cameras, seen, board)
    scale, rotation, shift = similarity(corners, board_points(board))
    miss = scale * corners @ rotation.T + shift - board_points(board)
    if np.sqrt((miss**2).sum(axis=1).mean()) > WORST_BOARD * board.square_m:
        raise InvalidCapture(
            f"the corners of the checkerboard miss its plane and squares by {1e3 * np.abs(miss).max():.1f} mm.",
            where=where,
            hint="Check columns, rows and square_m, that the board is flat, and that the cameras are solved.",
        )
    if not board.lies_flat:
        return moved(cameras, scale, np.eye(3), np.zeros(3))
    up = np.diag([1.0, -1.0, -1.0])  # the board's z leads into the floor
    return moved(cameras, scale, up @ rotation, up @ shift)


def _triangulated_board(
    cameras: Sequence[Camera], seen: Mapping[str, np.ndarray], board: Checkerboard
) -> Float[np.ndarray, "corners 3"]:
    """Corners in the unknown unit. A board turned by half looks the same: each view is turned to fit the first."""
    by_name = {camera.name: camera for camera in cameras}
    first, *others = seen
    views = {first: seen[first]}
    for name in others:
        as_seen, turned = {**views, name: seen[name]}, {**views, name: seen[name][::-1]}
        views = as_seen if _gap(by_name, as_seen) <= _gap(by_name, turned) else turned
    return np.array([_corner(by_name, views, k) for k in range(board.columns * board.rows)])


def _gap(by_name: Mapping[str, Camera], views: Mapping[str, np.ndarray]) -> float:
    """Sum over the outermost corners of how far the rays pass each other."""
    total = 0.0
    for k in (0, -1):
        place = _corner(by_name, views, k)
        for name, corners in views.items():
            camera = by_name[name]
            ray = unproject(camera, corners[k][None])[0]
            away = place - camera.camera_to_world[:3, 3]
            total += float(np.linalg.norm(away - ray * (away @ ray))) / max(float(np.linalg.norm(away)), 1e-12)
    return total


def _corner(by_name: Mapping[str, Camera], views: Mapping[str, np.ndarray], k: int) -> Float[np.ndarray, " 3"]:
    rays = [
        (by_name[name].camera_to_world[:3, 3], unproject(by_name[name], corners[k][None])[0])
        for name, corners in views.items()
    ]
    return triangulate(rays)


def _ends(scale: PointDistance) -> list[tuple[Mapping[str, tuple[float, float]], str]]:
    return [(scale.first_px, "first_px"), (scale.second_px, "second_px")]


def _point(cameras: Sequence[Camera], pixels: Mapping[str, tuple[float, float]], key: str) -> Float[np.ndarray, " 3"]:
    if len(pixels) < FEWEST_VIEWS:
        raise InvalidSpec("shows the point in one picture.", where=f"{WHERE}/{key}", hint="Give two cameras' pixels.")
    seen = [(_named(cameras, name, key), np.array(pixel)[None]) for name, pixel in pixels.items()]
    return triangulate([(camera.camera_to_world[:3, 3], unproject(camera, pixel)[0]) for camera, pixel in seen])


def _scaled(cameras: Sequence[Camera], wanted: float, apart: float, key: str) -> tuple[Camera, ...]:
    if apart < 1e-9:
        raise InvalidSpec("are one place.", where=f"{WHERE}/{key}", hint="Give two that lie apart.")
    return moved(cameras, wanted / apart, np.eye(3), np.zeros(3))


def _named(cameras: Sequence[Camera], name: str, key: str) -> Camera:
    found = next((camera for camera in cameras if camera.name == name), None)
    if found is None:
        names = ", ".join(camera.name for camera in cameras)
        raise InvalidSpec(f"names the camera {name!r}.", where=f"{WHERE}/{key}", hint=f"Solved are: {names}.")
    return found


def _import_cv2() -> Any:
    try:
        import cv2
    except ImportError as missing:
        raise MissingExtra("opencv-python-headless", "capture") from missing
    return cv2
