"""What frame 0 gives to the frames that are followed: which pixel sees which place of which organ, and how opaquely.

The opacity of a pixel is what its own picture says of it, between the colour of the structure there and that of the
background behind it (Porter and Duff 1984); the field's is only where both colours are alike.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8
from scipy.ndimage import binary_dilation, binary_erosion, distance_transform_edt, gaussian_filter, minimum_filter

from nerfmodal.geometry.cameras import unproject
from nerfmodal.geometry.deformation import deformation_of
from nerfmodal.tracking.pyramid import smoothed
from nerfmodal.types import Camera, Frame, Look

Labels = Callable[[Float[np.ndarray, "points 3"]], Int[np.ndarray, " points"]]
"""The number of the organ that each place belongs to; -1 where it is none's."""

OPAQUE = 0.3
"""A pixel less opaque than this has no place of its own: it takes that of its nearest neighbour."""
FAINT = 0.01
SOLID = 0.95
"""A pixel is opaque when the field is more opaque than this there and all around."""
MATTE_PRIOR = 0.1
"""Squared difference of structure and background (of 1) from which on the picture decides the opacity."""
COLOR_REACH = 2.0
"""Pixels over which the structure's colour is smoothed for it."""
REACH_SHARE = 0.08
"""How far from its organ's pixels, in lengths of the organ's picture, a pixel may still show it once smoothed."""
APART_SHARE = 0.06
"""Pixels nearer than this to another organ's are not believed: either may hide the other."""
GRAZING = 0.85
"""A surface seen under a smaller sine than this tells less: folds hide one another."""
GUESS_REACH = 6.0
"""Pixels over which the background that is known says how restless one is that is not."""
OTHER = -2
"""Label of a place of the structure that belongs to no organ that is followed."""
SHEET_DEGREES = (4, 3, 2, 1, 0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Reference:
    """Frame 0 as the followed frames need it; a row for every pixel that shows an organ or lies close to one.

    `trust` weighs a pixel by the angle it is seen under, `unrest` is the slope of the background behind it (of 1 per
    pixel). `opacity` is that of all pixels, of 255. `cloud` are the points that are moved, and `owner` their organs.
    """

    organs: tuple[str, ...]
    flat: Int[np.ndarray, " pixels"]
    organ: Int[np.ndarray, " pixels"]
    points: Float[np.ndarray, "pixels 3"]
    trust: Float[np.ndarray, " pixels"]
    unrest: Float[np.ndarray, " pixels"]
    opacity: UInt8[np.ndarray, "cameras height width"]
    cloud: Float[np.ndarray, "cloud 3"]
    colors: Float[np.ndarray, "cloud 3"]
    owner: Int[np.ndarray, " cloud"]


ARRAYS = tuple(each.name for each in fields(Reference) if each.name != "organs")


def prepare(
    look: Look,
    first: Frame,
    backgrounds: UInt8[np.ndarray, "cameras height width 3"],
    known: Bool[np.ndarray, "cameras height width"],
    *,
    organs: Sequence[str],
    labels: Labels,
    flat_organs: Sequence[bool],
    spread: float,
    cloud: Float[np.ndarray, "cloud 3"],
    colors: Float[np.ndarray, "cloud 3"],
) -> Reference:
    """The reference of a scan.

    Parameters
    ----------
    look
        What rays of frame 0 meet in its trained field.
    backgrounds, known
        What each pixel shows where the structure is not, and where some picture shows that.
    organs, labels, flat_organs
        Names, which places belong to which, and which of them are leaves (rods look alike from all sides).
    spread
        A ray whose place is less sure than this (metres) has none.
    cloud, colors
        The points of frame 0 that are to be moved.
    """
    parts, opacities = [], []
    for index, camera in enumerate(first.rig.cameras):
        seen = _see(look, index, camera, first.images[index], backgrounds[index], labels, spread)
        opacities.append(np.round(255 * seen.opacity).astype(np.uint8))
        parts.append(_pixels(seen, index, camera, _unrest(backgrounds[index], known[index]), len(organs)))
    flat, organ, points, unrest = (np.concatenate(column) for column in zip(*parts, strict=True))
    owner = labels(cloud)
    return Reference(
        organs=tuple(organs),
        flat=flat,
        organ=organ,
        points=points,
        trust=_trust(first, flat, organ, points, flat_organs),
        unrest=unrest,
        opacity=np.stack(opacities),
        cloud=cloud,
        colors=colors,
        owner=owner,
    )


def reference_arrays(reference: Reference) -> dict[str, np.ndarray]:
    """The reference as named arrays, as a checkpoint keeps them."""
    kept = {f"follow/{name}": getattr(reference, name) for name in ARRAYS}
    kept["follow/organs"] = np.frombuffer("\n".join(reference.organs).encode(), dtype=np.uint8)
    return kept


def has_reference(state: Mapping[str, np.ndarray]) -> bool:
    """Whether a checkpoint of frame 0 has what frames need to be followed."""
    return "follow/organs" in state


def reference_of(state: Mapping[str, np.ndarray]) -> Reference:
    """The inverse of `reference_arrays`."""
    names = state["follow/organs"].tobytes().decode().split("\n")
    return Reference(organs=tuple(name for name in names if name), **{name: state[f"follow/{name}"] for name in ARRAYS})


@dataclass(frozen=True, slots=True, kw_only=True)
class _Seen:
    """One camera's view: the place each pixel shows, the organ it belongs to, and its own opacity."""

    places: Float[np.ndarray, "height width 3"]
    label: Int[np.ndarray, "height width"]
    opacity: Float[np.ndarray, "height width"]


def _see(
    look: Look,
    index: int,
    camera: Camera,
    image: UInt8[np.ndarray, "height width 3"],
    background: UInt8[np.ndarray, "height width 3"],
    labels: Labels,
    spread: float,
) -> _Seen:
    height, width = image.shape[:2]
    rows, columns = np.divmod(np.arange(height * width), width)
    pixels = np.stack([np.full(height * width, index), rows, columns], axis=1).astype(np.int32)
    colors, opacity, distance, unsure = look(pixels)
    placed = (opacity > OPAQUE) & (distance > 0) & (unsure <= spread)
    places = np.full((height * width, 3), np.nan)
    centers = pixels[placed][:, [2, 1]] + 0.5
    places[placed] = camera.camera_to_world[:3, 3] + distance[placed, None] * unproject(camera, centers)
    label = np.full(height * width, -1)
    found = labels(places[placed])
    label[placed] = np.where(found < 0, OTHER, found)
    shape = (height, width)
    matte = _matte(image, background, colors.reshape(height, width, 3), opacity.reshape(shape))
    return _Seen(places=places.reshape(height, width, 3), label=label.reshape(shape), opacity=matte)


def _matte(
    image: UInt8[np.ndarray, "height width 3"],
    background: UInt8[np.ndarray, "height width 3"],
    colors: Float[np.ndarray, "height width 3"],
    opacity: Float[np.ndarray, "height width"],
) -> Float[np.ndarray, "height width"]:
    """Opacity a of each pixel from I = a F + (1 - a) B, with the structure's colour F taken from around it."""
    weighted = np.concatenate([colors * opacity[..., None], opacity[..., None]], axis=-1).astype(np.float32)
    around = smoothed(weighted[None], COLOR_REACH)[0]
    back = background / np.float32(255)
    contrast = around[..., :3] / np.maximum(around[..., 3:], 1e-3) - back
    size = (contrast**2).sum(axis=-1)
    share = ((image / np.float32(255) - back) * contrast).sum(axis=-1)
    matte = np.clip((MATTE_PRIOR * opacity + share) / (MATTE_PRIOR + size), 0, 1)
    matte[minimum_filter(opacity, 3) > SOLID] = 1.0  # within the structure its colour says nothing
    return np.where(opacity < FAINT, 0.0, matte)


def _pixels(
    seen: _Seen, index: int, camera: Camera, unrest: Float[np.ndarray, "height width"], organs: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Pixels of one camera that show an organ or lie close to one: flat numbers, organs, places, unrest."""
    height, width = seen.label.shape
    known = seen.label != -1
    if not (seen.label >= 0).any():
        return np.empty(0, np.int32), np.empty(0, np.int16), np.empty((0, 3), np.float32), np.empty(0, np.float32)
    far, nearest = distance_transform_edt(~known, return_indices=True)
    label, places = seen.label[tuple(nearest)], seen.places[tuple(nearest)]
    chosen = np.zeros((height, width), dtype=bool)
    for organ in range(organs):
        mine = seen.label == organ
        if mine.any():
            length = float(np.hypot(*np.ptp(np.argwhere(mine), axis=0)))
            others = known & ~mine
            close = others if not others.any() else _grown(others, max(round(APART_SHARE * length), 1))
            chosen |= (label == organ) & (far <= max(REACH_SHARE * length, 2.0)) & ~close
    rows, columns = np.nonzero(chosen)
    flat = ((index * height + rows) * width + columns).astype(np.int32)
    own = _on_own_ray(camera, rows, columns, places[chosen])
    return flat, label[chosen].astype(np.int16), own.astype(np.float32), unrest[chosen]


def _grown(mask: Bool[np.ndarray, "height width"], pixels: int) -> Bool[np.ndarray, "height width"]:
    return np.asarray(binary_dilation(mask, iterations=pixels))


def _on_own_ray(
    camera: Camera, rows: np.ndarray, columns: np.ndarray, places: Float[np.ndarray, "pixels 3"]
) -> Float[np.ndarray, "pixels 3"]:
    """Where the pixels' own rays are as deep as the places (their neighbours', for some)."""
    pose = camera.camera_to_world
    directions = unproject(camera, np.stack([columns, rows], axis=1) + 0.5)
    depth = (places - pose[:3, 3]) @ pose[:3, 2]
    return np.asarray(pose[:3, 3] + directions * (depth / (directions @ pose[:3, 2]))[:, None])


def _unrest(
    background: UInt8[np.ndarray, "height width 3"], known: Bool[np.ndarray, "height width"]
) -> Float[np.ndarray, "height width"]:
    """Slopes of the background; where it is a guess, which is smooth, those of what is known around."""
    values = background / np.float32(255)
    energy = np.asarray(sum(np.gradient(values, axis=axis) ** 2 for axis in (0, 1))).sum(axis=-1)
    seen = binary_erosion(known, np.ones((3, 3), dtype=bool), border_value=1).astype(np.float32)
    around = gaussian_filter(energy * seen, GUESS_REACH) / np.maximum(gaussian_filter(seen, GUESS_REACH), 1e-3)
    return np.sqrt(np.where(known, gaussian_filter(energy, 1.0), around)).astype(np.float32)


def _trust(
    first: Frame,
    flat: Int[np.ndarray, " pixels"],
    organ: Int[np.ndarray, " pixels"],
    points: Float[np.ndarray, "pixels 3"],
    flat_organs: Sequence[bool],
) -> Float[np.ndarray, " pixels"]:
    """Weights by the sine of the angle between ray and surface; rods are seen alike from everywhere."""
    trust = np.ones(len(flat), np.float32)
    positions = np.stack([camera.camera_to_world[:3, 3] for camera in first.rig.cameras])
    camera = flat // (first.images.shape[1] * first.images.shape[2])
    for number, is_flat in enumerate(flat_organs):
        mine = organ == number
        if not is_flat or mine.sum() < 3 * sum(degree + 1 for degree in SHEET_DEGREES):
            continue
        rays = points[mine] - positions[camera[mine]]
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        sines = np.abs((_normals(points[mine].astype(float)) * rays).sum(axis=1))
        trust[mine] = np.clip(sines / GRAZING, 0, 1) ** 2
    return trust


def _normals(points: Float[np.ndarray, "points 3"]) -> Float[np.ndarray, "points 3"]:
    """Unit normals of the smooth sheet through the points (robust least squares)."""
    sheet = deformation_of(points, SHEET_DEGREES)
    basis, heights = sheet.at(points), sheet.frame.to_local(points)[:, 2]
    weights = np.ones(len(points))
    for _ in range(8):
        found = np.linalg.lstsq(basis * weights[:, None], heights * weights, rcond=None)[0]
        off = heights - basis @ found
        weights = 1 / np.sqrt(1 + (off / (2.97 * np.median(np.abs(off)) + 1e-9)) ** 2)
    steps = 1e-3 * sheet.half
    slopes = [
        (sheet.at(points + step * sheet.frame.axes[:, axis]) - sheet.at(points - step * sheet.frame.axes[:, axis]))
        @ found
        / (2 * step)
        for axis, step in enumerate(steps)
    ]
    normals = np.stack([-slopes[0], -slopes[1], np.ones(len(points))], axis=1)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return np.asarray(normals @ sheet.frame.axes.T)
