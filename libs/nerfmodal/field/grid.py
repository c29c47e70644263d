"""The fast field: a sparse grid of density and colour, trained coarse to fine by the kernels.

Frame 0 is trained everywhere, together with the outer grid that explains what lies beyond the region; from it comes a
still background for each camera. A further frame changes only where its pictures differ from those of frame 0.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int, UInt8

from nerfmodal.field import kernels
from nerfmodal.field.bricks import Bricks, allocate, brick_counts, grown, refine, seen_blocks, with_masks
from nerfmodal.field.corners import LINE, ROWS_PER_BRICK
from nerfmodal.field.course import Course
from nerfmodal.field.device import gpu
from nerfmodal.field.views import CELL, Views, pixels_at

OUTER_BRICKS = 2
"""Along a side of the outer grid: a finer one learns, for each camera, a picture of its own of what lies beyond."""
PIXELS_PER_TEXEL = 3.5
FOG_RAW = np.float32(-4.0)
"""Raw density of a voxel before any training: 0.018 per voxel, from which short trainings still become opaque."""
FORGOTTEN_RAW = np.float32(-6.0)
"""Raw density of a voxel that is to be learned anew: 0.0025 per voxel."""
VISIBLE_WEIGHT = 0.05
"""A block in which no sample had more weight than this is empty (or hidden): its vertices are not kept."""
DECAY = 1e-3
"""Pull on every sample's density towards nothing, so that fog that explains nothing clears."""
DISTORTION = 1e-3
"""Pull of a ray's weights towards one place, per voxel of their distance: fog behind a leaf's gaps gathers on it."""
STEP = 0.6
"""Distance between samples, voxels."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GridField:
    """A grid field: vertices of the inner bricks first in `values`, then those of the outer ones (may be absent)."""

    bricks: Bricks
    high: Float[np.ndarray, " 3"]
    values: Float[np.ndarray, "rows 4"]
    outer: Int[np.ndarray, "x y z"]
    ground: Float[np.ndarray, " 3"]
    """Its height (m) at the origin and its slopes along x and y; not a number where there is an outer grid instead."""
    sides: tuple[int, int] = (0, 0)
    """Texels along the ground's and the sky's texture."""

    @property
    def has_ground(self) -> bool:
        """Whether a ground and a sky lie beyond the region."""
        return bool(np.isfinite(self.ground).all())

    @property
    def half(self) -> Float[np.ndarray, " 3"]:
        """Half the extent of the region, metres: the unit of the contracted space."""
        return 0.5 * (self.high - self.bricks.low)


def grid_state(field: GridField) -> dict[str, np.ndarray]:
    """The arrays of a grid field, as a checkpoint keeps them."""
    return {
        "low": field.bricks.low,
        "high": field.high,
        "voxel": np.array([field.bricks.voxel, *field.ground]),
        "sides": np.array(field.sides),
        "slots": field.bricks.slots,
        "masks": field.bricks.masks,
        "outer": field.outer,
        "values": field.values,
    }


def grid_of(state: Mapping[str, np.ndarray]) -> GridField:
    """The grid field that these arrays are."""
    voxel, *ground = state["voxel"].tolist()
    bricks = Bricks(low=state["low"], voxel=voxel, slots=state["slots"], masks=state["masks"])
    return GridField(
        bricks=bricks,
        high=state["high"],
        values=state["values"],
        outer=state["outer"],
        ground=np.array([*ground, 0.0, 0.0][:3]),  # older checkpoints have the height of a level ground alone
        sides=(int(state["sides"][0]), int(state["sides"][1])),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Rates:
    """Learning rates of Adam for raw density and colour; they fall by `decay` over the training."""

    density: float = 0.5
    color: float = 0.04
    final: float = 0.1


class Optimiser:
    """Adam's moments and the gradient buffers of one field."""

    def __init__(self, rows: int, blocks: int) -> None:
        self.gradients = np.zeros((kernels.CHUNKS, rows, 4), np.float32)
        self.touched = np.zeros((kernels.CHUNKS, rows // LINE), np.uint8)
        self.moments = np.zeros((rows // LINE, 2 * kernels.LANES), np.float32)
        self.seen = np.zeros((kernels.CHUNKS, blocks), np.float32)
        self.steps = 0


def empty_field(
    low: np.ndarray,
    high: np.ndarray,
    voxel: float,
    ground: Float[np.ndarray, " 3"] | None,
    pixels: int = 1_000_000,
) -> GridField:
    """A field of which nothing is known: faint grey fog.

    Beyond the region lie the `ground` (height and slopes) and a sky, or, when it is None, an outer grid.
    `pixels` of all pictures decide how fine the ground's texture is: several must see each texel.
    """
    counts = brick_counts(low, high, voxel)
    bricks = allocate(low, voxel, np.ones(tuple(counts * 4), dtype=bool))
    side = OUTER_BRICKS if ground is None else 0
    outer = np.arange(side**3, dtype=np.int32).reshape(side, side, side)
    sides = _texture_sides(pixels)
    beyond = outer.size * ROWS_PER_BRICK if ground is None else sides[0] ** 2 + sides[1] ** 2
    values = np.full((bricks.rows + beyond, 4), 0.5, np.float32)
    values[:, 0] = FOG_RAW
    plane = np.full(3, np.nan) if ground is None else ground
    return GridField(bricks=bricks, high=high, values=values, outer=outer, ground=plane, sides=sides)


def _texture_sides(pixels: int) -> tuple[int, int]:
    side = 2 ** int(np.clip(np.floor(np.log2(pixels / PIXELS_PER_TEXEL) / 2), 6, 9))
    return side, side // 2


def train(
    field: GridField,
    views: Views,
    backgrounds: UInt8[np.ndarray, "cameras height width 3"] | None,
    draw: Callable[[], Int[np.ndarray, " rays"]],
    iterations: int,
    rng: np.random.Generator,
    course: Course,
    *,
    rates: Rates,
    trainable: np.ndarray | None = None,
    decay: float = DECAY,
    distortion: float = DISTORTION,
    limit: float = 10.0,
) -> Float[np.ndarray, " blocks"]:
    """Change `field.values` in place for a number of iterations of the `course`.

    Returns for every block of every brick the largest weight that a sample in it had in the second half.
    Without `backgrounds` what lies beyond the region is trained too.
    """
    where = field.bricks.masks if trainable is None else trainable
    if (device := gpu()) is not None:
        from nerfmodal.field import grid_gpu

        course.turn()
        return grid_gpu.train(
            field,
            views,
            backgrounds,
            draw,
            iterations,
            rng,
            course,
            rates=rates,
            trainable=where,
            decay=decay,
            distortion=distortion,
            limit=limit,
            device=device,
        )
    optimiser = Optimiser(len(field.values), 64 * len(field.bricks.masks))
    outside = views.images if backgrounds is None else backgrounds
    course.turn()
    for iteration in range(iterations):
        if iteration == iterations // 2:
            optimiser.seen[:] = 0  # what was fog at first may be clear by now
        pixels = pixels_at(draw(), views.images.shape)
        loss = kernels.train_batch(
            field.bricks.slots,
            field.bricks.masks,
            field.outer,
            field.values,
            field.bricks.low,
            field.bricks.voxel,
            field.half,
            field.ground,
            field.sides,
            views.table,
            CELL,
            views.poses,
            views.nears,
            views.images,
            outside,
            backgrounds is None,
            pixels,
            rng.random(len(pixels)),
            STEP,
            decay,
            distortion,
            limit,
            optimiser.gradients,
            optimiser.touched,
            optimiser.seen,
        )
        optimiser.steps += 1
        scale = rates.final ** (course.done / course.total)
        kernels.adam(
            field.values,
            optimiser.gradients,
            optimiser.touched,
            optimiser.moments,
            where,
            field.bricks.rows,
            optimiser.steps,
            np.array([rates.density * scale, rates.color * scale]),
        )
        course.step(float(loss), len(pixels))
    return np.asarray(optimiser.seen.max(axis=0))


def pruned(field: GridField, seen: Float[np.ndarray, " blocks"]) -> GridField:
    """The field with only the blocks that rays saw, and their neighbours, so that rays jump over the others."""
    return replace(field, bricks=with_masks(field.bricks, grown(seen_blocks(field.bricks, seen, VISIBLE_WEIGHT))))


def refined(field: GridField, seen: Float[np.ndarray, " blocks"]) -> GridField:
    """The field with half the voxel, and vertices only near what rays saw."""
    occupied = grown(seen_blocks(field.bricks, seen, VISIBLE_WEIGHT))
    bricks, inner = refine(field.bricks, field.values[: field.bricks.rows], field.high, occupied)
    return replace(field, bricks=bricks, values=np.concatenate([inner, field.values[field.bricks.rows :]]))


def render(
    field: GridField, views: Views, pixels: Int[np.ndarray, "rays 3"], *, behind: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Colour in front (rays, 3), transmittance (rays,), colour behind (rays, 3), distance and spread (rays,) m."""
    if (device := gpu()) is not None:
        from nerfmodal.field import grid_gpu

        return grid_gpu.look(field, views, pixels, behind=behind, device=device)
    return kernels.render_pixels(
        field.bricks.slots,
        field.bricks.masks,
        field.outer,
        field.values,
        field.bricks.low,
        field.bricks.voxel,
        field.half,
        field.ground,
        field.sides,
        views.table,
        CELL,
        views.poses,
        views.nears,
        behind,
        pixels,
        STEP,
    )
