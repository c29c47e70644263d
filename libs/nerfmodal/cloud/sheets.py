"""Is this one sheet? How far the points of a candidate lie from a smooth surface in every frame, and how solid it is.

Two leaves that touch are one piece of cells. They are two because no single smooth surface follows both motions.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import linalg, sparse, spatial, special

DEGREE = 5
SPLIT_DEGREE = 3
"""Of the surfaces that compete for cells: a high one explodes beyond its own cells."""
REWEIGHTINGS = 4
MOST_POINTS = 900
"""Of a candidate in a frame."""
FEWEST_POINTS = 60
ROUNDS = 8
TORN = 1.5
"""Two sheets must be smoother by this factor to be believed where one was."""
PROMISING = 1.1
"""So much smoother must a first guess of the parts be to be followed up; the best `TRIED` are."""
TRIED = 3
SMALLEST_PART = 0.12


Sample = tuple[Float[np.ndarray, "_ 3"], Int[np.ndarray, " _"]]
"""Points of a frame and the cell of each."""


def roughness(frames: Sequence[Float[np.ndarray, "_ 3"]], degree: int = DEGREE) -> float:
    """Median distance (metres) of the points from the polynomial sheet that fits each frame best."""
    frames = [points[:MOST_POINTS] for points in frames if len(points) >= FEWEST_POINTS]
    if not frames:
        return np.inf
    frame = _plane(np.concatenate(frames))
    return float(np.median(np.concatenate([np.abs(_heights(points, points, frame, degree)) for points in frames])))


def solidity(centers: Float[np.ndarray, "cells 3"], side: float) -> float:
    """Area over that of the convex hull, in the plane that fits the cells best: 1 for a leaf, less for a star."""
    if len(centers) < 8:
        return 1.0
    origin, axes = _plane(centers)
    flat = ((centers - origin) @ axes)[:, :2] / (1.5 * side)
    pixels = np.unique(np.floor(flat).astype(int), axis=0)
    corners = np.concatenate([pixels + np.array(corner) for corner in ((0, 0), (0, 1), (1, 0), (1, 1))])
    return float(len(pixels) / spatial.ConvexHull(corners).volume)


def split_in_two(
    frames: Sequence[Sample], centers: Float[np.ndarray, "cells 3"], links: sparse.csr_matrix
) -> Bool[np.ndarray, " cells"] | None:
    """The cells of the second of two sheets, if two follow the points `TORN` times better than one; else None."""
    together = roughness([points for points, _ in frames])
    origin, axes = _plane(centers)
    starts = _starts(((centers - origin) @ axes)[:, :2])
    rated = sorted((_rated(frames, start), place) for place, start in enumerate(starts))
    neighbours = (links > 0).astype(float)
    neighbours.setdiag(1.0)
    promising = [starts[place] for rate, place in rated[:TRIED] if rate < together / PROMISING]
    settled = [second for start in promising if (second := _compete(frames, start, neighbours)) is not None]
    best = min(settled, key=lambda second: _rated(frames, second), default=None)
    return best if best is not None and together > TORN * _rated(frames, best) else None


def _starts(across: np.ndarray) -> list[np.ndarray]:
    """Halves (leaves side by side or in a row) and opposite quarters (leaves that cross)."""
    angle = np.arctan2(across[:, 1], across[:, 0])
    halves = [np.cos(angle - turn) > 0 for turn in np.radians([0, 90, 45, 135])]
    return halves + [np.cos(2 * (angle - turn)) > 0 for turn in np.radians([0, 30, 60])]


def _compete(frames: Sequence[Sample], second: np.ndarray, neighbours: sparse.csr_matrix) -> np.ndarray | None:
    """The parts after every cell went to the sheet that its points are nearer to, again and again."""
    for _ in range(ROUNDS):
        costs = np.stack([_costs(frames, second == part, len(second)) for part in (False, True)])
        if not np.isfinite(costs).all():
            return None
        advantage = neighbours @ (costs[1] - costs[0])
        before, second = second, advantage < 0
        if not SMALLEST_PART < second.mean() < 1 - SMALLEST_PART:
            return None
        if (before == second).all():
            break
    return second


def _costs(frames: Sequence[Sample], mine: np.ndarray, cells: int) -> np.ndarray:
    """Sum over all frames of how far each cell's points lie from the sheet through the points of `mine`."""
    own = [points[mine[numbers]] for points, numbers in frames]
    if sum(map(len, own)) < FEWEST_POINTS * len(own):
        return np.full(cells, np.inf)
    frame = _plane(np.concatenate(own))
    total = np.zeros(cells)
    for part, (points, numbers) in zip(own, frames, strict=True):
        if len(part) >= FEWEST_POINTS:
            distances = np.abs(_heights(part, points, frame, SPLIT_DEGREE))
            total += np.bincount(numbers, np.minimum(distances, np.median(distances) * 6 + 1e-12), minlength=cells)
    return total


def _rated(frames: Sequence[Sample], second: np.ndarray) -> float:
    parts = [[points[second[numbers] == part] for points, numbers in frames] for part in (False, True)]
    weights = [max(1, sum(map(len, part))) for part in parts]
    return float(np.average([min(roughness(part), 1e9) for part in parts], weights=weights))


def _plane(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Centre and axes (columns), longest first."""
    center = points.mean(axis=0)
    _, vectors = np.linalg.eigh(np.cov(points - center, rowvar=False))
    return center, vectors[:, ::-1]


def _heights(fitted: np.ndarray, asked: np.ndarray, frame: tuple[np.ndarray, np.ndarray], degree: int) -> np.ndarray:
    """Heights of `asked` over the sheet through `fitted`, by least absolute deviations."""
    origin, axes = frame
    local = (fitted - origin) @ axes
    middle, half = (local.max(axis=0) + local.min(axis=0)) / 2, np.maximum(np.ptp(local, axis=0) / 2, 1e-12)
    design = _terms((local - middle) / half, degree)
    weights = np.ones(len(local))
    for _ in range(REWEIGHTINGS):
        weighted = design * weights[:, None]
        normal = weighted.T @ design
        ridge = 1e-9 * np.trace(normal) / len(normal) * np.eye(len(normal))
        coefficients = linalg.solve(normal + ridge, weighted.T @ local[:, 2], assume_a="pos", check_finite=False)
        residuals = np.abs(local[:, 2] - design @ coefficients)
        weights = 1.0 / np.maximum(residuals, 0.1 * np.median(residuals) + 1e-12)
        weights /= weights.max()
    there = (asked - origin) @ axes
    return np.asarray(there[:, 2] - _terms(np.clip((there - middle) / half, -1.5, 1.5), degree) @ coefficients)


def _terms(unit: np.ndarray, degree: int) -> np.ndarray:
    """Products of Legendre polynomials up to a total degree."""
    along, across = (special.eval_legendre(np.arange(degree + 1), unit[:, axis, None]) for axis in (0, 1))
    places = [(i, j) for i in range(degree + 1) for j in range(degree + 1 - i)]
    return np.stack([along[:, i] * across[:, j] for i, j in places], axis=1)
