"""The normal equations of an alignment, summed over pixels and channels in one pass.

Unknowns are in the order (axis, term) of displacement, then (channel, term) of light. A row's derivative by the
displacement's coefficient (a, i) is d_a B_i, by the light's (c, m) it is -F L_m in its own channel c. Pixels are cut
into a fixed number of chunks whose sums are added in order: results do not depend on the number of threads.
"""

from typing import no_type_check

import numba
import numpy as np

CHUNKS = 4


@numba.njit(cache=True, fastmath=True, parallel=True, nogil=True)
@no_type_check
def accumulate(rises, sight, difference, weights, part, basis, light, camera, cameras):
    """Normal matrix (size, size) and the slope of the loss by each camera (cameras, size).

    `rises` (pixels, channels, 2) are the slopes of what is compared, per pixel, `sight` (pixels, 2, 3) how a pixel
    moves with its place, per metre; `difference`, `weights` and the structure's `part` are (pixels, channels).
    """
    count, terms = basis.shape
    lights = light.shape[1]
    dofs = 3 * terms
    size = dofs + 3 * lights
    normals = np.zeros((CHUNKS, size, size))
    slopes = np.zeros((CHUNKS, cameras, size))
    for chunk in numba.prange(CHUNKS):
        normal = normals[chunk]
        pull = np.empty((3, 3))
        for p in range(chunk * count // CHUNKS, (chunk + 1) * count // CHUNKS):
            slope = slopes[chunk, camera[p]]
            for c in range(3):
                for a in range(3):
                    pull[c, a] = rises[p, c, 0] * sight[p, 0, a] + rises[p, c, 1] * sight[p, 1, a]
            for a in range(3):
                force = 0.0
                for c in range(3):
                    force += weights[p, c] * pull[c, a] * difference[p, c]
                for i in range(terms):
                    slope[a * terms + i] += force * basis[p, i]
                for b in range(a, 3):
                    stiff = 0.0
                    for c in range(3):
                        stiff += weights[p, c] * pull[c, a] * pull[c, b]
                    for i in range(terms):
                        share = stiff * basis[p, i]
                        for j in range(terms):
                            normal[a * terms + i, b * terms + j] += share * basis[p, j]
                for c in range(3):
                    mixed = -weights[p, c] * pull[c, a] * part[p, c]
                    first = dofs + c * lights
                    for i in range(terms):
                        share = mixed * basis[p, i]
                        for m in range(lights):
                            normal[a * terms + i, first + m] += share * light[p, m]
            for c in range(3):
                first = dofs + c * lights
                own = weights[p, c] * part[p, c] * part[p, c]
                force = -weights[p, c] * part[p, c] * difference[p, c]
                for m in range(lights):
                    slope[first + m] += force * light[p, m]
                    share = own * light[p, m]
                    for n in range(lights):
                        normal[first + m, first + n] += share * light[p, n]
    normal, slope = normals[0], slopes[0]
    for chunk in range(1, CHUNKS):
        normal += normals[chunk]
        slope += slopes[chunk]
    for row in range(size):
        for column in range(row):
            normal[row, column] = normal[column, row]
    return normal, slope
