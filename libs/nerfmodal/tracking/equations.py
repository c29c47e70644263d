"""The normal equations of an alignment, summed over pixels and channels in one pass.

Unknowns are in the order (axis, term) of displacement, then (channel, term) of light. A row's derivative by the
displacement's coefficient (a, i) is d_a B_i, by the light's (c, m) it is -F L_m in its own channel c. So every block of
the normal matrix is a sum over pixels of a number times the product of two of their basis functions: a product of two
matrices, one of them weighted. Pixels are cut into a fixed number of chunks whose sums are added in order: results do
not depend on the number of threads.
"""

from typing import no_type_check

import numba
import numpy as np

CHUNKS = 4
BLOCK = 128
"""Pixels whose products are taken at once: they stay in the processor's cache."""
PAIRS = 6
"""Of axes (a, b), a <= b."""


@numba.njit(cache=True, fastmath=True, parallel=True, nogil=True)
@no_type_check
def accumulate(rises, sight, difference, weights, part, basis, light, camera, cameras):
    """Normal matrix (size, size) and the slope of the loss by each camera (cameras, size).

    `rises` (pixels, channels, 2) are the slopes of what is compared, per pixel, `sight` (pixels, 2, 3) how a pixel
    moves with its place, per metre; `difference`, `weights` and the structure's `part` are (pixels, channels).
    """
    count, terms = basis.shape
    lights = light.shape[1]
    size = 3 * terms + 3 * lights
    stiff = np.zeros((CHUNKS, terms, PAIRS * terms))
    mixed = np.zeros((CHUNKS, lights, 9 * terms))
    bright = np.zeros((CHUNKS, lights, 3 * lights))
    slopes = np.zeros((CHUNKS, cameras, size))
    for chunk in numba.prange(CHUNKS):
        by_stiff = np.empty((BLOCK, PAIRS * terms))
        by_mixed = np.empty((BLOCK, 9 * terms))
        by_bright = np.empty((BLOCK, 3 * lights))
        pull = np.empty((3, 3))
        last = (chunk + 1) * count // CHUNKS
        for first in range(chunk * count // CHUNKS, last, BLOCK):
            end = min(first + BLOCK, last)
            for p in range(first, end):
                row, slope = p - first, slopes[chunk, camera[p]]
                for c in range(3):
                    for a in range(3):
                        pull[c, a] = rises[p, c, 0] * sight[p, 0, a] + rises[p, c, 1] * sight[p, 1, a]
                _weigh_motion(pull, difference[p], weights[p], part[p], basis[p], slope, by_stiff[row], by_mixed[row])
                _weigh_light(difference[p], weights[p], part[p], light[p], slope[3 * terms :], by_bright[row])
            used = end - first
            stiff[chunk] += np.dot(basis[first:end].T, by_stiff[:used])
            mixed[chunk] += np.dot(light[first:end].T, by_mixed[:used])
            bright[chunk] += np.dot(light[first:end].T, by_bright[:used])
    normal = _arranged(stiff.sum(axis=0), mixed.sum(axis=0), bright.sum(axis=0), terms, lights)
    return normal, slopes.sum(axis=0)


@numba.njit(cache=True, fastmath=True, nogil=True)
@no_type_check
def _weigh_motion(pull, difference, weights, part, basis, slope, by_stiff, by_mixed):
    """One pixel's slope by displacement; its basis times the weight of each pair of axes, of each axis and channel."""
    terms = len(basis)
    pair = 0
    for a in range(3):
        force = 0.0
        for c in range(3):
            force += weights[c] * pull[c, a] * difference[c]
            share = -weights[c] * pull[c, a] * part[c]
            for i in range(terms):
                by_mixed[(3 * a + c) * terms + i] = share * basis[i]
        for i in range(terms):
            slope[a * terms + i] += force * basis[i]
        for b in range(a, 3):
            share = 0.0
            for c in range(3):
                share += weights[c] * pull[c, a] * pull[c, b]
            for i in range(terms):
                by_stiff[pair * terms + i] = share * basis[i]
            pair += 1


@numba.njit(cache=True, fastmath=True, nogil=True)
@no_type_check
def _weigh_light(difference, weights, part, light, slope, by_bright):
    """The same by light, whose channels do not mix."""
    lights = len(light)
    for c in range(3):
        force, share = -weights[c] * part[c] * difference[c], weights[c] * part[c] * part[c]
        for m in range(lights):
            slope[c * lights + m] += force * light[m]
            by_bright[c * lights + m] = share * light[m]


@numba.njit(cache=True, nogil=True)
@no_type_check
def _arranged(stiff, mixed, bright, terms, lights):
    """The blocks in their places; the matrix is symmetric."""
    dofs = 3 * terms
    normal = np.zeros((dofs + 3 * lights, dofs + 3 * lights))
    pair = 0
    for a in range(3):
        rows = slice(a * terms, (a + 1) * terms)
        for b in range(a, 3):
            block = stiff[:, pair * terms : (pair + 1) * terms]
            normal[rows, b * terms : (b + 1) * terms] = block
            normal[b * terms : (b + 1) * terms, rows] = block
            pair += 1
        for c in range(3):
            columns = slice(dofs + c * lights, dofs + (c + 1) * lights)
            block = mixed[:, (3 * a + c) * terms : (3 * a + c + 1) * terms]
            normal[rows, columns] = block.T
            normal[columns, rows] = block
    for c in range(3):
        own = slice(dofs + c * lights, dofs + (c + 1) * lights)
        normal[own, own] = bright[:, c * lights : (c + 1) * lights]
    return normal
