"""How the grid field is trained: frame 0 coarse to fine, further frames where they changed.

A warm start keeps a ghost of frame 0 in every place that the structure left. Therefore a further frame first
forgets all that may have changed (`changes`), and learns it anew from rays that pass there; all else stays as it was.
"""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8
from scipy.ndimage import median_filter, uniform_filter

from nerfmodal.field.backgrounds import presumed_backgrounds, remaining, spread, still_backgrounds, stride
from nerfmodal.field.beyond import Ground, lay_ground, shared_ground
from nerfmodal.field.bricks import (
    BLOCKS,
    Bricks,
    Occupancy,
    allocate,
    emptied,
    grown,
    halved,
    sample_vertices,
    seen_blocks,
    unpack,
    with_masks,
)
from nerfmodal.field.changes import carved_blocks, changed_pixels
from nerfmodal.field.corners import ROWS_PER_BRICK
from nerfmodal.field.course import Course
from nerfmodal.field.grid import (
    FORGOTTEN_RAW,
    GridField,
    Rates,
    empty_field,
    grid_of,
    grid_state,
    pruned,
    refined,
    render,
    train,
)
from nerfmodal.field.masks import largest, widened
from nerfmodal.field.views import Views, views_of
from nerfmodal.io.resume import ResumeFile
from nerfmodal.types import Frame

BEYOND = 0.2
"""Share of the iterations in which only what lies beyond the region learns: else fog would learn the floor."""
BEYOND_RATES = Rates(color=0.02, final=1e-5)
"""A tenth of the rate is left at the end of this part, for `final` is that of the whole training."""
BEYOND_LIMIT = 0.03
UNEXPLAINED = 0.12
"""A pixel that the ground and sky miss by more than this (of 1) sees the structure."""
LEVELS = (0.1, 0.15, 0.2, 0.3)
"""Share of the iterations of each level; the voxel halves between two."""
DECAYS = (3e-3, 3e-3, 1e-3, 1e-4)
"""Pull towards emptiness at each level: fog clears while the voxels are large, thin leaves keep their opacity.

Only before a known ground. Without one, nothing but the region explains the pictures well: a plain wall in it, pulled
at, stays transparent, and the outer grid paints it for each camera anew.
"""
PLANT_AGREEMENT, CHANGE_AGREEMENT = 0.8, 0.9
"""Share of the cameras that must see the plant, or a change, where it is looked for."""
COARSE_SHARE = 0.4
"""Share of a further frame's iterations with voxels twice as large."""
COARSE_DECAY, FINE_DECAY = 1e-3, 3e-4
HASTE = 2.0
"""A further frame's densities learn faster than frame 0's: they have a fraction of its iterations."""
FOUND_WEIGHT = 0.1
RING = 4
"""Pixels around what changed in which there must be nothing new."""
INSIDE = 0.75
NOWHERE = np.empty((0, 0, 0), np.int32)
FAINT = 0.1
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
    ground: Ground | None,
    schedule: Schedule,
    seed: int,
    course: Course,
    resume: ResumeFile,
) -> GridField:
    """Train frame 0 from nothing, coarse to fine; `resume` keeps the state after every level."""
    views = views_of(frame)
    rng = np.random.default_rng(seed)
    kept = resume.taken_up()
    if kept is None:
        field = empty_field(low, high, voxel * 2 ** (len(LEVELS) - 1), ground, views.pixels)
        silhouettes = _learn_beyond(field, views, schedule, rng, course)
        level, left, draw = 0, None, _anywhere(views, schedule.rays, rng)
    else:
        level, field, seen, silhouettes = _restored(kept, views, rng, course)
        field, left, draw = _next_level(field, seen, views, schedule, rng, level)
        level += 1
    while True:
        if silhouettes is not None:
            hull = carved_blocks(field.bricks, frame.rig, silhouettes.missed, PLANT_AGREEMENT, voters=silhouettes.tell)
            field = restricted(field, hull)
            if level == 0:
                draw = focused(silhouettes.missed | ~silhouettes.tell, views, schedule.rays, rng)
        until = _iterations_until(level, schedule.iterations)
        plain = _stand_ins(field, frame, views, silhouettes, level, left)
        decay = DECAYS[level] if field.has_ground else 0.0
        seen = train(field, views, plain, draw, until - course.done, rng, course, rates=schedule.rates, decay=decay)
        if level == len(LEVELS) - 1:
            return pruned(field, seen)
        if resume.is_due:
            resume.keep(_kept(level, field, seen, silhouettes, rng, course))
        field, left, draw = _next_level(field, seen, views, schedule, rng, level)
        level += 1


