"""One ray through a grid field: where it goes, what it meets there, and what lies beyond the region.

The conventions are those of `kernels`, which calls these for every ray of a batch.
"""

import math
from typing import no_type_check

import numba
import numpy as np

from nerfmodal.field.corners import gather

MAX_SAMPLES = 768
AT_ONCE = 16
"""Samples of a ray whose opacities are found together; a part of `MAX_SAMPLES`."""
LIMIT = 30.0
"""Raw densities beyond it are as good as it."""
PER_LOG_2 = 1.4426950408889634
ROOT_HALF = 0x3F3504F3
"""The bits of the root of 1/2."""
OPAQUE = 1e-3
"""A ray ends when its transmittance falls below this."""


@numba.njit(cache=True, fastmath=True, error_model="numpy")
@no_type_check
def softplus(raw):
    """log(1 + exp(raw)), without overflow."""
    return raw if raw > 15.0 else math.log(1.0 + math.exp(raw))


@numba.njit(cache=True, fastmath=True, error_model="numpy", forceinline=True)
@no_type_check
def ray_of(table, poses, camera, row, column, cell):
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


@numba.njit(cache=True, fastmath=True, error_model="numpy", forceinline=True)
@no_type_check
def box_span(ox, oy, oz, dx, dy, dz, sx, sy, sz):
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


@numba.njit(cache=True, fastmath=True, error_model="numpy", forceinline=True)
@no_type_check
def inverse(d):
    """1 / d, finite for a ray that runs along a face."""
    return 1.0 / d if abs(d) > 1e-9 else math.copysign(1e9, d)


@numba.njit(cache=True, fastmath=True, error_model="numpy", forceinline=True)
@no_type_check
def to_exit(x, y, z, i, j, k, ix, iy, iz, size, around):
    """Distance to the far side of the aligned cube of `size` (a power of two) cells around cell (i, j, k).

    The cube is `around` cells larger on every side. (ix, iy, iz) is the inverse of the ray's direction.
    """
    low, ahead = ~(size - 1), size + around
    distance = ((i & low) + (ahead if ix > 0 else -around) - x) * ix
    distance = min(distance, ((j & low) + (ahead if iy > 0 else -around) - y) * iy)
    distance = min(distance, ((k & low) + (ahead if iz > 0 else -around) - z) * iz)
    return max(distance, 0.0)


@numba.njit(cache=True, fastmath=True, error_model="numpy", forceinline=True)
@no_type_check
def exp2(x):
    """2^x in single precision, for -126 < x < 127; a polynomial, so that a processor takes eight at once."""
    whole = np.floor(x + np.float32(0.5))
    f = x - whole  # in -0.5..0.5
    p = np.float32(0.00961813) + f * (np.float32(0.00133336) + f * np.float32(0.00015404))
    p = np.float32(0.24022651) + f * (np.float32(0.05550411) + f * p)
    p = np.float32(1) + f * (np.float32(0.6931472) + f * p)
    return p * np.int32((np.int32(whole) + 127) << 23).view(np.float32)


@numba.njit(cache=True, fastmath=True, error_model="numpy", forceinline=True)
@no_type_check
def log2(x):
    """Logarithm to the base 2 in single precision, for normal x > 0; without a branch, as `exp2`."""
    bits = np.float32(x).view(np.int32)
    whole = np.int32(np.int32(bits - ROOT_HALF) >> 23)
    m = np.int32(bits - np.int32(whole << 23)).view(np.float32)  # between the roots of 1/2 and 2
    s = (m - np.float32(1)) / (m + np.float32(1))
    q = s * s
    p = np.float32(0.96179669) + q * (np.float32(0.57707802) + q * np.float32(0.41219858))
    return np.float32(whole) + s * (np.float32(2.88539008) + q * p)


