"""Where the ground lies on which a structure stands, found in the pictures of one instant by a plane sweep.

The right plane is the one on which all cameras see the same (Collins 1996, "A space-sweep approach to true multi-image
matching"): heights and tilts are tried in coarse pictures, the best of them is refined in finer ones.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np
from jaxtyping import Float, Int
from scipy.optimize import minimize

from nerfmodal.field.beyond import Ground, slants
from nerfmodal.field.views import Views, directions_of, views_of
from nerfmodal.geometry.cameras import focus_of
from nerfmodal.types import Frame, Rig

COARSEST, SIZES = 50, (100, 200)
"""Pixels along the longer side of the pictures: where all planes are tried, and where the best is refined."""
MOST_RAYS = 30_000, 400_000
"""Of the coarsest pictures, and of the others: more say little that is new."""
SLOPES = (-0.07, 0.0, 0.07)
"""Tilts that are tried, along x and along y."""
DEEPEST, REACH = 2.0, 1.5
"""How far below what the rig looks at the ground may lie, and how far around it is compared; distances to it."""
STEEP = -0.2
"""Rays that fall less than this blur too much of the ground into a pixel."""
CELL = 1.5
"""Side of the patches of ground within which cameras are compared, pixel footprints."""
FEWEST_CAMERAS = 3
LARGEST = 1.5
"""Differences, in mean deviations of the tones, count no more than this: something stands before the ground there."""
FAINTEST = 0.01
"""Mean deviation of the tones (of 1) below which a ground has no texture to compare."""
LEAST_SHARE = 0.1
"""Of the pixels must see a ground that is compared."""
OTHERS = (-0.4, -0.2, -0.1, 0.1, 0.2, 0.4)
"""Heights, in distances to what the rig looks at, of the planes that a ground is held against."""
BETTER = 0.5
"""A ground disagrees at most this much as those other planes do."""
COARSELY_BETTER = 0.75
"""The best of the planes that are tried need not lie so well yet; one that lies worse is not refined."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Rays:
    """Rays through the blocks of small pictures; `origins` are relative to `center` (m).

    In single precision and coordinate by coordinate, for hundreds of planes are tried on them.
    """

    camera: Int[np.ndarray, " rays"]
    origins: Float[np.ndarray, "3 rays"]
    directions: Float[np.ndarray, "3 rays"]
    tones: Float[np.ndarray, " rays"]
    center: Float[np.ndarray, " 3"]
    distance: float
    footprint: float


def find_ground(frame: Frame) -> Ground | None:
    """The ground plane of a scene whose +z is up, give or take some degrees; None where no plane explains the pictures.

    A ground without texture, or one that three cameras at a time do not see, cannot be told from others: None.
    """
    views = views_of(frame)
    coarse = _rays_of(views, frame.rig, COARSEST, MOST_RAYS[0])
    ground = min(_candidates(coarse), key=lambda plane: _disagreement(plane, coarse))
    if not _stands_out(ground, coarse, COARSELY_BETTER):
        return None
    rays = coarse
    for size in SIZES:
        rays = _rays_of(views, frame.rig, size, MOST_RAYS[1])
        ground = _refined(ground, rays)
    return _in_the_world(ground, rays.center) if _stands_out(ground, rays, BETTER) else None


