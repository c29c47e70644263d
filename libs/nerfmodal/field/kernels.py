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

import numba
import numpy as np

numba.config.THREADING_LAYER = "omp"

CHUNKS = 2
MAX_SAMPLES = 768
ROWS_PER_BRICK = 512
EMPTY_RAW = np.float32(-6.0)
GROUND_SIDE = 512
SKY_SIDE = 256
OPAQUE = 1e-3
"""A ray ends when its transmittance falls below this."""


@numba.njit(cache=True, fastmath=True)
def softplus(raw):  # type: ignore[no-untyped-def]
    """log(1 + exp(raw)), without overflow."""
    return raw if raw > 15.0 else math.log1p(math.exp(raw))


@numba.njit(cache=True, fastmath=True)
def ray_of(table, poses, camera, row, column, cell):  # type: ignore[no-untyped-def]
    """Unit world direction through a pixel's centre, from the table of undistorted image points every `cell` pixels."""
    v, u = (row + 0.5) / cell, (column + 0.5) / cell
    i, j = min(int(v), table.shape[1] - 2), min(int(u), table.shape[2] - 2)
    a, b = v - i, u - j
    corners = table[camera, i : i + 2, j : j + 2]
    x = (1 - a) * ((1 - b) * corners[0, 0, 0] + b * corners[0, 1, 0]) + a * (
        (1 - b) * corners[1, 0, 0] + b * corners[1, 1, 0]
    )
    y = (1 - a) * ((1 - b) * corners[0, 0, 1] + b * corners[0, 1, 1]) + a * (
        (1 - b) * corners[1, 0, 1] + b * corners[1, 1, 1]
    )
    pose = poses[camera]
    scale = 1.0 / math.sqrt(x * x + y * y + 1.0)
    return (
        (pose[0, 0] * x - pose[0, 1] * y - pose[0, 2]) * scale,
        (pose[1, 0] * x - pose[1, 1] * y - pose[1, 2]) * scale,
        (pose[2, 0] * x - pose[2, 1] * y - pose[2, 2]) * scale,
    )


@numba.njit(cache=True, fastmath=True)
def box_span(ox, oy, oz, dx, dy, dz, sx, sy, sz):  # type: ignore[no-untyped-def]
    """Where a ray enters and leaves the box (0, 0, 0)-(sx, sy, sz); a miss has near >= far."""
    near, far = 0.0, 1e9
    for o, d, s in ((ox, dx, sx), (oy, dy, sy), (oz, dz, sz)):
        if abs(d) < 1e-12:
            if o < 0 or o > s:
                return 0.0, -1.0
        else:
            first, second = -o / d, (s - o) / d
            near, far = max(near, min(first, second)), min(far, max(first, second))
    return near, far


@numba.njit(cache=True, fastmath=True)
def to_exit(x, y, z, dx, dy, dz, size):  # type: ignore[no-untyped-def]
    """Distance to the far side of the aligned cube of side `size` that holds the point."""
    distance = 1e9
    for p, d in ((x, dx), (y, dy), (z, dz)):
        if d > 1e-9:
            distance = min(distance, ((math.floor(p / size) + 1) * size - p) / d)
        elif d < -1e-9:
            distance = min(distance, (math.floor(p / size) * size - p) / d)
    return max(distance, 0.0)


@numba.njit(cache=True, fastmath=True)
def gather(bricks, base, values, x, y, z, rows, weights, samples, n):  # type: ignore[no-untyped-def]
    """Interpolate at a point: keep its eight corners' rows and weights; raw density and colour in `samples[n, 3:7]`."""
    i, j, k = int(x), int(y), int(z)
    a, b, c = np.float32(x - i), np.float32(y - j), np.float32(z - k)
    raw, red, green, blue = np.float32(0), np.float32(0), np.float32(0), np.float32(0)
    one = np.float32(1)
    corner = 0
    for di in range(2):
        wi = a if di else one - a
        for dj in range(2):
            wj = wi * (b if dj else one - b)
            for dk in range(2):
                w = wj * (c if dk else one - c)
                p, q, r = i + di, j + dj, k + dk
                slot = bricks[p >> 3, q >> 3, r >> 3]
                weights[n, corner] = w
                if slot < 0:
                    rows[n, corner] = -1
                    raw += w * EMPTY_RAW
                else:
                    row = base + slot * ROWS_PER_BRICK + (((p & 7) << 6) | ((q & 7) << 3) | (r & 7))
                    rows[n, corner] = row
                    raw += w * values[row, 0]
                    red += w * values[row, 1]
                    green += w * values[row, 2]
                    blue += w * values[row, 3]
                corner += 1
    samples[n, 3] = raw
    samples[n, 4] = red
    samples[n, 5] = green
    samples[n, 6] = blue


