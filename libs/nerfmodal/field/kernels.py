"""Fused kernels of the grid field: march, composite (eq 3), differentiate and update in one pass over the rays.

Lengths are in voxels and densities per voxel, so that a step's opacity does not depend on the voxel's size. A row of
`values` is (raw density, red, green, blue) at a vertex; the density is the softplus of the interpolated raw value
(post-activation, as in DVGO, Sun et al. 2022: the surface may then be sharper than the voxel).

Space is cut into bricks of 8 x 8 x 8 vertices; `bricks` holds the slot of each, or minus its distance to the nearest
that has vertices, `masks` one bit for each of its 4 x 4 x 4 blocks of 2 x 2 x 2 cells: rays jump over what is not set.
The inner grid (the region) shares `values` with what lies beyond: ground and sky, or an outer grid (contracted as in
mip-NeRF 360, Barron et al. 2022).

Results do not depend on the number of threads: rays are cut into a fixed number of chunks with gradients of their own,
which are added in order.
"""

import math
from typing import no_type_check

import numba
import numpy as np

from nerfmodal.field.corners import LINE, ROWS_PER_BRICK, tell
from nerfmodal.field.marching import AT_ONCE, MAX_SAMPLES, march_beyond, march_inner, ray_of

numba.config.THREADING_LAYER = "omp"  # at hand on every machine; TBB warns when it is too old

CHUNKS = 2
LANES = 4 * LINE
"""Numbers of a line."""
CLEAR = 0.98
"""A ray that keeps more than this of its light sees the ground or the sky, and only such rays teach it: they would
else learn, for each camera, the picture of whatever stands before them, and leave that half transparent."""
FAINTEST = 1e-3
"""A ray less opaque than this meets nothing."""


@numba.njit(cache=True, fastmath=True, error_model="numpy", forceinline=True)
@no_type_check
def block_bit(local):
    """Which block of its brick a vertex begins."""
    return (((local >> 6) >> 1) << 4) | ((((local >> 3) & 7) >> 1) << 2) | ((local & 7) >> 1)


