"""What each camera would see if the region were empty: its own picture where it does, elsewhere what lies beyond.

Behind the structure the ground is what the camera that sees the place most closely shows of it: a picture is sharper
than a texture learned from many, and a blurred pattern beside a moving leaf looks like a part of it that stays. What no
other camera shows is guessed from around it.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped, UInt8
from scipy.ndimage import gaussian_filter, map_coordinates

from nerfmodal.field.beyond import FLAT, MOST_PIXELS, Ground, on_ground, shared_ground, slants
from nerfmodal.field.bricks import emptied
from nerfmodal.field.closest import closest_cameras
from nerfmodal.field.grid import GridField, render
from nerfmodal.field.kernels import CLEAR
from nerfmodal.field.masks import largest, narrowed
from nerfmodal.field.views import Views, directions_of, pixels_at, views_of
from nerfmodal.types import Frame, Rig

FOG = 0.5
"""A ray that keeps more than this of its light may be held up by fog alone."""
ALIKE = 0.12
"""Fog is where a picture, smoothed by `BLUR` pixels, is nearer than this (of 1) to what is thought to be behind it."""
BLUR = 1.5
LOOKED_AT = 100_000
"""Pixels in which a field is looked at while it is trained: 500,000 told no more, and cost a third of a short one."""
ASKED_FOR = 4_000_000
"""Pixels for which it is asked what is behind them while a field is trained. Fewer than there are would be faster, but
with few cameras coarse pictures of what is behind hide the structure again (decision 12)."""
PASSES = 2
"""Times that fog is looked for: each time more is known of what is behind the rest."""
REACH = 3
"""Pixels around from which an unseen one is guessed (Telea 2004)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Backgrounds:
    """What stands still behind each pixel, and where some picture shows it; elsewhere it is guessed."""

    images: UInt8[np.ndarray, "cameras height width 3"]
    known: Bool[np.ndarray, "cameras height width"]


def still_backgrounds(field: GridField, first: Frame) -> Backgrounds:
    """The still background of every pixel of frame 0, from its trained field and its pictures.

    Beside the structure a pixel may hold a little of it that the field does not know: its own picture is not believed.
    """
    views = views_of(first)
    clear = narrowed(_counting(remaining(field, views) > CLEAR, views), 1)
    shared = shared_ground(field, views) if field.has_ground else None
    return _behind(field, first.rig, views, clear, shared)


def presumed_backgrounds(
    field: GridField,
    rig: Rig,
    views: Views,
    shared: Bool[np.ndarray, "cameras height width"],
    left: Float[np.ndarray, "cameras rows columns"],
    *,
    foggy: bool,
) -> UInt8[np.ndarray, "cameras height width 3"]:
    """What a field with a ground has behind it while it is trained, as far as it is known by then.

    A field whose place beyond is blurred grows fog to sharpen it. What looks like its background behind fog alone is
    taken for it: the fog has nothing to explain any more, and clears. Before any training (`foggy` is false) there is
    nothing but fog, and all of it may be the structure. `shared` is of `shared_ground`, `left` of `remaining` in every
    `stride`-th pixel.
    """
    clear, thin = (_counting(spread(left > limit, stride(views), views), views) for limit in (CLEAR, FOG))
    behind = _behind(field, rig, views, clear, shared, math.ceil(math.sqrt(views.pixels / ASKED_FOR)))
    images = behind.images
    for _ in range(PASSES if foggy else 0):
        clear |= thin & _alike(views.images, images)
        images = np.where(clear[..., None], views.images, images)
        _guess(images, views.images, clear, ~(clear | behind.known | shared))
    return images


def remaining(field: GridField, views: Views, step: int = 1) -> Float[np.ndarray, "cameras rows columns"]:
    """The share of its light that the ray of every `step`-th pixel keeps on its way through the region."""
    cameras, height, width = views.images.shape[:3]
    rows, columns = np.arange(0, height, step), np.arange(0, width, step)
    left = np.empty((cameras, len(rows), len(columns)), np.float32)
    for camera in range(cameras):
        grid = np.stack(np.meshgrid([camera], rows, columns, indexing="ij"), axis=-1).reshape(-1, 3)
        left[camera] = render(field, views, grid.astype(np.int32), behind=False)[1].reshape(left.shape[1:])
    return left


def stride(views: Views) -> int:
    """How many pixels apart a field is looked at while it is trained."""
    return math.ceil(math.sqrt(views.pixels / LOOKED_AT))


def spread(
    coarse: Shaped[np.ndarray, "cameras rows columns ..."], step: int, views: Views
) -> Shaped[np.ndarray, "cameras height width ..."]:
    """What was said of every `step`-th pixel, said of all pixels."""
    _, height, width = views.images.shape[:3]
    return coarse.repeat(step, axis=1).repeat(step, axis=2)[:, :height, :width]


def _counting(
    pixels: Bool[np.ndarray, "cameras height width"], views: Views
) -> Bool[np.ndarray, "cameras height width"]:
    return pixels if views.counts is None else pixels & views.counts