@numba.njit(cache=True, fastmath=True, error_model="numpy", forceinline=True)
@no_type_check
def activate(raw, delta):
    """Opacity of a sample of length `delta` (eq 3), and the derivative of its density by its raw density.

    1 - exp(-softplus(raw) delta) = 1 - (1 + exp(raw))^-delta; the softplus has the sigmoid for its derivative.
    """
    raw = raw if raw > np.float32(-LIMIT) else np.float32(-LIMIT)
    raw = raw if raw < np.float32(LIMIT) else np.float32(LIMIT)
    e, one = exp2(raw * np.float32(PER_LOG_2)), np.float32(1)
    thickness = log2(one + e) * delta
    thickness = thickness if thickness < np.float32(125) else np.float32(125)
    return one - exp2(-thickness), e / (one + e)  # eq 3: alpha_i


@numba.njit(cache=True, fastmath=True, error_model="numpy")
@no_type_check
def activate_all(lanes, delta):
    """`activate` what is in the first of three rows; opacities to the second, derivatives to the third.

    Of a loop whose length it knew the compiler would make a long row of single steps.
    """
    for lane in range(lanes.shape[1]):
        lanes[1, lane], lanes[2, lane] = activate(lanes[0, lane], delta)


@numba.njit(cache=True, fastmath=True, error_model="numpy", forceinline=True)
@no_type_check
def keep_sample(samples, n, t, delta, opacity, slope, transmittance):
    """Composite sample n (eq 3): `samples[n]` = t, delta, T_i, dsigma/draw, rgb, weight. Returns the transmittance."""
    samples[n, 0] = t
    samples[n, 1] = delta
    samples[n, 2] = transmittance
    samples[n, 3] = slope
    samples[n, 7] = transmittance * opacity  # eq 8: w_i
    return transmittance * (np.float32(1) - opacity)  # eq 3: T_(i+1)


@numba.njit(cache=True, fastmath=True, error_model="numpy")
@no_type_check
def march_inner(
    bricks, masks, values, half, voxel, ox, oy, oz, dx, dy, dz, nearest, step, jitter, rows, offsets, samples, lanes
):
    """Samples of one ray inside the region, from `nearest` on. Returns how many, the transmittance left, the exit.

    Some are looked up before it is known whether light gets as far: so their opacities are found together.
    """
    nx, ny, nz = 2.0 * half[0] / voxel, 2.0 * half[1] / voxel, 2.0 * half[2] / voxel
    near, far = box_span(ox, oy, oz, dx, dy, dz, nx, ny, nz)
    near = max(near, nearest)
    n, transmittance, delta = 0, np.float32(1), np.float32(step)
    ix, iy, iz = inverse(dx), inverse(dy), inverse(dz)
    per_step = 1.0 / step
    t = near + jitter * step
    while t < far and n < MAX_SAMPLES and transmittance >= OPAQUE:
        begin = n
        while t < far and n < begin + AT_ONCE:
            x = min(max(ox + dx * t, 0.0), nx - 1e-3)
            y = min(max(oy + dy * t, 0.0), ny - 1e-3)
            z = min(max(oz + dz * t, 0.0), nz - 1e-3)
            i, j, k = int(x), int(y), int(z)
            slot = bricks[i >> 3, j >> 3, k >> 3]
            size, around = 0, 0
            if slot < 0:
                size, around = 8, -8 * (slot + 1)
            else:
                mask = masks[slot]
                bit = (((i & 7) >> 1) << 4) | (((j & 7) >> 1) << 2) | ((k & 7) >> 1)
                if mask == 0:
                    size = 8
                elif (mask >> np.uint64(bit)) & np.uint64(1) == 0:
                    size = 2
            if size > 0:
                t += (int(to_exit(x, y, z, i, j, k, ix, iy, iz, size, around) * per_step) + 1) * step
                continue
            lanes[0, n - begin] = gather(bricks, 0, values, x, y, z, rows, offsets, samples, n)
            samples[n, 0] = t
            n += 1
            t += step
        activate_all(lanes, delta)
        found, n = n, begin
        while n < found and transmittance >= OPAQUE:
            lane = n - begin
            opacity, slope = lanes[1, lane], lanes[2, lane]
            transmittance = keep_sample(samples, n, samples[n, 0], delta, opacity, slope, transmittance)
            n += 1
    return n, transmittance, far