@numba.njit(cache=True, fastmath=True, error_model="numpy", forceinline=True)
@no_type_check
def mark_seen(rows, samples, n, seen):
    """Keep the largest weight of a sample in each block."""
    for index in range(n):
        row = rows[index, 0]
        block = (row // ROWS_PER_BRICK) * 64 + block_bit(row % ROWS_PER_BRICK)
        seen[block] = max(seen[block], samples[index, 7])


@numba.njit(cache=True, fastmath=True, error_model="numpy", forceinline=True)
@no_type_check
def gather_pulls(samples, n, strength, pulls):
    """Derivative of the ray's distortion (Barron et al. 2022, eq 15) by each weight: it pulls the weights together.

    strength * (sum_ij w_i w_j |t_i - t_j| + sum_i w_i^2 delta_i / 3), in one pass each way instead of over all pairs.
    """
    two, start = np.float32(2), samples[0, 0]  # from the first: a difference of large numbers would lose digits
    weight, moment = np.float32(0), np.float32(0)
    for index in range(n):
        t, w = samples[index, 0] - start, samples[index, 7]
        pulls[index] = two * (t * weight - moment) + two / np.float32(3) * w * samples[index, 1]
        weight += w
        moment += w * t
    weight, moment = np.float32(0), np.float32(0)
    for index in range(n - 1, -1, -1):
        t, w = samples[index, 0] - start, samples[index, 7]
        pulls[index] = np.float32(strength) * (pulls[index] + two * (moment - t * weight))
        weight += w
        moment += w * t


@numba.njit(cache=True, fastmath=True, error_model="numpy", forceinline=True)
@no_type_check
def backward(rows, offsets, samples, n, tail, error, pulls, decay, gradient, touched):
    """Scatter the loss's derivative of one ray; `tail` is T_end times the background, `error` dL/dC.

    `pulls` is what else each weight is pulled by (dL/dw).
    """
    behind = error[0] * tail[0] + error[1] * tail[1] + error[2] * tail[2]
    pull = np.float32(decay)
    for index in range(n - 1, -1, -1):
        delta, before, weight = samples[index, 1], samples[index, 2], samples[index, 7]
        after = before - weight
        own = error[0] * samples[index, 4] + error[1] * samples[index, 5] + error[2] * samples[index, 6] + pulls[index]
        slope = delta * (after * own - behind)  # dC/dsigma_i = delta (T_(i+1) c_i - everything behind)
        behind += weight * own
        g_raw = (slope + pull * delta) * samples[index, 3]
        g_red, g_green, g_blue = error[0] * weight, error[1] * weight, error[2] * weight
        tell(gradient, touched, rows, offsets, index, (g_raw, g_red, g_green, g_blue))


@numba.njit(cache=True, fastmath=True, error_model="numpy", parallel=True, nogil=True)
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
    nears,
    images,
    backgrounds,
    use_outer,
    pixels,
    jitters,
    step,
    decay,
    distortion,
    limit,
    gradients,
    touched,
    seen,
):
    """Loss (eq 9, one field) of a batch of pixels (camera, row, column) and its gradient, added to `gradients`.

    Without `use_outer` what lies beyond the region is the picture in `backgrounds`. `seen` keeps the largest weight
    that a sample of each block had. An error beyond `limit` pulls no harder than `limit` (Huber).
    `decay` pulls every density towards nothing, `distortion` the weights of a ray in the region towards one place.
    """
    count = pixels.shape[0]
    losses = np.zeros(CHUNKS)
    base = masks.shape[0] * ROWS_PER_BRICK
    center = low + half
    for chunk in numba.prange(CHUNKS):
        rows = np.empty((MAX_SAMPLES, 8), np.int32)
        offsets = np.empty((MAX_SAMPLES, 3), np.float32)
        samples, lanes = np.empty((MAX_SAMPLES, 8), np.float32), np.zeros((3, AT_ONCE), np.float32)
        tail, error, pulls = np.zeros(3, np.float32), np.zeros(3, np.float32), np.zeros(MAX_SAMPLES, np.float32)
        loss = 0.0
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
                nears[camera] / voxel,
                step,
                jitters[index],
                rows,
                offsets,
                samples,
                lanes,
            )
            mark_seen(rows, samples, n, seen[chunk])
            gather_pulls(samples, n, distortion, pulls)
            inside, lit = n, transmittance
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
                    max(far * voxel, nears[camera]),
                    jitters[index],
                    rows,
                    offsets,
                    samples,
                    n,
                    transmittance,
                )
                if outer.size == 0 and lit < CLEAR:
                    rows[inside:n] = -1
            pulls[inside:n] = 0.0
            for channel in range(3):
                tail[channel] = 0.0
                if not use_outer:
                    tail[channel] = transmittance * backgrounds[camera, row, column, channel] / 255.0
                color = tail[channel]
                for sample in range(n):
                    color += samples[sample, 7] * samples[sample, 4 + channel]  # eq 3
                difference = color - images[camera, row, column, channel] / 255.0
                loss += difference * difference  # eq 9
                error[channel] = 2.0 * min(max(difference, -limit), limit)
            backward(rows, offsets, samples, n, tail, error, pulls, decay, gradients[chunk], touched[chunk])
        losses[chunk] = loss
    return losses.sum() / (3 * count)


