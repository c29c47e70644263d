"""How the grid field is trained: frame 0 coarse to fine, further frames where they changed.

A warm start keeps a ghost of frame 0 in every place that the structure left. Therefore a further frame first
forgets all that may have changed (`changes`), and learns it anew from rays that pass there; all else stays as it was.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Int, UInt8
from scipy.ndimage import binary_dilation, median_filter, uniform_filter

from nerfmodal.field.beyond import lay_ground
from nerfmodal.field.bricks import (
    BLOCKS,
    Bricks,
    Occupancy,
    allocate,
    grown,
    halved,
    sample_vertices,
    seen_blocks,
    unpack,
    with_masks,
)
from nerfmodal.field.changes import carved_blocks, changed_pixels
from nerfmodal.field.grid import FORGOTTEN_RAW, GridField, Rates, Told, empty_field, pruned, refined, render, train
from nerfmodal.field.marching import ROWS_PER_BRICK
from nerfmodal.field.views import Views, directions_of, pixels_at, views_of
from nerfmodal.types import Frame

BEYOND = 0.2
"""Share of the iterations in which only what lies beyond the region learns: else fog would learn the floor."""
BEYOND_RATES = Rates(color=0.02, final=0.1)
BEYOND_LIMIT = 0.03
UNEXPLAINED = 0.12
"""A pixel that the ground and sky miss by more than this (of 1) sees the structure."""
STEEP = -0.05
"""Rays that fall less than this do not vote: the sky beyond is known to few cameras."""
LEVELS = (0.1, 0.15, 0.2, 0.3)
"""Share of the iterations of each level; the voxel halves between two."""
DECAYS = (3e-3, 3e-3, 1e-3, 1e-4)
"""Pull towards emptiness at each level: fog clears while the voxels are large, thin leaves keep their opacity."""
PLANT_AGREEMENT, CHANGE_AGREEMENT = 0.8, 0.9
"""Share of the cameras that must see the plant, or a change, where it is looked for."""
COARSE_SHARE = 0.4
"""Share of a further frame's iterations with voxels twice as large."""
COARSE_DECAY, FINE_DECAY = 1e-3, 3e-4
FOUND_WEIGHT = 0.1
RING = 9
INSIDE = 0.75
NOWHERE = np.empty((0, 0, 0), np.int32)
COARSE = 2
"""Every so many pixels is looked at to find those that see the plant."""
FAINT = 0.1
CLEAR = 0.98
"""A pixel whose ray keeps more than this of its light shows the background."""
Draw = Callable[[], Int[np.ndarray, " rays"]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Schedule:
    """How long to train and with how many rays."""

    iterations: int
    rays: int
    rates: Rates


def fit(
    frame: Frame,
    low: np.ndarray,
    high: np.ndarray,
    voxel: float,
    ground: float | None,
    schedule: Schedule,
    seed: int,
    told: Told,
) -> tuple[GridField, float]:
    """Train frame 0 from nothing. Returns the field and its mean squared error."""
    views = views_of(frame)
    rng = np.random.default_rng(seed)
    field = empty_field(low, high, voxel * 2 ** (len(LEVELS) - 1), ground, views.pixels)

    def draw() -> Int[np.ndarray, " rays"]:
        return rng.integers(0, views.pixels, schedule.rays)

    done, loss = round(BEYOND * schedule.iterations), 0.0
    clear = replace(field, bricks=replace(field.bricks, masks=np.zeros_like(field.bricks.masks)))
    if ground is not None:
        lay_ground(field, views)
    train(clear, views, None, draw, done, rng, rates=BEYOND_RATES, limit=BEYOND_LIMIT, told=told)
    silhouettes = None if ground is None else unexplained(clear, views)
    for level, (share, decay) in enumerate(zip(LEVELS, DECAYS, strict=True)):
        if silhouettes is not None:
            hull = carved_blocks(field.bricks, frame.rig, silhouettes[0], PLANT_AGREEMENT, voters=silhouettes[1])
            field = restricted(field, hull)
        if level == 0 and silhouettes is not None:
            draw = _focused(np.flatnonzero(silhouettes[0] | ~silhouettes[1]), views.pixels, schedule.rays, rng)
        until = schedule.iterations if level == len(LEVELS) - 1 else done + round(share * schedule.iterations)
        loss, seen = train(
            field,
            views,
            None,
            draw,
            until - done,
            rng,
            rates=schedule.rates,
            decay=decay,
            progress=(done / schedule.iterations, until / schedule.iterations),
            told=_shifted(told, done),
        )
        done = until
        field = pruned(field, seen)
        if level < len(LEVELS) - 1:
            plant = plant_pixels(field, views)
            draw = _focused(plant, views.pixels, schedule.rays, rng)
            field = refined(field, seen)
            if ground is not None and level > 0:
                lay_ground(field, views, np.setdiff1d(np.arange(views.pixels), plant, assume_unique=True))
    return field, loss


def restricted(field: GridField, occupied: Occupancy) -> GridField:
    """The field with vertices only in the blocks that are both its own and `occupied`."""
    old = field.bricks
    bricks = allocate(old.low, old.voxel, unpack(old.masks, old.slots) & occupied)
    inner = sample_vertices(old, field.values[: old.rows], bricks)
    return replace(field, bricks=bricks, values=np.concatenate([inner, field.values[old.rows :]]))


def unexplained(
    clear: GridField, views: Views
) -> tuple[Bool[np.ndarray, "cameras height width"], Bool[np.ndarray, "cameras height width"]]:
    """Pixels that ground and sky alone miss, and pixels whose ray falls to the ground: only those are believed."""
    missed = np.empty(views.images.shape[:3], bool)
    falls = np.empty(views.images.shape[:3], bool)
    per_camera = int(np.prod(views.images.shape[1:3]))
    for camera, image in enumerate(views.images):
        pixels = pixels_at(camera * per_camera + np.arange(per_camera), views.images.shape)
        _, _, behind, _ = render(clear, views, pixels, behind=True)
        difference = np.abs(behind.reshape(image.shape) - image / np.float32(255)).max(axis=-1)
        missed[camera] = uniform_filter(median_filter(difference, 3), 3) > UNEXPLAINED
        falls[camera] = directions_of(views, pixels)[:, 2].reshape(image.shape[:2]) < STEEP
    return missed, falls


def plant_pixels(field: GridField, views: Views) -> Int[np.ndarray, " chosen"]:
    """Flat numbers of the pixels that see something in the region, or lie beside one that does."""
    cameras, height, width = views.images.shape[:3]
    rows, columns = np.arange(0, height, COARSE), np.arange(0, width, COARSE)
    grid = np.stack(np.meshgrid(np.arange(cameras), rows, columns, indexing="ij"), axis=-1).reshape(-1, 3)
    _, left, _, _ = render(field, views, grid.astype(np.int32), behind=False)
    opaque = (left < 1 - FAINT).reshape(cameras, len(rows), len(columns))
    grown = binary_dilation(opaque, np.ones((1, 3, 3), dtype=bool))
    full = grown.repeat(COARSE, axis=1).repeat(COARSE, axis=2)[:, :height, :width]
    return np.flatnonzero(full)


def _focused(chosen: Int[np.ndarray, " chosen"], pixels: int, rays: int, rng: np.random.Generator) -> Draw:
    """Three rays in four from the chosen pixels, the others from anywhere."""
    near = 3 * rays // 4 if len(chosen) else 0

    def draw() -> Int[np.ndarray, " rays"]:
        anywhere = rng.integers(0, pixels, rays - near)
        return np.concatenate([chosen[rng.integers(0, len(chosen), near)], anywhere]) if near else anywhere

    return draw


def still_backgrounds(field: GridField, views: Views) -> UInt8[np.ndarray, "cameras height width 3"]:
    """What each pixel would show if the region were empty: the picture where it is, else what lies beyond."""
    everything = pixels_at(np.arange(views.pixels), views.images.shape)
    _, left, behind, _ = render(field, views, everything, behind=True)
    learned = np.round(np.clip(behind, 0, 1) * 255).astype(np.uint8).reshape(views.images.shape)
    return np.where(left.reshape(*views.images.shape[:3], 1) > CLEAR, views.images, learned)


def fine_tune(
    parent: GridField,
    backgrounds: UInt8[np.ndarray, "cameras height width 3"],
    first: Frame,
    frame: Frame,
    schedule: Schedule,
    seed: int,
    told: Told,
) -> tuple[GridField, float]:
    """Train a further frame from frame 0's field, where it changed. Returns the field and its mean squared error."""
    views = views_of(frame)
    changed = changed_pixels(first.images, frame.images)
    rng = np.random.default_rng(seed)
    if not changed.any():
        return replace(parent, values=parent.values[: parent.bricks.rows], outer=NOWHERE), 0.0
    draw = _changed_rays(changed, schedule.rays, rng)
    coarse = scaled_bricks(parent.bricks, 2)
    hull = carved_blocks(coarse, frame.rig, changed, CHANGE_AGREEMENT)
    field, trainable = forget(parent, None, hull, 2)
    count = round(COARSE_SHARE * schedule.iterations)
    middle = count / schedule.iterations
    _, seen = train(
        field,
        views,
        backgrounds,
        draw,
        count,
        rng,
        rates=schedule.rates,
        trainable=trainable,
        decay=COARSE_DECAY,
        progress=(0.0, middle),
        told=told,
    )
    shape = tuple(BLOCKS * n for n in parent.bricks.slots.shape)
    candidates = halved(hull, shape)
    found = halved(seen_blocks(field.bricks, seen, FOUND_WEIGHT) & unpack(trainable, field.bricks.slots), shape)
    fine = carved_blocks(parent.bricks, frame.rig, changed, CHANGE_AGREEMENT, within=candidates) & grown(found)
    field, trainable = forget(parent, field, fine, 1, gone=candidates)
    loss, _ = train(
        field,
        views,
        backgrounds,
        draw,
        schedule.iterations - count,
        rng,
        rates=schedule.rates,
        trainable=trainable,
        decay=FINE_DECAY,
        progress=(middle, 1.0),
        told=_shifted(told, count),
    )
    return field, loss


def _changed_rays(changed: Bool[np.ndarray, "cameras height width"], rays: int, rng: np.random.Generator) -> Draw:
    """Most rays from pixels that changed, the others from around them: there must be nothing new."""
    inside = np.flatnonzero(changed)
    around = np.flatnonzero(binary_dilation(changed, np.ones((1, RING, RING), dtype=bool)) & ~changed)
    near = rays if not len(around) else round(INSIDE * rays)

    def draw() -> Int[np.ndarray, " rays"]:
        ring = around[rng.integers(0, max(len(around), 1), rays - near)]
        return np.concatenate([inside[rng.integers(0, len(inside), near)], ring])

    return draw


def scaled_bricks(bricks: Bricks, scale: int) -> Bricks:
    """The layout of the same box with voxels `scale` times larger; empty."""
    if scale == 1:
        return bricks
    cells = np.array(bricks.slots.shape) * 8
    slots = np.full(tuple(-(-cells // (8 * scale))), -1, dtype=np.int32)
    return Bricks(low=bricks.low, voxel=bricks.voxel * scale, slots=slots, masks=np.empty(0, np.uint64))


def forget(
    parent: GridField,
    known: GridField | None,
    hull: Occupancy,
    scale: int,
    gone: Occupancy | None = None,
) -> tuple[GridField, np.ndarray]:
    """The parent's inner field at `scale`, with the blocks of `hull` as in `known`, or unknown when it is None.

    Of the parent nothing is kept in the blocks `gone`. Returns the field, and the blocks of `hull` as bits.
    """
    old = parent.bricks
    own = unpack(old.masks, old.slots)
    if gone is not None:
        own = own & ~gone
    if scale > 1:
        own = _any_of(own, scale, hull.shape)
    bricks = allocate(old.low, old.voxel * scale, own | hull)
    values = sample_vertices(old, parent.values[: old.rows], bricks)
    trainable = with_masks(bricks, hull).masks
    inside = trainable_vertices(trainable)
    if known is None:
        values[inside, 0] = FORGOTTEN_RAW
    else:
        values[inside] = sample_vertices(known.bricks, known.values, bricks)[inside]
    return replace(parent, bricks=bricks, values=values, outer=NOWHERE), trainable


def _any_of(blocks: Occupancy, scale: int, shape: tuple[int, ...]) -> Occupancy:
    padded = np.zeros(tuple(scale * n for n in shape), dtype=bool)
    padded[tuple(slice(0, n) for n in blocks.shape)] = blocks
    x, y, z = shape
    return padded.reshape(x, scale, y, scale, z, scale).any(axis=(1, 3, 5))


def trainable_vertices(masks: np.ndarray) -> Bool[np.ndarray, " rows"]:
    """Which vertices belong to a block whose bit is set."""
    local = np.arange(ROWS_PER_BRICK)
    bit = ((local >> 6) >> 1 << 4) | (((local >> 3) & 7) >> 1 << 2) | ((local & 7) >> 1)
    return ((masks[:, None] >> bit.astype(np.uint64)) & np.uint64(1)).astype(bool).reshape(-1)


def _shifted(told: Told, before: int) -> Told:
    return lambda done, loss: told(before + done, loss)
