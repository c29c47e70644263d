"""Damped lines: their columns in a linear model, and the search for one more with a frame-shuffle test.

A line is (frequency f in Hz, damping ratio ζ); ω = 2πf, ω_d = ω √(1 - ζ²). Time counts from the first frame.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32

GRID_HZ = 0.08
GRID_DAMPING = (0.0, 0.02, 0.05, 0.10)
SHUFFLES = 600
"""With alpha = 0.002 a line is kept only if it beats every shuffle."""
BATCH = 10
OBVIOUS = 2.0
"""Times the best of the first batch of shuffles: such a line needs no more of them."""
SEEN_ALREADY = 1e-3
"""A candidate of which less than this share is new to the model is one of its lines again."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Grid:
    """Candidate lines (frequency Hz, damping ratio) with their unit cosine and sine at the frames' instants."""

    lines: Float[np.ndarray, "candidates 2"]
    columns: Float32[np.ndarray, "candidates 2 frames"]

    def without(self, frequency: float, width: float) -> "Grid":
        """The grid less the lines within `width` (Hz) of a frequency."""
        kept = np.abs(self.lines[:, 0] - frequency) > width
        return Grid(lines=self.lines[kept], columns=self.columns[kept])


def candidate_grid(times: Float[np.ndarray, " frames"], low: float, high: float) -> Grid:
    """Lines every 0.08 Hz from `low` to `high`, each with four damping ratios."""
    frequencies = np.arange(low, high + 1e-9, GRID_HZ)
    lines = np.array([(frequency, ratio) for frequency in frequencies for ratio in GRID_DAMPING]).reshape(-1, 2)
    elapsed = times - times[0]
    omega = 2 * np.pi * lines[:, :1]
    envelope = np.exp(-lines[:, 1:] * omega * elapsed)
    angle = omega * np.sqrt(1 - lines[:, 1:] ** 2) * elapsed
    columns = np.stack([envelope * np.cos(angle), envelope * np.sin(angle)], axis=1)
    unit = columns / np.linalg.norm(columns, axis=2, keepdims=True)
    return Grid(lines=lines, columns=unit.astype(np.float32))


def damped_columns(
    times: Float[np.ndarray, " frames"], lines: Float[np.ndarray, "modes 2"]
) -> Float[np.ndarray, "frames columns"]:
    """A constant, then a damped cosine and sine for every line."""
    elapsed = times - times[0]
    columns = np.empty((1 + 2 * len(lines), len(elapsed)))
    columns[0] = 1.0
    for place, (frequency, ratio) in enumerate(lines):
        columns[1 + 2 * place], columns[2 + 2 * place] = _pair(elapsed, frequency, ratio)
    return columns.T


def column_derivatives(
    times: Float[np.ndarray, " frames"], lines: Float[np.ndarray, "modes 2"], parameter: int
) -> list[Float[np.ndarray, "frames 2"]]:
    """Derivatives of each line's cosine and sine by its frequency (`parameter` 0, per Hz) or damping ratio (1)."""
    pairs = damped_columns(times, lines)[:, 1:]
    return [
        _slopes(times - times[0], pairs[:, 2 * place], pairs[:, 2 * place + 1], line)[parameter]
        for place, line in enumerate(lines)
    ]


def all_slopes(
    times: Float[np.ndarray, " frames"],
    columns: Float[np.ndarray, "frames columns"],
    lines: Float[np.ndarray, "modes 2"],
) -> Float[np.ndarray, "frames slopes"]:
    """`column_derivatives` of all lines side by side, by frequency and then by damping, from the columns themselves."""
    elapsed, modes = times - times[0], len(lines)
    slopes = np.empty((len(elapsed), 4 * modes), order="F")
    for place, line in enumerate(lines):
        both = _slopes(elapsed, columns[:, 1 + 2 * place], columns[:, 2 + 2 * place], line)
        slopes[:, 2 * place : 2 * place + 2], slopes[:, 2 * (modes + place) : 2 * (modes + place) + 2] = both
    return slopes