@numba.njit(cache=True, fastmath=True)
def keep_sample(samples, n, t, delta, transmittance):  # type: ignore[no-untyped-def]
    """Composite sample n (eq 3): `samples[n]` = t, delta, T_i, raw, rgb, weight. Returns the new transmittance."""
    opacity = -math.expm1(-softplus(samples[n, 3]) * delta)  # eq 3: alpha_i
    samples[n, 0] = t
    samples[n, 1] = delta
    samples[n, 2] = transmittance
    samples[n, 7] = transmittance * opacity  # eq 8: w_i
    return transmittance * (1.0 - opacity)  # eq 3: T_(i+1)


@numba.njit(cache=True, fastmath=True)
def march_inner(  # type: ignore[no-untyped-def]
    bricks, masks, values, half, voxel, ox, oy, oz, dx, dy, dz, step, jitter, rows, weights, samples
):
    """Samples of one ray inside the region. Returns their number, the transmittance left, and the exit."""
    nx, ny, nz = 2.0 * half[0] / voxel, 2.0 * half[1] / voxel, 2.0 * half[2] / voxel
    near, far = box_span(ox, oy, oz, dx, dy, dz, nx, ny, nz)
    n, transmittance = 0, 1.0
    t = near + jitter * step
    while t < far and n < MAX_SAMPLES:
        x = min(max(ox + dx * t, 0.0), nx - 1e-3)
        y = min(max(oy + dy * t, 0.0), ny - 1e-3)
        z = min(max(oz + dz * t, 0.0), nz - 1e-3)
        i, j, k = int(x), int(y), int(z)
        slot = bricks[i >> 3, j >> 3, k >> 3]
        size = 0
        if slot < 0:
            size = 8
        else:
            bit = (((i & 7) >> 1) << 4) | (((j & 7) >> 1) << 2) | ((k & 7) >> 1)
            if (masks[slot] >> np.uint64(bit)) & np.uint64(1) == 0:
                size = 2
        if size > 0:
            t += (math.floor(to_exit(x, y, z, dx, dy, dz, size) / step) + 1) * step
            continue
        gather(bricks, 0, values, x, y, z, rows, weights, samples, n)
        transmittance = keep_sample(samples, n, t, step, transmittance)
        n += 1
        if transmittance < OPAQUE:
            break
        t += step
    return n, transmittance, far


@numba.njit(cache=True, fastmath=True)
def march_outer(  # type: ignore[no-untyped-def]
    bricks, base, values, half, center, ox, oy, oz, dx, dy, dz, start, jitter, rows, weights, samples, n, transmittance
):
    """Samples of one ray beyond the region, in contracted space; the last one is opaque (the sky)."""
    cells = bricks.shape[0] * 8 - 1
    t = start
    first = True
    while n < MAX_SAMPLES and transmittance >= OPAQUE:
        x, y, z = (
            (ox + dx * t - center[0]) / half[0],
            (oy + dy * t - center[1]) / half[1],
            (oz + dz * t - center[2]) / half[2],
        )
        r = max(abs(x), abs(y), abs(z), 1.0)
        advance = 4.0 / cells * r * min(r, 3.0 + 0.1 * r) * min(half[0], half[1], half[2])
        if first:
            t += advance * jitter
            first = False
            continue
        shrink = (2.0 - 1.0 / r) / r  # contraction of mip-NeRF 360, in the largest norm
        gather(
            bricks,
            base,
            values,
            min((x * shrink + 2.0) * 0.25, 0.9999) * cells,
            min((y * shrink + 2.0) * 0.25, 0.9999) * cells,
            min((z * shrink + 2.0) * 0.25, 0.9999) * cells,
            rows,
            weights,
            samples,
            n,
        )
        last = r > 60.0 or n == MAX_SAMPLES - 1
        transmittance = keep_sample(samples, n, t, 1e4 if last else 1.0, transmittance)
        if last:
            samples[n, 7] = samples[n, 2]
            transmittance = 0.0
        n += 1
        t += advance
    return n, transmittance


@numba.njit(cache=True, fastmath=True)
def march_beyond(  # type: ignore[no-untyped-def]
    outer, base, values, half, center, ground, ox, oy, oz, dx, dy, dz, start, jitter, rows, weights, samples, n, left
):
    """Whatever lies beyond the region: the outer grid where there is one, else the ground and the sky."""
    if n >= MAX_SAMPLES or left < OPAQUE:
        return n, left
    if outer.size > 0:
        return march_outer(
            outer, base, values, half, center, ox, oy, oz, dx, dy, dz, start, jitter, rows, weights, samples, n, left
        )
    return meet_ground(values, base, half, center, ground, ox, oy, oz, dx, dy, dz, rows, weights, samples, n, left)


