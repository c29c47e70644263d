"""What each camera would see if the region were empty: its own picture where it does, elsewhere what lies beyond.

Behind the structure the ground is what the camera that sees the place most closely shows of it: a picture is sharper
than a texture learned from many, and a blurred pattern beside a moving leaf looks like a part of it that stays.
"""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8
from scipy.ndimage import binary_erosion, map_coordinates

from nerfmodal.field.beyond import FLAT, Ground, on_ground, slants
from nerfmodal.field.grid import GridField, render
from nerfmodal.field.kernels import CLEAR
from nerfmodal.field.views import Views, directions_of, pixels_at, views_of
from nerfmodal.geometry.cameras import project
from nerfmodal.types import Camera, Frame, Rig


def still_backgrounds(field: GridField, first: Frame) -> UInt8[np.ndarray, "cameras height width 3"]:
    """The still background of every pixel of frame 0, from its trained field and its pictures."""
    views = views_of(first)
    backgrounds = np.empty_like(views.images)
    clear = np.empty(views.images.shape[:3], dtype=bool)
    for number, image in enumerate(views.images):
        _, left, behind, _, _ = render(field, views, views.pixels_of(number), behind=True)
        learned = np.round(np.clip(behind, 0, 1) * 255).astype(np.uint8).reshape(image.shape)
        clear[number] = left.reshape(image.shape[:2]) > CLEAR
        if views.counts is not None:
            clear[number] &= views.counts[number]
        backgrounds[number] = np.where(clear[number, :, :, None], image, learned)
    if field.has_ground:
        surely = np.stack([binary_erosion(one, np.ones((3, 3), dtype=bool)) for one in clear])
        for flat, colors in ground_behind(field.ground, first.rig, views, surely):
            backgrounds.reshape(-1, 3)[flat] = colors
    return backgrounds


def ground_behind(
    ground: Ground, rig: Rig, views: Views, clear: Bool[np.ndarray, "cameras height width"]
) -> Iterator[tuple[Int[np.ndarray, " pixels"], UInt8[np.ndarray, "pixels 3"]]]:
    """Of each camera, the pixels that do not see the ground clearly while another camera does, and what that shows."""
    hidden = np.flatnonzero(~clear)
    pixels = pixels_at(hidden, clear.shape)
    directions = directions_of(views, pixels)
    falls = slants(ground, directions) < FLAT
    hidden, pixels, directions = hidden[falls], pixels[falls], directions[falls]
    points = on_ground(ground, views.poses[pixels[:, 0], :3, 3], directions)
    closest, nearness, places = np.full(len(points), -1), np.zeros(len(points)), np.empty((len(points), 2))
    for number, camera in enumerate(rig.cameras):
        shown, seen = _seen(camera, points, clear[number])
        nearer = np.where(seen, _nearness(camera, points), 0.0)
        better = nearer > nearness
        closest[better], nearness[better], places[better] = number, nearer[better], shown[better]
    for number in np.unique(closest[closest >= 0]):
        mine = closest == number
        yield hidden[mine], _read(views.images[number], places[mine])


def _nearness(camera: Camera, points: Float[np.ndarray, "points 3"]) -> Float[np.ndarray, " points"]:
    """Pixels per metre of ground along the view, up to the focal length: sine of the angle over the distance."""
    rays = points - camera.camera_to_world[:3, 3]
    return np.asarray(-rays[:, 2] / (rays**2).sum(axis=1))


def _seen(
    camera: Camera, points: Float[np.ndarray, "points 3"], clear: Bool[np.ndarray, "height width"]
) -> tuple[Float[np.ndarray, "points 2"], Bool[np.ndarray, " points"]]:
    """The pixels of the points, and whether the camera sees them and nothing before them."""
    places, depths = project(camera, points)
    inside = (depths > 0) & (places > 1).all(axis=1) & (places < [camera.width - 1, camera.height - 1]).all(axis=1)
    columns, rows = places[inside].astype(int).T
    inside[inside] = clear[rows, columns]
    return places, np.asarray(inside)


def _read(
    image: UInt8[np.ndarray, "height width 3"], places: Float[np.ndarray, "points 2"]
) -> UInt8[np.ndarray, "points 3"]:
    """Colours between the pixels, by cubic splines."""
    rows_columns = (places[:, ::-1] - 0.5).T
    channels = [
        map_coordinates(image[..., channel].astype(np.float32), rows_columns, order=3, mode="nearest")
        for channel in range(3)
    ]
    return np.clip(np.round(np.stack(channels, axis=1)), 0, 255).astype(np.uint8)