def find_line(
    times: Float[np.ndarray, " frames"],
    residuals: Float[np.ndarray, "frames channels"],
    known: Float[np.ndarray, "modes 2"],
    *,
    grid: Grid,
    rng: np.random.Generator,
) -> Float[np.ndarray, " 2"] | None:
    """The line that explains most of the residual, or None if shuffled frames hold one as strong.

    The statistic is Wilks' likelihood ratio -log det(I - H Hᵀ), H the whitened residual's share in the two columns of
    a candidate. Shuffling the frames keeps the channels' covariance and destroys every line.
    """
    model, _ = np.linalg.qr(damped_columns(times, known))
    lines, directions = _new_directions(grid, model)
    if not len(lines):
        return None
    white = whitened(residuals)
    observed = _likelihood_ratios(directions, white[None])[:, 0]
    best = int(np.argmax(observed))
    # a residual lies outside the model and its shuffles do not: they get the share back that the model took
    freedom = np.sqrt(len(times) / (len(times) - model.shape[1]))
    left = SHUFFLES
    while left > 0:
        count = min(BATCH, left)
        shuffled = np.stack([white[rng.permutation(len(white))] for _ in range(count)]) * freedom
        strongest = float(_likelihood_ratios(directions, shuffled).max())
        if strongest >= observed[best]:
            return None
        if OBVIOUS * strongest <= observed[best]:
            break
        left -= count
    return np.asarray(lines[best])


def _pair(elapsed: np.ndarray, frequency: float, ratio: float) -> tuple[np.ndarray, np.ndarray]:
    omega = 2 * np.pi * frequency
    envelope = np.exp(-ratio * omega * elapsed)
    angle = omega * np.sqrt(1 - ratio**2) * elapsed
    return envelope * np.cos(angle), envelope * np.sin(angle)


def _slopes(
    elapsed: np.ndarray, cosine: np.ndarray, sine: np.ndarray, line: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives of a line's cosine and sine by its frequency and by its damping ratio."""
    frequency, ratio = line
    root = np.sqrt(1 - ratio**2)
    by_frequency = (
        2 * np.pi * elapsed[:, None] * np.stack([-ratio * cosine - root * sine, root * cosine - ratio * sine], 1)
    )
    turn = 2 * np.pi * frequency * elapsed[:, None]
    slope = ratio / root
    return by_frequency, turn * np.stack([slope * sine - cosine, -sine - slope * cosine], 1)


def _new_directions(grid: Grid, model: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Grid lines and the orthonormal pair (candidates, 2, frames) that each adds to the model."""
    single = model.astype(np.float32)  # a test statistic needs no more, and long records are read in half the time
    columns = grid.columns - (grid.columns @ single) @ single.T
    first_size = np.linalg.norm(columns[:, 0], axis=1)
    first = columns[:, 0] / np.maximum(first_size, 1e-30)[:, None]
    second = columns[:, 1] - (columns[:, 1] * first).sum(axis=1)[:, None] * first
    second_size = np.linalg.norm(second, axis=1)
    new = (first_size > SEEN_ALREADY) & (second_size > SEEN_ALREADY)
    second = second / np.maximum(second_size, 1e-30)[:, None]
    return grid.lines[new], np.stack([first[new], second[new]], axis=1)


def whitened(residuals: Float[np.ndarray, "frames channels"]) -> Float[np.ndarray, "frames independent"]:
    """Orthonormal columns of the same span: what is rounding of another channel is left out."""
    left, singular, _ = np.linalg.svd(residuals, full_matrices=False)
    return np.asarray(left[:, singular > 1e-9 * singular[0]])


def _likelihood_ratios(directions: np.ndarray, white: np.ndarray) -> np.ndarray:
    """-log det(I - H Hᵀ) of every candidate (rows) in every (shuffled) record of `white` (columns)."""
    records, frames, channels = white.shape
    flat = white.transpose(1, 0, 2).reshape(frames, records * channels).astype(np.float32)
    shares = (directions.reshape(-1, frames) @ flat).reshape(-1, 2, records, channels)
    first, second = shares[:, 0], shares[:, 1]
    cross = np.einsum("qrc,qrc->qr", first, second)
    determinant = (1 - np.einsum("qrc,qrc->qr", first, first)) * (1 - np.einsum("qrc,qrc->qr", second, second))
    return -np.log(np.maximum(determinant - cross**2, 1e-12))
