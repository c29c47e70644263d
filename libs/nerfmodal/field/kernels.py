"""Fused kernels of the grid field: march, composite (eq 3), differentiate and update in one pass over the rays.

Lengths are in voxels and densities per voxel, so that a step's opacity does not depend on the voxel's size. A row of
`values` is (raw density, red, green, blue) at a vertex; the density is the softplus of the interpolated raw value
(post-activation, as in DVGO, Sun et al. 2022: the surface may then be sharper than the voxel).

Space is cut into bricks of 8 x 8 x 8 vertices; `bricks` holds the slot of each or -1, `masks` one bit for each of its
4 x 4 x 4 blocks of 2 x 2 x 2 cells: rays jump over what is not set. The inner grid (the region) shares `values` with
what lies beyond: ground and sky, or an outer grid (contracted as in mip-NeRF 360, Barron et al. 2022).

Results do not depend on the number of threads: rays are cut into a fixed number of chunks with gradients of their own,
which are added in order.
"""

import math
from typing import no_type_check

import numba
import numpy as np

from nerfmodal.field.marching import MAX_SAMPLES, ROWS_PER_BRICK, march_beyond, march_inner, ray_of

numba.config.THREADING_LAYER = "omp"  # at hand on every machine; TBB warns when it is too old

CHUNKS = 2
FAINTEST = 1e-3
"""A ray less opaque than this meets nothing."""


@numba.njit(cache=True, fastmath=True)
@no_type_check
def block_bit(local):
    """Which block of its brick a vertex begins."""
    return (((local >> 6) >> 1) << 4) | ((((local >> 3) & 7) >> 1) << 2) | ((local & 7) >> 1)


