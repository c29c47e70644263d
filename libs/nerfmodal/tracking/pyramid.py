"""Pictures in levels of detail, and reading them between pixels.

Level 0 is smoothed by half a pixel, level 1 by one; every further level doubles the smoothing and keeps every second
pixel. Pixel i of a level is pixel i * factor of the picture: centres lie on centres, so nothing shifts.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import no_type_check

import numba
import numpy as np
from jaxtyping import Float, Int, UInt8
from scipy import ndimage

FINEST = 0.5
"""Smoothing of level 0 (standard deviation, pixels): what a sampled picture needs to be read between its pixels."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Level:
    """Pictures smoothed by `sigma` pixels of the original, every `factor`-th pixel kept."""

    factor: int
    sigma: float
    images: Float[np.ndarray, "cameras height width channels"]


def levels_of(images: UInt8[np.ndarray, "cameras height width channels"], count: int) -> tuple[Level, ...]:
    """The `count` levels of pictures, finest first, values in 0..1."""
    smooth = smoothed(images.astype(np.float32) / np.float32(255), FINEST)
    levels = [Level(factor=1, sigma=FINEST, images=smooth)]
    while len(levels) < count:
        last = levels[-1]
        sigma = 2 * last.sigma
        smooth = smoothed(last.images, math.sqrt(sigma**2 - last.sigma**2) / last.factor)
        step = 1 if sigma < 2 else 2
        levels.append(
            Level(factor=step * last.factor, sigma=sigma, images=np.ascontiguousarray(smooth[:, ::step, ::step]))
        )
    return tuple(levels)


def smoothed(images: Float[np.ndarray, "cameras height width channels"], sigma: float) -> np.ndarray:
    """Convolved with a Gaussian along rows and columns; the edge's pixels go on beyond it."""
    reach = max(1, math.ceil(3 * sigma))
    weights = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2)
    weights = (weights / weights.sum()).astype(np.float32)
    return np.asarray(_along_rows(_along_columns(images, weights), weights))


@numba.njit(cache=True, fastmath=True, parallel=True, nogil=True)
@no_type_check
def _along_rows(images, weights):
    cameras, height, width, channels = images.shape
    reach = len(weights) // 2
    result = np.zeros_like(images)
    for row in numba.prange(cameras * height):
        camera, i = row // height, row % height
        for j in range(width):
            for k in range(-reach, reach + 1):
                w, source = weights[k + reach], min(max(j + k, 0), width - 1)
                for channel in range(channels):
                    result[camera, i, j, channel] += w * images[camera, i, source, channel]
    return result


@numba.njit(cache=True, fastmath=True, parallel=True, nogil=True)
@no_type_check
def _along_columns(images, weights):
    cameras, height, width, channels = images.shape
    reach = len(weights) // 2
    result = np.zeros_like(images)
    for row in numba.prange(cameras * height):
        camera, i = row // height, row % height
        for k in range(-reach, reach + 1):
            w, source = weights[k + reach], min(max(i + k, 0), height - 1)
            for j in range(width):
                for channel in range(channels):
                    result[camera, i, j, channel] += w * images[camera, source, j, channel]
    return result


def splines_of(levels: Sequence[Level]) -> tuple[Level, ...]:
    """The levels as coefficients of cubic B-splines that go through every pixel (Unser et al. 1993), for `read`.

    Cheaper interpolation would see a texture move by a hundredth of a pixel more or less than it does.
    """
    return tuple(replace(level, images=_coefficients(level.images)) for level in levels)


def _coefficients(images: np.ndarray) -> np.ndarray:
    along = ndimage.spline_filter1d(images, axis=1, output=np.float32)
    return np.asarray(ndimage.spline_filter1d(along, axis=2, output=np.float32))


def read(
    splines: Level, camera: Int[np.ndarray, " points"], pixels: Float[np.ndarray, "points 2"]
) -> tuple[Float[np.ndarray, "points channels"], Float[np.ndarray, "points channels 2"]]:
    """Values at places of the original pictures (x to the right, y down; the first centre at 0.5), and their slopes.

    Slopes are per pixel of the original, along x and y.
    """
    places = (pixels - 0.5) / splines.factor
    values, slopes = _read(splines.images, camera.astype(np.int64), places)
    return values, slopes / np.float32(splines.factor)


@numba.njit(cache=True, fastmath=True)
@no_type_check
def _cubic(t, values, slopes):
    """The four B-splines around, and their derivatives, at the share t of the way between the middle two pixels."""
    u = 1.0 - t
    values[0], values[3] = u * u * u / 6.0, t * t * t / 6.0
    values[1] = 2.0 / 3.0 - t * t + 0.5 * t * t * t
    values[2] = 2.0 / 3.0 - u * u + 0.5 * u * u * u
    slopes[0], slopes[3] = -0.5 * u * u, 0.5 * t * t
    slopes[1] = -2.0 * t + 1.5 * t * t
    slopes[2] = 2.0 * u - 1.5 * u * u


@numba.njit(cache=True, fastmath=True)
@no_type_check
def _mirrored(index, size):
    return -index if index < 0 else 2 * size - 2 - index if index >= size else index


@numba.njit(cache=True, fastmath=True, parallel=True, nogil=True)
@no_type_check
def _read(images, camera, places):
    height, width, channels = images.shape[1:]
    count = len(camera)
    values = np.zeros((count, channels), np.float32)
    slopes = np.zeros((count, channels, 2), np.float32)
    for chunk in numba.prange(16):
        wx, wy, sx, sy = np.empty(4), np.empty(4), np.empty(4), np.empty(4)
        for index in range(chunk * count // 16, (chunk + 1) * count // 16):
            x = min(max(places[index, 0], 0.0), width - 1.0)
            y = min(max(places[index, 1], 0.0), height - 1.0)
            i, j = int(y), int(x)
            _cubic(x - j, wx, sx)
            _cubic(y - i, wy, sy)
            for a in range(4):
                row = _mirrored(i + a - 1, height)
                for b in range(4):
                    column = _mirrored(j + b - 1, width)
                    w, dx, dy = wy[a] * wx[b], wy[a] * sx[b], sy[a] * wx[b]
                    for channel in range(channels):
                        value = images[camera[index], row, column, channel]
                        values[index, channel] += w * value
                        slopes[index, channel, 0] += dx * value
                        slopes[index, channel, 1] += dy * value
    return values, slopes