@numba.njit(cache=True, fastmath=True, error_model="numpy")
@no_type_check
def march_outer(
    bricks, base, values, half, center, ox, oy, oz, dx, dy, dz, start, jitter, rows, offsets, samples, n, transmittance
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
        raw = gather(
            bricks,
            base,
            values,
            min((x * shrink + 2.0) * 0.25, 0.9999) * cells,
            min((y * shrink + 2.0) * 0.25, 0.9999) * cells,
            min((z * shrink + 2.0) * 0.25, 0.9999) * cells,
            rows,
            offsets,
            samples,
            n,
        )
        last = r > 60.0 or n == MAX_SAMPLES - 1
        delta = np.float32(1e4 if last else 1.0)
        opacity, slope = activate(raw, delta)
        transmittance = keep_sample(samples, n, t, delta, opacity, slope, transmittance)
        if last:
            samples[n, 7] = samples[n, 2]
            transmittance = 0.0
        n += 1
        t += advance
    return n, transmittance


@numba.njit(cache=True, fastmath=True, error_model="numpy")
@no_type_check
def march_beyond(
    outer,
    base,
    values,
    half,
    center,
    ground,
    sides,
    ox,
    oy,
    oz,
    dx,
    dy,
    dz,
    start,
    jitter,
    rows,
    offsets,
    samples,
    n,
    left,
):
    """Whatever lies beyond the region: the outer grid where there is one, else the ground and the sky."""
    if n >= MAX_SAMPLES or left < OPAQUE:
        return n, left
    if outer.size > 0:
        return march_outer(
            outer, base, values, half, center, ox, oy, oz, dx, dy, dz, start, jitter, rows, offsets, samples, n, left
        )
    return meet_ground(
        values, base, half, center, ground, sides, ox, oy, oz, dx, dy, dz, rows, offsets, samples, n, left
    )


@numba.njit(cache=True, fastmath=True, error_model="numpy")
@no_type_check
def texel(values, start, size, u, v, rows, offsets, samples, n):
    """Bilinear colour of the square texture of `size` that begins at row `start`; (u, v) in 0..1; opaque."""
    x, y = min(max(u, 0.0), 1.0) * (size - 1.001), min(max(v, 0.0), 1.0) * (size - 1.001)
    i, j = int(x), int(y)
    a, b = np.float32(x - i), np.float32(y - j)
    one = np.float32(1)
    for channel in range(3):
        samples[n, 4 + channel] = 0.0
    for corner in range(8):
        rows[n, corner] = -1
    offsets[n, 0], offsets[n, 1], offsets[n, 2] = a, b, 0.0
    for corner in range(4):
        di, dj = corner >> 1, corner & 1
        row = start + (i + di) * size + j + dj
        w = (a if di else one - a) * (b if dj else one - b)
        rows[n, 2 * corner] = row
        for channel in range(3):
            samples[n, 4 + channel] += w * values[row, 1 + channel]


@numba.njit(cache=True, fastmath=True, error_model="numpy")
@no_type_check
def meet_ground(
    values, base, half, center, ground, sides, ox, oy, oz, dx, dy, dz, rows, offsets, samples, n, transmittance
):
    """The last sample of a ray: the ground plane where it falls, contracted, or the sky where it rises.

    `ground` is the plane's height at the origin and its slopes: z = h + a x + b y.
    """
    nears = dz - ground[1] * dx - ground[2] * dy
    above = oz - ground[0] - ground[1] * ox - ground[2] * oy
    if nears < -1e-4 and above > 0.0:
        t = -above / nears
        x, y = (ox + dx * t - center[0]) / half[0], (oy + dy * t - center[1]) / half[1]
        r = max(abs(x), abs(y), 1.0)
        shrink = (2.0 - 1.0 / r) / r * 0.25
        texel(values, base, sides[0], 0.5 + x * shrink, 0.5 + y * shrink, rows, offsets, samples, n)
    else:
        t = 1e3
        u, v = 0.5 + math.atan2(dy, dx) / (2.0 * math.pi), 0.5 + math.asin(min(max(dz, -1.0), 1.0)) / math.pi
        texel(values, base + sides[0] ** 2, sides[1], u, v, rows, offsets, samples, n)
    samples[n, 0], samples[n, 1], samples[n, 2], samples[n, 3] = t, 0.0, transmittance, 0.0
    samples[n, 7] = transmittance
    return n + 1, 0.0