@numba.njit(cache=True, fastmath=True, error_model="numpy", parallel=True, nogil=True)
@no_type_check
def adam(values, gradients, touched, moments, trainable, base, step, rates):
    """Adam (Kingma and Ba 2015) on the vertices that the batch touched; clears gradients and marks.

    Inner vertices move only where their block's bit of `trainable` is set; `rates` are (density, colour). Only lines
    with a touched vertex are visited: most of a batch's time would else be spent on what no ray has met.
    `moments` holds the first ones of a line, then the second.
    """
    scale = np.float32(1.0 / math.sqrt(1.0 - 0.99**step))
    speeds = speeds_of(rates, 1.0 / (1.0 - 0.9**step))
    lines = values.shape[0] // LINE
    lanes, sums = values.reshape(lines, LANES), gradients.reshape(CHUNKS, lines, LANES)
    for part in numba.prange(64):
        for line in range(part * lines // 64, (part + 1) * lines // 64):
            found = -1
            for chunk in range(CHUNKS):
                if touched[chunk, line] != 0:
                    touched[chunk, line] = 0
                    if found < 0:
                        found = chunk
                    else:
                        move(sums[chunk, line], sums[found, line])
            if found >= 0:
                adam_line(lanes[line], sums[found, line], moments[line], speeds[pairs_of(trainable, line, base)], scale)


@numba.njit(cache=True, fastmath=True, error_model="numpy")
@no_type_check
def speeds_of(rates, correct):
    """How fast each number of a line learns, for every choice of pairs of vertices that may move."""
    speeds = np.zeros((16, LANES), np.float32)
    for pairs in range(16):
        for lane in range(LANES):
            if pairs >> (lane >> 3) & 1:
                speeds[pairs, lane] = correct * (rates[0] if lane % 4 == 0 else rates[1])
    return speeds


@numba.njit(cache=True, fastmath=True, error_model="numpy", forceinline=True)
@no_type_check
def move(source, target):
    """Add one chunk's gradients of a line to another's."""
    for lane in range(LANES):
        target[lane] += source[lane]
        source[lane] = np.float32(0)


@numba.njit(cache=True, fastmath=True, error_model="numpy", forceinline=True)
@no_type_check
def pairs_of(trainable, line, base):
    """Which of a line's four pairs of vertices may move, as bits; a pair belongs to one block."""
    if line * LINE >= base:
        return np.uint64(15)
    local = line % (ROWS_PER_BRICK // LINE)
    bit = ((local >> 3) >> 1 << 4) | ((local & 7) >> 1 << 2)
    return (trainable[line // (ROWS_PER_BRICK // LINE)] >> np.uint64(bit)) & np.uint64(15)


@numba.njit(cache=True, fastmath=True, error_model="numpy", forceinline=True)
@no_type_check
def adam_line(values, gradients, moments, speeds, scale):
    """One step of Adam on a line's numbers; without a branch, so that a processor takes eight of them at once."""
    for lane in range(LANES):
        gradient = gradients[lane]
        gradients[lane] = np.float32(0)
        m = np.float32(0.9) * moments[lane] + np.float32(0.1) * gradient
        v = np.float32(0.99) * moments[LANES + lane] + np.float32(0.01) * gradient * gradient
        met = gradient != 0
        moments[lane] = m if met else moments[lane]
        moments[LANES + lane] = v if met else moments[LANES + lane]
        step = speeds[lane] * m / (math.sqrt(v) * scale + np.float32(1e-10))
        values[lane] -= step if met else np.float32(0)


@numba.njit(cache=True, fastmath=True, error_model="numpy")
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


@numba.njit(cache=True, fastmath=True, error_model="numpy", parallel=True, nogil=True)
@no_type_check
def render_pixels(
    bricks, masks, outer, values, low, voxel, half, ground, sides, table, cell, poses, nears, use_outer, pixels, step
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
        offsets = np.empty((MAX_SAMPLES, 3), np.float32)
        samples, lanes = np.empty((MAX_SAMPLES, 8), np.float32), np.zeros((3, AT_ONCE), np.float32)
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
                nears[camera] / voxel,
                step,
                0.5,
                rows,
                offsets,
                samples,
                lanes,
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
                    max(far * voxel, nears[camera]),
                    0.5,
                    rows,
                    offsets,
                    samples,
                    0,
                    1.0,
                )
                for sample in range(n):
                    for channel in range(3):
                        behind[index, channel] += samples[sample, 7] * samples[sample, 4 + channel]
    return front, left, behind, distance, spread
