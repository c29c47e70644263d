"""Covariance-driven stochastic subspace identification: the estimator for ambient (wind) records.

The covariances R_1 … R_2i of the scores fill a block Toeplitz matrix; its factors hold the state matrix, whose
eigenvalues are the poles. Poles that stay as the order grows (frequency within 2 %, damping within 50 %, MAC above
0.95) are modes, the others are noise. Source: Van Overschee and De Moor (1996); Peeters and De Roeck (1999).
Uncertainty: `bounds.ambient_deviations`.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex, Float

from nerfmodal.identify.metrics import mac, mpc
from nerfmodal.identify.readings import Reading, Record, normalised
from nerfmodal.identify.shapes import coordinates_of, rotate_to_real
from nerfmodal.identify.spectra import resample_evenly
from nerfmodal.identify.whittle import SLOPES, refine_resonance
from nerfmodal.types import Diagram, DisplacementMatrix

LOWEST_HZ = 0.35
FEWEST_LAGS, MOST_LAGS = 8, 20
SHARE_OF_LAGS = 0.2
"""Block rows, as a share of the samples."""
SAME_FREQUENCY = 0.02
SAME_DAMPING = 0.5
SAME_SHAPE = 0.95
SPLIT_FREQUENCY, SPLIT_SHAPE = 0.05, 0.8
"""High orders split a mode into two poles this near to each other: the smaller group is none."""
HIGHEST_DAMPING = 0.2
LOWEST_MPC = 0.5
FEWEST_ORDERS = 0.35
"""Share of the orders in which a pole must be stable to be a mode."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Pole:
    """One pole at one order: undamped frequency in Hz, damping ratio, and its shape over the channels."""

    order: int
    frequency: float
    damping_ratio: float
    shape: Complex[np.ndarray, " channels"]
    stable: bool = False


def stabilise(series: Float[np.ndarray, "samples channels"], frame_rate: float, *, max_modes: int) -> tuple[Pole, ...]:
    """The stabilisation diagram: poles of even orders up to 4 × `max_modes`, marked if the order before has them."""
    blocks = block_rows(series)
    channels = series.shape[1]
    left, singular, _ = np.linalg.svd(_toeplitz(series - series.mean(axis=0), blocks), full_matrices=False)
    poles: list[Pole] = []
    for order in range(2, min(4 * max_modes, len(singular), (blocks - 1) * channels) + 1, 2):
        observability = left[:, :order] * np.sqrt(singular[:order])
        poles += _poles(observability, channels, order, frame_rate)
    return mark_stable(poles)