@numba.njit(cache=True, fastmath=True)
def texel(values, start, size, u, v, rows, weights, samples, n):  # type: ignore[no-untyped-def]
    """Bilinear colour of the square texture of `size` that begins at row `start`; (u, v) in 0..1; opaque."""
    x, y = min(max(u, 0.0), 1.0) * (size - 1.001), min(max(v, 0.0), 1.0) * (size - 1.001)
    i, j = int(x), int(y)
    a, b = np.float32(x - i), np.float32(y - j)
    one = np.float32(1)
    for channel in range(3):
        samples[n, 4 + channel] = 0.0
    for corner in range(8):
        rows[n, corner] = -1
    for corner in range(4):
        di, dj = corner >> 1, corner & 1
        row = start + (i + di) * size + j + dj
        w = (a if di else one - a) * (b if dj else one - b)
        rows[n, corner], weights[n, corner] = row, w
        for channel in range(3):
            samples[n, 4 + channel] += w * values[row, 1 + channel]


@numba.njit(cache=True, fastmath=True)
def meet_ground(  # type: ignore[no-untyped-def]
    values, base, half, center, ground, ox, oy, oz, dx, dy, dz, rows, weights, samples, n, transmittance
):
    """The last sample of a ray: the ground plane where it falls, contracted, or the sky where it rises."""
    if dz < -1e-4 and oz > ground:
        t = (ground - oz) / dz
        x, y = (ox + dx * t - center[0]) / half[0], (oy + dy * t - center[1]) / half[1]
        r = max(abs(x), abs(y), 1.0)
        shrink = (2.0 - 1.0 / r) / r * 0.25
        texel(values, base, GROUND_SIDE, 0.5 + x * shrink, 0.5 + y * shrink, rows, weights, samples, n)
    else:
        t = 1e3
        u, v = 0.5 + math.atan2(dy, dx) / (2.0 * math.pi), 0.5 + math.asin(min(max(dz, -1.0), 1.0)) / math.pi
        texel(values, base + GROUND_SIDE**2, SKY_SIDE, u, v, rows, weights, samples, n)
    samples[n, 0], samples[n, 1], samples[n, 2], samples[n, 3] = t, 0.0, transmittance, 0.0
    samples[n, 7] = transmittance
    return n + 1, 0.0


@numba.njit(cache=True, fastmath=True)
def block_bit(local):  # type: ignore[no-untyped-def]
    """Which block of its brick a vertex begins."""
    return (((local >> 6) >> 1) << 4) | ((((local >> 3) & 7) >> 1) << 2) | ((local & 7) >> 1)


@numba.njit(cache=True, fastmath=True)
def mark_seen(rows, samples, n, seen):  # type: ignore[no-untyped-def]
    """Keep the largest weight of a sample in each block."""
    for index in range(n):
        row = rows[index, 0]
        block = (row // ROWS_PER_BRICK) * 64 + block_bit(row % ROWS_PER_BRICK)
        seen[block] = max(seen[block], np.float32(samples[index, 7]))


@numba.njit(cache=True, fastmath=True)
def backward(rows, weights, samples, n, tail, error, decay, gradient, touched):  # type: ignore[no-untyped-def]
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
def train_batch(  # type: ignore[no-untyped-def]
    bricks,
    masks,
    outer,
    values,
    low,
    voxel,
    half,
    ground,
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
def adam(values, gradients, touched, first, second, trainable, base, step, rates):  # type: ignore[no-untyped-def]
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


@numba.njit(cache=True, fastmath=True, parallel=True, nogil=True)
def render_pixels(  # type: ignore[no-untyped-def]
    bricks, masks, outer, values, low, voxel, half, ground, table, cell, poses, use_outer, pixels, step, level
):
    """Colour in front, transmittance, colour behind and distance (metres) of the rays through `pixels`.

    The distance is where the ray's accumulated opacity passes `level` (0 where it never does).
    """
    count = pixels.shape[0]
    front = np.zeros((count, 3), np.float32)
    behind = np.zeros((count, 3), np.float32)
    left = np.ones(count, np.float32)
    distance = np.zeros(count, np.float32)
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
            gone = 0.0
            for sample in range(n):
                weight = samples[sample, 7]
                for channel in range(3):
                    front[index, channel] += weight * samples[sample, 4 + channel]
                if gone < level <= gone + weight:
                    part = (level - gone) / weight - 0.5
                    distance[index] = (samples[sample, 0] + part * step) * voxel
                gone += weight
            if use_outer:
                n, _ = march_beyond(
                    outer,
                    base,
                    values,
                    half,
                    center,
                    ground,
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
    return front, left, behind, distance
