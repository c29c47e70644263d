"""Where a grid field has vertices: bricks, the blocks in them that are not empty, and finer bricks from coarser ones.

A brick is 8 x 8 x 8 vertices, a block 2 x 2 x 2 cells; memory grows with the surface, because only bricks with a block
that is not empty have vertices.
"""

from dataclasses import dataclass
from typing import no_type_check

import numba
import numpy as np
from jaxtyping import Bool, Float, Int, UInt64
from scipy.ndimage import binary_dilation, distance_transform_cdt

from nerfmodal.field.corners import EMPTY_RAW, ROWS_PER_BRICK
from nerfmodal.field.marching import softplus

BLOCKS = 4
"""Blocks along the side of a brick."""

Occupancy = Bool[np.ndarray, "_ _ _"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Bricks:
    """A sparse grid: `low` is the first vertex (metres), `slots` the number of each brick.

    A brick without vertices has minus its distance, in bricks and diagonally, to the nearest that has some: as far as
    that a ray meets nothing. (-1 always holds.)
    """

    low: Float[np.ndarray, " 3"]
    voxel: float
    slots: Int[np.ndarray, "x y z"]
    masks: UInt64[np.ndarray, " bricks"]

    @property
    def rows(self) -> int:
        """Vertices it has."""
        return len(self.masks) * ROWS_PER_BRICK


def brick_counts(low: np.ndarray, high: np.ndarray, voxel: float) -> np.ndarray:
    """Bricks along each axis that cover the box."""
    cells = np.ceil((high - low) / voxel - 1e-6)
    return np.asarray(np.ceil((cells + 1) / 8), dtype=np.int64)


def allocate(low: np.ndarray, voxel: float, occupied: Occupancy) -> Bricks:
    """Bricks for the blocks that are occupied; `occupied` covers whole bricks."""
    shape = np.array(occupied.shape) // BLOCKS
    grouped = occupied.reshape(shape[0], BLOCKS, shape[1], BLOCKS, shape[2], BLOCKS).transpose(0, 2, 4, 1, 3, 5)
    bits = grouped.reshape(-1, BLOCKS**3)
    used = bits.any(axis=1)
    slots = -_distances(used.reshape(shape)).reshape(-1)
    slots[used] = np.arange(used.sum())
    return Bricks(low=low, voxel=voxel, slots=slots.reshape(shape), masks=pack(bits[used]))


def _distances(used: Occupancy) -> Int[np.ndarray, "x y z"]:
    """Of each brick to the nearest that is used, one between neighbours, also diagonal ones."""
    if not used.any():
        return np.ones(used.shape, dtype=np.int32)
    return np.asarray(distance_transform_cdt(~used, "chessboard"), dtype=np.int32)


def pack(bits: Bool[np.ndarray, "bricks 64"]) -> UInt64[np.ndarray, " bricks"]:
    """One bit for each block of a brick."""
    powers = np.uint64(1) << np.arange(BLOCKS**3, dtype=np.uint64)
    return (bits * powers).sum(axis=1, dtype=np.uint64)


def unpack(masks: UInt64[np.ndarray, " bricks"], slots: Int[np.ndarray, "x y z"]) -> Occupancy:
    """The inverse of `pack`, laid out in space."""
    shape = slots.shape
    bits = np.zeros((slots.size, BLOCKS**3), dtype=bool)
    present = slots.ravel() >= 0
    shifted = masks[slots.ravel()[present], None] >> np.arange(BLOCKS**3, dtype=np.uint64)
    bits[present] = (shifted & np.uint64(1)).astype(bool)
    spread = bits.reshape(*shape, BLOCKS, BLOCKS, BLOCKS).transpose(0, 3, 1, 4, 2, 5)
    return spread.reshape(shape[0] * BLOCKS, shape[1] * BLOCKS, shape[2] * BLOCKS)


def with_masks(bricks: Bricks, occupied: Occupancy) -> Bricks:
    """The same bricks, with only the given blocks of them set."""
    shape = bricks.slots.shape
    grouped = occupied.reshape(shape[0], BLOCKS, shape[1], BLOCKS, shape[2], BLOCKS).transpose(0, 2, 4, 1, 3, 5)
    bits = grouped.reshape(-1, BLOCKS**3)
    masks = np.zeros_like(bricks.masks)
    present = bricks.slots.ravel() >= 0
    masks[bricks.slots.ravel()[present]] = pack(bits[present])
    return Bricks(low=bricks.low, voxel=bricks.voxel, slots=bricks.slots, masks=masks)


def emptied(bricks: Bricks) -> Bricks:
    """The same vertices, of which rays meet none."""
    slots = np.full(bricks.slots.shape, -max(bricks.slots.shape), dtype=np.int32)
    return Bricks(low=bricks.low, voxel=bricks.voxel, slots=slots, masks=np.zeros_like(bricks.masks))


def seen_blocks(bricks: Bricks, seen: Float[np.ndarray, " blocks"], threshold: float) -> Occupancy:
    """Blocks in which a sample's weight exceeded `threshold`, or half of the largest one where none did."""
    limit = min(threshold, 0.5 * float(seen.max(initial=0.0)))  # a short training is faint everywhere
    masks = pack(seen.reshape(-1, BLOCKS**3) > limit)
    return unpack(masks & bricks.masks, bricks.slots)


def grown(blocks: Occupancy) -> Occupancy:
    """The blocks and their neighbours."""
    return np.asarray(binary_dilation(blocks, np.ones((3, 3, 3), dtype=bool)))


def halved(blocks: Occupancy, shape: tuple[int, ...]) -> Occupancy:
    """The same places in blocks half as large, in an array of `shape`."""
    fine = blocks.repeat(2, 0).repeat(2, 1).repeat(2, 2)
    fitting = np.zeros(shape, dtype=bool)
    part = tuple(slice(0, min(a, b)) for a, b in zip(shape, fine.shape, strict=True))
    fitting[part] = fine[part]
    return fitting


def refine(
    coarse: Bricks, values: Float[np.ndarray, "rows 4"], high: np.ndarray, occupied: Occupancy
) -> tuple[Bricks, Float[np.ndarray, "fine_rows 4"]]:
    """Halve the voxel where `occupied` (blocks of the coarse grid) is set.

    The density of a place does not change, so its value per voxel halves.
    """
    voxel = coarse.voxel / 2
    shape = tuple(BLOCKS * int(count) for count in brick_counts(coarse.low, high, voxel))
    fine = allocate(coarse.low, voxel, halved(occupied, shape))
    return fine, sample_vertices(coarse, values, fine)


def sample_vertices(
    coarse: Bricks, values: Float[np.ndarray, "rows 4"], fine: Bricks
) -> Float[np.ndarray, "fine_rows 4"]:
    """The coarse field at the fine vertices, with densities converted to the finer voxel."""
    sampled = np.empty((fine.rows, 4), dtype=np.float32)
    _interpolate(coarse.slots, values, fine.slots, fine.voxel / coarse.voxel, sampled)
    return sampled


@numba.njit(cache=True, parallel=True)
@no_type_check
def _interpolate(coarse, values, fine, ratio, sampled):
    limits = (coarse.shape[0] * 8 - 1, coarse.shape[1] * 8 - 1, coarse.shape[2] * 8 - 1)
    for bx in numba.prange(fine.shape[0]):
        for by in range(fine.shape[1]):
            for bz in range(fine.shape[2]):
                slot = fine[bx, by, bz]
                for local in range(ROWS_PER_BRICK if slot >= 0 else 0):
                    x = min((bx * 8 + (local >> 6)) * ratio, limits[0] - 1e-3)
                    y = min((by * 8 + ((local >> 3) & 7)) * ratio, limits[1] - 1e-3)
                    z = min((bz * 8 + (local & 7)) * ratio, limits[2] - 1e-3)
                    _interpolate_one(coarse, values, x, y, z, ratio, sampled[slot * ROWS_PER_BRICK + local])


@numba.njit(cache=True)
@no_type_check
def _interpolate_one(coarse, values, x, y, z, ratio, out):
    i, j, k = int(x), int(y), int(z)
    out[:] = 0
    found = 0.0
    for corner in range(8):
        p, q, r = i + (corner >> 2), j + ((corner >> 1) & 1), k + (corner & 1)
        w = abs(1 - p + i - (x - i)) * abs(1 - q + j - (y - j)) * abs(1 - r + k - (z - k))
        slot = coarse[p >> 3, q >> 3, r >> 3]
        if slot < 0:
            out[0] += w * EMPTY_RAW
            continue
        row = slot * ROWS_PER_BRICK + (((p & 7) << 6) | ((q & 7) << 3) | (r & 7))
        found += w
        for channel in range(4):
            out[channel] += w * values[row, channel]
    if found > 0:
        for channel in range(1, 4):
            out[channel] /= found
    density = max(softplus(out[0]) * ratio, 1e-6)
    out[0] = density if density > 15 else np.log(np.expm1(density))