@dataclass(frozen=True, slots=True, kw_only=True)
class Silhouettes:
    """Pixels that ground and sky alone miss, and pixels that can tell: what one camera alone sees cannot be missed,
    for it has learned the structure before it.
    """

    missed: Bool[np.ndarray, "cameras height width"]
    tell: Bool[np.ndarray, "cameras height width"]


def _learn_beyond(
    field: GridField, views: Views, schedule: Schedule, rng: np.random.Generator, course: Course
) -> Silhouettes | None:
    """Teach `field` the ground and the sky, where a ground is known, and return what they cannot explain.

    An outer grid learns together with the region: alone it would explain everything, and leave the region empty.
    """
    if not field.has_ground:
        return None
    clear = replace(field, bricks=emptied(field.bricks))
    lay_ground(field, views)
    draw = _anywhere(views, schedule.rays, rng)
    count = round(BEYOND * schedule.iterations)
    train(clear, views, None, draw, count, rng, course, rates=BEYOND_RATES, limit=BEYOND_LIMIT)
    return unexplained(clear, views)


def _stand_ins(
    field: GridField,
    frame: Frame,
    views: Views,
    silhouettes: Silhouettes | None,
    level: int,
    left: Float[np.ndarray, "cameras rows columns"] | None,
) -> UInt8[np.ndarray, "cameras height width 3"] | None:
    """Pictures of what is behind the region while a level is trained; None where that is trained too."""
    if silhouettes is None:
        return mean_colors(views) if level == 0 else None
    if left is None:
        left = remaining(field, views, stride(views))
    return presumed_backgrounds(field, frame.rig, views, silhouettes.tell, left, foggy=level > 0)


def mean_colors(views: Views) -> UInt8[np.ndarray, "cameras height width 3"]:
    """Every picture in its mean colour: the first level of a scene without a known ground is seen before it.

    Few cameras leave an outer grid free to paint, behind the region, a picture for each of them; what is consistent
    between them must be found in the region first.
    """
    means = views.images.mean(axis=(1, 2), dtype=np.float32).round().astype(np.uint8)
    return np.ascontiguousarray(np.broadcast_to(means[:, None, None], views.images.shape))


def _iterations_until(level: int, iterations: int) -> int:
    if level == len(LEVELS) - 1:
        return iterations
    return round(BEYOND * iterations) + sum(round(share * iterations) for share in LEVELS[: level + 1])


def _next_level(
    field: GridField,
    seen: Float[np.ndarray, " blocks"],
    views: Views,
    schedule: Schedule,
    rng: np.random.Generator,
    level: int,
) -> tuple[GridField, Float[np.ndarray, "cameras rows columns"], Draw]:
    """The field of half the voxel after `level` was trained, what rays keep in it, and rays from where the plant is."""
    field = pruned(field, seen)
    left = remaining(field, views, stride(views))
    plant = plant_pixels(left, views)
    finer = refined(field, seen)
    if field.has_ground and level > 0:
        lay_ground(finer, views, ~plant)
    return finer, left, focused(plant, views, schedule.rays, rng)


def _kept(
    level: int,
    field: GridField,
    seen: Float[np.ndarray, " blocks"],
    silhouettes: Silhouettes | None,
    rng: np.random.Generator,
    course: Course,
) -> dict[str, np.ndarray]:
    state = grid_state(field) | {"seen": seen, "rng": _as_bytes(rng), "at": np.array([level, course.done, course.loss])}
    if silhouettes is None:
        return state
    return state | {name: np.packbits(getattr(silhouettes, name)) for name in ("missed", "tell")}


def _restored(
    kept: Mapping[str, np.ndarray], views: Views, rng: np.random.Generator, course: Course
) -> tuple[int, GridField, Float[np.ndarray, " blocks"], Silhouettes | None]:
    rng.bit_generator.state = json.loads(kept["rng"].tobytes())
    level, done, loss = kept["at"]
    course.go_on(int(done), float(loss))
    silhouettes = None
    if "tell" in kept:
        shape = views.images.shape[:3]
        missed, tell = (
            np.unpackbits(kept[name], count=views.pixels).astype(bool).reshape(shape) for name in ("missed", "tell")
        )
        silhouettes = Silhouettes(missed=missed, tell=tell)
    return int(level), grid_of(kept), kept["seen"], silhouettes


def _as_bytes(rng: np.random.Generator) -> np.ndarray:
    return np.frombuffer(json.dumps(rng.bit_generator.state).encode(), dtype=np.uint8)