def _behind(
    field: GridField,
    rig: Rig,
    views: Views,
    clear: Bool[np.ndarray, "cameras height width"],
    shared: Bool[np.ndarray, "cameras height width"] | None,
    step: int = 1,
) -> Backgrounds:
    """The pictures where they are clear; else what another camera shows, what the field learned, or a guess.

    What others show and what was learned is looked up for every `step`-th pixel, and said of those around it.
    """
    images, known = views.images.copy(), clear.copy()
    hidden, learned = ~clear, np.ones_like(clear)
    if shared is not None:
        hidden = ~narrowed(clear, 1)
        for flat, colors in ground_behind(field.ground, rig, views, ~hidden, step):
            images.reshape(-1, 3)[flat], known.reshape(-1)[flat] = colors, True
        learned = shared | ~clear.any(axis=(1, 2), keepdims=True)
    _recall(field, views, learned & _every(step, ~known), images)
    if step > 1:
        images = np.where(hidden[..., None], spread(images[:, ::step, ::step], step, views), images)
        known = np.where(hidden, spread(known[:, ::step, ::step], step, views), clear)
    if shared is not None:
        _guess(images, views.images, clear, ~(known | shared))
    return Backgrounds(images=images, known=known)


def _every(step: int, pixels: Bool[np.ndarray, "cameras height width"]) -> Bool[np.ndarray, "cameras height width"]:
    """Those of the pixels that lie in every `step`-th row and column."""
    some = np.zeros_like(pixels)
    some[:, ::step, ::step] = pixels[:, ::step, ::step]
    return some


def _recall(
    field: GridField,
    views: Views,
    where: Bool[np.ndarray, "cameras height width"],
    images: UInt8[np.ndarray, "cameras height width 3"],
) -> None:
    """Put into `images` what the field has learned of what lies beyond the region."""
    clear = replace(field, bricks=emptied(field.bricks))
    for camera, (image, mask) in enumerate(zip(images, where, strict=True)):
        pixels = views.pixels_of(camera)[mask.reshape(-1)]
        _, _, learned, _, _ = render(clear, views, pixels, behind=True)
        image[mask] = np.round(np.clip(learned, 0, 1) * 255)


def _guess(
    images: UInt8[np.ndarray, "cameras height width 3"],
    pictures: UInt8[np.ndarray, "cameras height width 3"],
    clear: Bool[np.ndarray, "cameras height width"],
    unknown: Bool[np.ndarray, "cameras height width"],
) -> None:
    """Fill the unknown pixels of `images`, in place, from what the pictures show clearly around them."""
    import cv2

    step = math.ceil(math.sqrt(clear.size / MOST_PIXELS))
    for image, picture, seen, unseen in zip(images, pictures, clear, unknown, strict=True):
        if unseen.any() and seen.any():
            small = np.ascontiguousarray(picture[::step, ::step])
            filled = cv2.inpaint(small, (~seen[::step, ::step]).astype(np.uint8), REACH, cv2.INPAINT_TELEA)
            rows, columns = np.nonzero(unseen)
            image[rows, columns] = filled[rows // step, columns // step]


def _alike(
    images: UInt8[np.ndarray, "cameras height width 3"], others: UInt8[np.ndarray, "cameras height width 3"]
) -> Bool[np.ndarray, "cameras height width"]:
    alike = np.empty(images.shape[:3], dtype=bool)
    for camera, (image, other) in enumerate(zip(images, others, strict=True)):
        off = gaussian_filter(image.astype(np.float32) - other, (BLUR, BLUR, 0))
        alike[camera] = largest(np.abs(off)) < 255 * ALIKE
    return alike


def ground_behind(
    ground: Ground, rig: Rig, views: Views, clear: Bool[np.ndarray, "cameras height width"], step: int = 1
) -> Iterator[tuple[Int[np.ndarray, " pixels"], UInt8[np.ndarray, "pixels 3"]]]:
    """Of each camera, the pixels that do not see the ground clearly while another camera does, and what that shows.

    Only pixels in every `step`-th row and column are asked for.
    """
    each = clear[0].size
    together = max(MOST_PIXELS // each, 1)  # cameras at once: neither a spline for each pair, nor all pixels in memory
    for first in range(0, len(clear), together):
        hidden = first * each + np.flatnonzero(_every(step, ~clear[first : first + together]))
        pixels = pixels_at(hidden, clear.shape)
        directions = directions_of(views, pixels)
        falls = slants(ground, directions) < FLAT
        hidden, pixels, directions = hidden[falls], pixels[falls], directions[falls]
        points = on_ground(ground, views.poses[pixels[:, 0], :3, 3], directions)
        closest, places = closest_cameras(rig, points, clear)
        for number in np.unique(closest[closest >= 0]):
            mine = closest == number
            yield hidden[mine], _read(views.images[number], places[mine])


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