def _rays_of(views: Views, rig: Rig, size: int, most: int) -> _Rays:
    cameras, height, width = views.images.shape[:3]
    factor = max(max(height, width) // size, 1)
    rows, columns = height // factor, width // factor
    blocks = views.images[:, : rows * factor, : columns * factor].reshape(cameras, rows, factor, columns, factor * 3)
    tones = blocks.mean(axis=(2, 4), dtype=np.float32) / np.float32(255)
    places = [np.arange(cameras), np.arange(rows) * factor + factor // 2, np.arange(columns) * factor + factor // 2]
    pixels = np.stack(np.meshgrid(*places, indexing="ij"), axis=-1).reshape(-1, 3).astype(np.int32)
    kept = np.flatnonzero(np.ones(len(pixels), bool) if views.counts is None else views.counts[tuple(pixels.T)])
    kept = np.random.default_rng(0).permutation(kept)[:most]
    center, distance = focus_of(rig)
    focal = float(np.median([camera.focal_x for camera in rig.cameras]))
    return _Rays(
        camera=pixels[kept, 0],
        origins=_coordinates(views.poses[pixels[kept, 0], :3, 3] - center),
        directions=_coordinates(directions_of(views, pixels[kept])),
        tones=tones.reshape(-1)[kept],
        center=center,
        distance=distance,
        footprint=distance / focal * factor,
    )


def _coordinates(vectors: Float[np.ndarray, "rays 3"]) -> Float[np.ndarray, "3 rays"]:
    return np.ascontiguousarray(vectors.T, dtype=np.float32)


def _candidates(rays: _Rays) -> list[Ground]:
    highest = max(float(rays.origins[2].min()), 0.0)
    heights = np.arange(-DEEPEST * rays.distance, highest, rays.footprint)
    return [np.array(plane) for plane in product(heights, SLOPES, SLOPES)]


def _refined(ground: Ground, rays: _Rays) -> Ground:
    """The plane near `ground` on which the cameras agree best (Nelder and Mead 1965)."""
    corners = ground + np.vstack([np.zeros(3), rays.footprint * np.diag([1, 1 / rays.distance, 1 / rays.distance])])
    found = minimize(
        _disagreement,
        ground,
        (rays,),
        method="Nelder-Mead",
        options={"initial_simplex": corners, "maxfev": 80, "xatol": 1e-4, "fatol": 1e-4},
    )
    return np.asarray(found.x)


def _stands_out(ground: Ground, rays: _Rays, most: float) -> bool:
    """Whether it disagrees at most `most` times as much as planes above and below it."""
    others = [np.median(_differences(ground + [share * rays.distance, 0, 0], rays)) for share in OTHERS]
    return bool(np.median(_differences(ground, rays)) <= most * np.median(others))


def _disagreement(ground: Ground, rays: _Rays) -> float:
    return float(np.minimum(_differences(ground, rays), LARGEST).mean())


def _differences(ground: Ground, rays: _Rays) -> Float[np.ndarray, " compared"]:
    """How far rays differ from others of their patch of the plane, in mean deviations of all tones there.

    One difference of 1 where nothing can be compared.
    """
    patch, kept, side = _patches(ground, rays)
    camera, tones = rays.camera[kept], rays.tones[kept]
    seen = np.zeros((int(rays.camera.max()) + 1, side * side), dtype=bool)
    seen[camera, patch] = True
    compared = (seen.sum(axis=0, dtype=np.int32) >= FEWEST_CAMERAS)[patch]
    if compared.sum() < LEAST_SHARE * len(rays.tones):
        return np.ones(1)
    patch, tones = patch[compared], tones[compared]
    usual = float(np.abs(tones - np.median(tones)).mean())
    if usual < FAINTEST:
        return np.ones(1)
    differences = np.abs(tones - _means(patch, tones, np.ones(len(patch)))[patch]) / usual
    inliers = np.maximum(LARGEST - differences, 1e-3)  # what stands before the ground weighs less
    return np.asarray(np.abs(tones - _means(patch, tones, inliers)[patch]) / usual)


def _patches(ground: Ground, rays: _Rays) -> tuple[Int[np.ndarray, " near"], Int[np.ndarray, " near"], int]:
    """The patches of the plane that rays meet, which rays these are, and how many patches lie along a side."""
    height, along_x, along_y = ground.astype(np.float32)
    (x, y, z), (u, v, w) = rays.origins, rays.directions
    falls, above = w - along_x * u - along_y * v, z - along_x * x - along_y * y - height
    with np.errstate(divide="ignore", invalid="ignore"):  # rays along the plane
        t = -above / falls
        x, y = x + t * u, y + t * v
    reach, cell = REACH * rays.distance, CELL * rays.footprint
    kept = np.flatnonzero((falls < STEEP) & (above > 0) & (np.abs(x) < reach) & (np.abs(y) < reach))
    side = int(2 * reach / cell) + 1
    row, column = (((place[kept] + reach) / cell).astype(np.int32) for place in (x, y))
    return row * side + column, kept, side


def _means(
    patch: Int[np.ndarray, " rays"], tones: Float[np.ndarray, " rays"], weights: Float[np.ndarray, " rays"]
) -> Float[np.ndarray, " patches"]:
    return np.asarray(np.bincount(patch, weights * tones) / np.maximum(np.bincount(patch, weights), 1e-9))


def _in_the_world(ground: Ground, center: Float[np.ndarray, " 3"]) -> Ground:
    """The plane, given relative to `center`, in world coordinates."""
    return ground + [slants(ground, center[None])[0], 0, 0]
