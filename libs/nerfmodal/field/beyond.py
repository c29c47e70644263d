"""First guess of what lies beyond the region: ground plane and sky, each texel the median of the pixels that see it.

The plant covers a place of the ground for few cameras only, so the median looks through it.
"""

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8
from scipy.ndimage import distance_transform_edt

from nerfmodal.field.grid import GridField
from nerfmodal.field.views import Views, directions_of, pixels_at

Ground = Float[np.ndarray, " 3"]
"""A plane z = h + a x + b y: its height h (m) at the origin, and its slopes a and b."""
FLAT = -1e-4
"""Rays that fall less than this see the sky, as in `marching.meet_ground`."""
MOST_PIXELS = 4_000_000
"""More than so many say nothing new of a texture."""
SHARED = 3
"""Cameras that must see a place of the ground before what one of them shows there can be told from the ground."""
PATCH = 4
"""Texels along the patches for which cameras are counted: a picture from afar skips texels, but no patch."""


def lay_ground(field: GridField, views: Views, seen: Bool[np.ndarray, "cameras height width"] | None = None) -> None:
    """Fill the ground and sky of `field.values` in place from the pictures, or from their pixels `seen` alone."""
    flat = np.arange(0, views.pixels, -(-views.pixels // MOST_PIXELS))
    if seen is not None:
        flat = flat[seen.reshape(-1)[flat]]
    pixels = pixels_at(flat, views.images.shape)
    directions = directions_of(views, pixels)
    colors = views.images.reshape(-1, 3)[flat]
    falls = slants(field.ground, directions) < FLAT
    origins = views.poses[pixels[:, 0], :3, 3]
    ground = _texels(_ground_points(field, origins[falls], directions[falls]), field.sides[0])
    sky = _texels(_sky_points(directions[~falls]), field.sides[1])
    start = field.bricks.rows
    field.values[start : start + field.sides[0] ** 2, 1:] = _medians(ground, colors[falls], field.sides[0])
    field.values[start + field.sides[0] ** 2 :, 1:] = _medians(sky, colors[~falls], field.sides[1])


def shared_ground(field: GridField, views: Views) -> Bool[np.ndarray, "cameras height width"]:
    """Pixels whose ray meets the ground where enough cameras see it, whatever stands before it."""
    side = field.sides[0] // PATCH
    counts, patches = np.zeros(side * side, np.int32), []
    for camera in range(len(views.images)):
        falls, patch = _patches(field, views, camera, side)
        counts += np.bincount(patch, minlength=side * side) > 0
        patches.append((np.packbits(falls), patch.astype(np.int32)))
    shared = np.zeros(views.images.shape[:3], dtype=bool)
    each = shared[0].size
    for one, (falls, patch) in zip(shared.reshape(len(patches), each), patches, strict=True):
        one[np.unpackbits(falls, count=each).astype(bool)] = counts[patch] >= SHARED
    return shared


def _patches(
    field: GridField, views: Views, camera: int, side: int
) -> tuple[Bool[np.ndarray, " pixels"], Int[np.ndarray, " falling"]]:
    """Which pixels of a camera meet the ground, and in which patch of it."""
    directions = directions_of(views, views.pixels_of(camera))
    falls = slants(field.ground, directions) < FLAT
    origins = np.broadcast_to(views.poses[camera, :3, 3], directions[falls].shape)
    return falls, _texels(_ground_points(field, origins, directions[falls]), side)


def slants(ground: Ground, directions: Float[np.ndarray, "rays 3"]) -> Float[np.ndarray, " rays"]:
    """How fast rays rise over the ground, metres a metre; below 0 they meet it."""
    return np.asarray(directions @ np.array([-ground[1], -ground[2], 1.0]))


def on_ground(
    ground: Ground, origins: Float[np.ndarray, "rays 3"], directions: Float[np.ndarray, "rays 3"]
) -> Float[np.ndarray, "rays 3"]:
    """Where rays that fall meet the ground, metres."""
    t = (ground[0] - slants(ground, origins)) / slants(ground, directions)
    return np.asarray(origins + t[:, None] * directions)


def _ground_points(
    field: GridField, origins: Float[np.ndarray, "rays 3"], directions: Float[np.ndarray, "rays 3"]
) -> Float[np.ndarray, "rays 2"]:
    center = field.bricks.low + field.half
    scaled = ((on_ground(field.ground, origins, directions) - center) / field.half)[:, :2]
    r = np.maximum(np.abs(scaled).max(axis=1, keepdims=True), 1.0)
    return 0.5 + scaled * (2.0 - 1.0 / r) / r * 0.25


def _sky_points(directions: Float[np.ndarray, "rays 3"]) -> Float[np.ndarray, "rays 2"]:
    u = 0.5 + np.arctan2(directions[:, 1], directions[:, 0]) / (2 * np.pi)
    return np.stack([u, 0.5 + np.arcsin(np.clip(directions[:, 2], -1, 1)) / np.pi], axis=1)


def _texels(points: Float[np.ndarray, "rays 2"], side: int) -> Int[np.ndarray, " rays"]:
    nearest = np.round(np.clip(points, 0, 1) * (side - 1.001)).astype(np.int32)  # half the time to sort
    return nearest[:, 0] * side + nearest[:, 1]


def _medians(
    texels: Int[np.ndarray, " rays"], colors: UInt8[np.ndarray, "rays 3"], side: int
) -> Float[np.ndarray, "texels 3"]:
    """Median colour of each texel; texels that nobody saw take the nearest one's."""
    filled = np.full((side * side, 3), 0.5, np.float32)
    if not len(texels):
        return filled
    counts = np.bincount(texels, minlength=side * side)
    seen = np.flatnonzero(counts)
    first, counts = (np.cumsum(counts) - counts)[seen], counts[seen]
    for channel in range(3):
        ranked = np.sort(texels * 256 + colors[:, channel]) & 255  # by texel, then by tone
        filled[seen, channel] = (ranked[first + (counts - 1) // 2] + ranked[first + counts // 2]) / np.float32(510)
    unseen = np.ones(side * side, dtype=bool)
    unseen[seen] = False
    nearest = distance_transform_edt(unseen.reshape(side, side), return_distances=False, return_indices=True)
    return filled.reshape(side, side, 3)[tuple(nearest)].reshape(-1, 3)