def restricted(field: GridField, occupied: Occupancy) -> GridField:
    """The field with vertices only in the blocks that are both its own and `occupied`."""
    old = field.bricks
    bricks = allocate(old.low, old.voxel, unpack(old.masks, old.slots) & occupied)
    inner = sample_vertices(old, field.values[: old.rows], bricks)
    return replace(field, bricks=bricks, values=np.concatenate([inner, field.values[old.rows :]]))


def unexplained(clear: GridField, views: Views) -> Silhouettes:
    """What ground and sky alone miss."""
    missed, tell = np.empty(views.images.shape[:3], bool), shared_ground(clear, views)
    for camera, image in enumerate(views.images):
        _, _, behind, _, _ = render(clear, views, views.pixels_of(camera), behind=True)
        difference = largest(np.abs(behind.reshape(image.shape) - image / np.float32(255)))
        missed[camera] = uniform_filter(median_filter(difference, 3), 3) > UNEXPLAINED
    if views.counts is not None:  # a pixel that does not count neither misses nor tells
        missed, tell = missed & views.counts, tell & views.counts
    return Silhouettes(missed=missed, tell=tell)


def plant_pixels(
    left: Float[np.ndarray, "cameras rows columns"], views: Views
) -> Bool[np.ndarray, "cameras height width"]:
    """The pixels that see something in the region, or lie beside one that does; `left` is as `_next_level` has it."""
    return spread(widened(left < 1 - FAINT, 1), stride(views), views)


def _anywhere(views: Views, rays: int, rng: np.random.Generator) -> Draw:
    return lambda: views.drawn(rays, rng)


def focused(
    chosen: Bool[np.ndarray, "cameras height width"], views: Views, rays: int, rng: np.random.Generator
) -> Draw:
    """Three rays in four from the chosen pixels, the others from anywhere."""
    places = numbers_of(chosen if views.counts is None else chosen & views.counts)
    near = 3 * rays // 4 if len(places) else 0

    def draw() -> Int[np.ndarray, " rays"]:
        anywhere = views.drawn(rays - near, rng)
        return np.concatenate([places[rng.integers(0, len(places), near)], anywhere]) if near else anywhere

    return draw


def numbers_of(chosen: Bool[np.ndarray, "cameras height width"]) -> Int[np.ndarray, " chosen"]:
    """Flat numbers of the chosen pixels; four bytes each, for there may be a hundred million."""
    return np.flatnonzero(chosen).astype(np.int32)


def fine_tune(
    parent: GridField,
    backgrounds: UInt8[np.ndarray, "cameras height width 3"] | None,
    first: Frame,
    frame: Frame,
    schedule: Schedule,
    seed: int,
    course: Course,
) -> GridField:
    """Train a further frame from frame 0's field, where it changed."""
    views = views_of(frame)
    changed = changed_pixels(first.images, frame.images)
    rng = np.random.default_rng(seed)
    if not changed.any():
        return replace(parent, values=parent.values[: parent.bricks.rows], outer=NOWHERE)
    if backgrounds is None:  # its parent was to stay alone
        backgrounds = still_backgrounds(parent, first).images
    draw = _changed_rays(changed, schedule.rays, rng)
    coarse = scaled_bricks(parent.bricks, 2)
    hull = carved_blocks(coarse, frame.rig, changed, CHANGE_AGREEMENT)
    field, trainable = forget(parent, None, hull, 2)
    count = round(COARSE_SHARE * schedule.iterations)
    rates = replace(schedule.rates, density=HASTE * schedule.rates.density)
    seen = train(
        field, views, backgrounds, draw, count, rng, course, rates=rates, trainable=trainable, decay=COARSE_DECAY
    )
    shape = tuple(BLOCKS * n for n in parent.bricks.slots.shape)
    candidates = halved(hull, shape)
    found = halved(seen_blocks(field.bricks, seen, FOUND_WEIGHT) & unpack(trainable, field.bricks.slots), shape)
    fine = carved_blocks(parent.bricks, frame.rig, changed, CHANGE_AGREEMENT, within=candidates) & grown(found)
    field, trainable = forget(parent, field, fine, 1, gone=candidates)
    count = schedule.iterations - count
    train(field, views, backgrounds, draw, count, rng, course, rates=rates, trainable=trainable, decay=FINE_DECAY)
    return field


def _changed_rays(changed: Bool[np.ndarray, "cameras height width"], rays: int, rng: np.random.Generator) -> Draw:
    """Most rays from pixels that changed, the others from around them: there must be nothing new."""
    inside = numbers_of(changed)
    around = numbers_of(widened(changed, RING) & ~changed)
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