def block_rows(series: Float[np.ndarray, "samples channels"]) -> int:
    """Lags in the covariance matrix: a fifth of the samples, 8 to 20, never more than a quarter of them."""
    blocks = int(np.clip(SHARE_OF_LAGS * len(series), FEWEST_LAGS, MOST_LAGS))
    return max(2, min(blocks, len(series) // 4))


def mark_stable(poles: Sequence[Pole]) -> tuple[Pole, ...]:
    """The poles (by rising order), each marked if the order before has one alike."""
    orders = sorted({pole.order for pole in poles})
    groups = {order: [pole for pole in poles if pole.order == order] for order in orders}
    pairs = zip([[], *(groups[order] for order in orders)], (groups[order] for order in orders), strict=False)
    return tuple(_mark(pole, before) for before, now in pairs for pole in now)


def cluster(poles: tuple[Pole, ...]) -> list[list[Pole]]:
    """Stable poles that are one mode, those of the strongest first; a mode is stable in a good part of the orders."""
    left = [pole for pole in poles if pole.stable]
    orders = len({pole.order for pole in poles})
    clusters = []
    while left:
        groups = [[other for other in left if _alike(pole, other)] for pole in left]
        largest = max(groups, key=len)
        if len(largest) < max(2, FEWEST_ORDERS * orders):
            break
        clusters.append(largest)
        middle = _middle(largest)
        left = [pole for pole in left if not _near(pole, middle, SPLIT_FREQUENCY, SPLIT_SHAPE)]
    return sorted(clusters, key=lambda group: float(np.median([pole.frequency for pole in group])))


def read_subspace(record: Record, count: int, *, max_modes: int) -> Reading:
    """Modes by stochastic subspace identification of `count` leading scores, sorted by frequency."""
    even = even_scores(record, count)
    poles = stabilise(even, record.displacement.frame_rate, max_modes=max_modes)
    return read_poles(record, even, poles, max_modes=max_modes)


def even_scores(record: Record, count: int) -> Float[np.ndarray, "samples count"]:
    """The leading scores on an even grid of the frame rate, gaps bridged."""
    displacement = record.displacement
    return resample_evenly(displacement.times, record.axes.scores[:, :count], displacement.frame_rate)


def read_poles(
    record: Record, even: Float[np.ndarray, "samples count"], poles: tuple[Pole, ...], *, max_modes: int
) -> Reading:
    """Modes from a stabilisation diagram of the evenly sampled scores: clusters of poles, refined in the spectrum."""
    displacement, count = record.displacement, even.shape[1]
    groups = cluster(poles)[:max_modes]
    middles = np.array([_middle(group).shape for group in groups], dtype=complex).reshape(len(groups), count).T
    local, shapes, _ = normalised(record.axes, rotate_to_real(middles))
    coordinates = coordinates_of(even, local) if groups else np.zeros((len(even), 0))
    lines = _refined(groups, coordinates, displacement.frame_rate)
    return Reading(
        method="subspace",
        frequencies=lines[:, 0],
        damping_ratios=lines[:, 1],
        local=local,
        shapes=shapes,
        coordinates=at_frames(displacement, coordinates),
        diagram=diagram_of(poles),
    )


def diagram_of(poles: Sequence[Pole]) -> Diagram:
    """The poles as the arrays that a picture is drawn from."""
    return Diagram(
        orders=np.array([pole.order for pole in poles], dtype=int),
        frequencies=np.array([pole.frequency for pole in poles], dtype=float),
        damping_ratios=np.array([pole.damping_ratio for pole in poles], dtype=float),
        stable=np.array([pole.stable for pole in poles], dtype=bool),
    )


def at_frames(
    displacement: DisplacementMatrix, even: Float[np.ndarray, "samples modes"]
) -> Float[np.ndarray, "frames modes"]:
    """Evenly sampled series at the frames' own instants."""
    grid = displacement.times[0] + np.arange(len(even)) / displacement.frame_rate
    series = [np.interp(displacement.times, grid, each) for each in even.T]
    return np.array(series).reshape(even.shape[1], len(displacement.times)).T


def _refined(groups: list[list[Pole]], coordinates: np.ndarray, frame_rate: float) -> np.ndarray:
    """(frequency, damping ratio) of every mode: the group's median, then the most likely resonance near it.

    Whether the record is displacement, velocity or acceleration is one question to all modes together.
    """
    rough = [
        (
            float(np.median([pole.frequency for pole in group])),
            float(np.median([pole.damping_ratio for pole in group])),
        )
        for group in groups
    ]
    neighbours = [frequency for frequency, _ in rough]
    readings = []
    for slope in SLOPES:
        each = [
            refine_resonance(series, frame_rate, start, neighbours, slope)
            for series, start in zip(coordinates.T, rough, strict=True)
        ]
        readings.append((sum(unlikely for _, unlikely in each), [line for line, _ in each]))
    return np.array(min(readings, key=lambda reading: reading[0])[1]).reshape(len(groups), 2)


def _toeplitz(series: np.ndarray, blocks: int) -> np.ndarray:
    """Blocks R_(i+row-column), R_k the covariance at lag k."""
    lags = [series[lag:].T @ series[: len(series) - lag] / (len(series) - lag) for lag in range(2 * blocks)]
    return np.block([[lags[blocks + row - column] for column in range(1, blocks + 1)] for row in range(blocks)])


def _poles(observability: np.ndarray, channels: int, order: int, frame_rate: float) -> list[Pole]:
    state = np.linalg.lstsq(observability[:-channels], observability[channels:], rcond=None)[0]
    values, vectors = np.linalg.eig(state)
    shapes = observability[:channels] @ vectors
    found = []
    for value, shape in zip(values, shapes.T, strict=True):
        if value.imag <= 0 or abs(value) < 1e-6:
            continue
        rate = np.log(value) * frame_rate
        frequency, ratio = abs(rate) / (2 * np.pi), -rate.real / abs(rate)
        if frequency >= LOWEST_HZ and 0 < ratio <= HIGHEST_DAMPING and mpc(shape) >= LOWEST_MPC:
            found.append(Pole(order=order, frequency=float(frequency), damping_ratio=float(ratio), shape=shape))
    return found


def _mark(pole: Pole, before: list[Pole]) -> Pole:
    stable = any(_alike(pole, other) for other in before)
    return Pole(
        order=pole.order,
        frequency=pole.frequency,
        damping_ratio=pole.damping_ratio,
        shape=pole.shape,
        stable=stable,
    )


def _alike(first: Pole, second: Pole) -> bool:
    same_damping = abs(first.damping_ratio - second.damping_ratio) <= max(SAME_DAMPING * first.damping_ratio, 0.002)
    return same_damping and _near(first, second, SAME_FREQUENCY, SAME_SHAPE)


def _near(first: Pole, second: Pole, share: float, likeness: float) -> bool:
    within = abs(first.frequency - second.frequency) <= share * first.frequency
    return within and mac(first.shape, second.shape) >= likeness


def _middle(group: list[Pole]) -> Pole:
    """The pole of median frequency."""
    return sorted(group, key=lambda pole: pole.frequency)[len(group) // 2]