@numba.njit(cache=True, fastmath=True)
@no_type_check
def mark_seen(rows, samples, n, seen):
    """Keep the largest weight of a sample in each block."""
    for index in range(n):
        row = rows[index, 0]
        block = (row // ROWS_PER_BRICK) * 64 + block_bit(row % ROWS_PER_BRICK)
        seen[block] = max(seen[block], np.float32(samples[index, 7]))


@numba.njit(cache=True, fastmath=True)
@no_type_check
def backward(rows, weights, samples, n, tail, error, decay, gradient, touched):
    """Scatter the loss's derivative of one ray; `tail` is T_end times the background, `error` dL/dC."""
    behind0, behind1, behind2 = tail[0], tail[1], tail[2]
    for index in range(n - 1, -1, -1):
        delta, before, raw, weight = samples[index, 1], samples[index, 2], samples[index, 3], samples[index, 7]
        red, green, blue = samples[index, 4], samples[index, 5], samples[index, 6]
        after = before - weight
        slope = delta * (  # dC/dsigma_i = delta (T_(i+1) c_i - everything behind)
            error[0] * (after * red - behind0)
            + error[1] * (after * green - behind1)
            + error[2] * (after * blue - behind2)
        )
        sigmoid = 1.0 / (1.0 + math.exp(-raw))  # derivative of the softplus
        g_raw = np.float32((slope + decay * delta) * sigmoid)
        g_red, g_green, g_blue = (
            np.float32(error[0] * weight),
            np.float32(error[1] * weight),
            np.float32(error[2] * weight),
        )
        for corner in range(8):
            row = rows[index, corner]
            if row >= 0:
                w = weights[index, corner]
                gradient[row, 0] += w * g_raw
                gradient[row, 1] += w * g_red
                gradient[row, 2] += w * g_green
                gradient[row, 3] += w * g_blue
                touched[row // ROWS_PER_BRICK] = 1
        behind0 += weight * red
        behind1 += weight * green
        behind2 += weight * blue


@numba.njit(cache=True, fastmath=True, parallel=True, nogil=True)
@no_type_check
def train_batch(
    bricks,
    masks,
    outer,
    values,
    low,
    voxel,
    half,
    ground,
    sides,
    table,
    cell,
    poses,
    images,
    backgrounds,
    use_outer,
    pixels,
    jitters,
    step,
    decay,
    limit,
    gradients,
    touched,
    seen,
):
    """Loss (eq 9, one field) of a batch of pixels (camera, row, column) and its gradient, added to `gradients`.

    Without `use_outer` what lies beyond the region is the picture in `backgrounds`. `seen` keeps the largest weight
    that a sample of each block had. An error beyond `limit` pulls no harder than `limit` (Huber).
    """
    count = pixels.shape[0]
    losses = np.zeros(CHUNKS)
    base = masks.shape[0] * ROWS_PER_BRICK
    center = low + half
    for chunk in numba.prange(CHUNKS):
        rows = np.empty((MAX_SAMPLES, 8), np.int32)
        weights = np.empty((MAX_SAMPLES, 8), np.float32)
        samples = np.empty((MAX_SAMPLES, 8), np.float64)
        tail, error = np.zeros(3), np.zeros(3)
        for index in range(chunk * count // CHUNKS, (chunk + 1) * count // CHUNKS):
            camera, row, column = pixels[index, 0], pixels[index, 1], pixels[index, 2]
            dx, dy, dz = ray_of(table, poses, camera, row, column, cell)
            px, py, pz = poses[camera, 0, 3], poses[camera, 1, 3], poses[camera, 2, 3]
            n, transmittance, far = march_inner(
                bricks,
                masks,
                values,
                half,
                voxel,
                (px - low[0]) / voxel,
                (py - low[1]) / voxel,
                (pz - low[2]) / voxel,
                dx,
                dy,
                dz,
                step,
                jitters[index],
                rows,
                weights,
                samples,
            )
            mark_seen(rows, samples, n, seen[chunk])
            if use_outer:
                n, transmittance = march_beyond(
                    outer,
                    base,
                    values,
                    half,
                    center,
                    ground,
                    sides,
                    px,
                    py,
                    pz,
                    dx,
                    dy,
                    dz,
                    max(far, 0.0) * voxel,
                    jitters[index],
                    rows,
                    weights,
                    samples,
                    n,
                    transmittance,
                )
            for channel in range(3):
                tail[channel] = 0.0
                if not use_outer:
                    tail[channel] = transmittance * backgrounds[camera, row, column, channel] / 255.0
                color = tail[channel]
                for sample in range(n):
                    color += samples[sample, 7] * samples[sample, 4 + channel]  # eq 3
                difference = color - images[camera, row, column, channel] / 255.0
                losses[chunk] += difference * difference  # eq 9
                error[channel] = 2.0 * min(max(difference, -limit), limit)
            backward(rows, weights, samples, n, tail, error, decay, gradients[chunk], touched[chunk])
    return losses.sum() / (3 * count)


@numba.njit(cache=True, fastmath=True, parallel=True, nogil=True)
@no_type_check
def adam(values, gradients, touched, first, second, trainable, base, step, rates):
    """Adam (Kingma and Ba 2015) on the vertices that the batch touched; clears gradients and marks.

    Inner vertices move only where their block's bit of `trainable` is set; `rates` are (density, colour).
    """
    correct1, correct2 = 1.0 - 0.9**step, 1.0 - 0.99**step
    for brick in numba.prange(values.shape[0] // ROWS_PER_BRICK):
        hit = False
        for chunk in range(CHUNKS):
            hit |= touched[chunk, brick] != 0
            touched[chunk, brick] = 0
        if not hit:
            continue
        for local in range(ROWS_PER_BRICK):
            row = brick * ROWS_PER_BRICK + local
            moves = row >= base
            if not moves:
                moves = (trainable[brick] >> np.uint64(block_bit(local))) & np.uint64(1) != 0
            for channel in range(4):
                total = np.float32(0)
                for chunk in range(CHUNKS):
                    total += gradients[chunk, row, channel]
                    gradients[chunk, row, channel] = 0
                if total == 0 or not moves:
                    continue
                first[row, channel] = 0.9 * first[row, channel] + 0.1 * total
                second[row, channel] = 0.99 * second[row, channel] + 0.01 * total * total
                rate = rates[0] if channel == 0 else rates[1]
                values[row, channel] -= (
                    rate * (first[row, channel] / correct1) / (math.sqrt(second[row, channel] / correct2) + 1e-10)
                )


@numba.njit(cache=True, fastmath=True)
@no_type_check
def crossing(samples, n, target):
    """Where the accumulated weight of a ray's samples passes `target`, voxels."""
    gone = 0.0
    for sample in range(n):
        weight = samples[sample, 7]
        if gone + weight >= target:
            return samples[sample, 0] + ((target - gone) / max(weight, 1e-9) - 0.5) * samples[sample, 1]
        gone += weight
    return 0.0


@numba.njit(cache=True, fastmath=True, parallel=True, nogil=True)
@no_type_check
def render_pixels(
    bricks, masks, outer, values, low, voxel, half, ground, sides, table, cell, poses, use_outer, pixels, step
):
    """Colour in front, transmittance, colour behind, distance and spread (metres) of the rays through `pixels`.

    The distance is the median of the ray's weights, the spread that between their quartiles; 0 where it meets nothing.
    """
    count = pixels.shape[0]
    front = np.zeros((count, 3), np.float32)
    behind = np.zeros((count, 3), np.float32)
    left = np.ones(count, np.float32)
    distance = np.zeros(count, np.float32)
    spread = np.zeros(count, np.float32)
    base = masks.shape[0] * ROWS_PER_BRICK
    center = low + half
    for chunk in numba.prange(64):
        rows = np.empty((MAX_SAMPLES, 8), np.int32)
        weights = np.empty((MAX_SAMPLES, 8), np.float32)
        samples = np.empty((MAX_SAMPLES, 8), np.float64)
        for index in range(chunk * count // 64, (chunk + 1) * count // 64):
            camera, row, column = pixels[index, 0], pixels[index, 1], pixels[index, 2]
            dx, dy, dz = ray_of(table, poses, camera, row, column, cell)
            px, py, pz = poses[camera, 0, 3], poses[camera, 1, 3], poses[camera, 2, 3]
            n, transmittance, far = march_inner(
                bricks,
                masks,
                values,
                half,
                voxel,
                (px - low[0]) / voxel,
                (py - low[1]) / voxel,
                (pz - low[2]) / voxel,
                dx,
                dy,
                dz,
                step,
                0.5,
                rows,
                weights,
                samples,
            )
            left[index] = transmittance
            for sample in range(n):
                for channel in range(3):
                    front[index, channel] += samples[sample, 7] * samples[sample, 4 + channel]
            total = 1.0 - transmittance
            if total > FAINTEST:
                distance[index] = crossing(samples, n, 0.5 * total) * voxel
                spread[index] = (crossing(samples, n, 0.75 * total) - crossing(samples, n, 0.25 * total)) * voxel
            if use_outer:
                n, _ = march_beyond(
                    outer,
                    base,
                    values,
                    half,
                    center,
                    ground,
                    sides,
                    px,
                    py,
                    pz,
                    dx,
                    dy,
                    dz,
                    max(far, 0.0) * voxel,
                    0.5,
                    rows,
                    weights,
                    samples,
                    0,
                    1.0,
                )
                for sample in range(n):
                    for channel in range(3):
                        behind[index, channel] += samples[sample, 7] * samples[sample, 4 + channel]
    return front, left, behind, distance, spread
