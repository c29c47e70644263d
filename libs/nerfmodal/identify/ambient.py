"""Ambient records through pyOMA_2: stochastic subspace (SSI-cov) and frequency-domain decomposition of the scores.

pyOMA_2 computes the poles of every order and their singular-value spectrum; which poles are modes is decided by our
clustering, and their frequency and damping are refined in the spectrum (`whittle`). It drops poles with no damping or
more than 20 %, and shapes whose MPC is below 0.5. Without the extra `ambient` our own subspace method answers alone.
Sources: Peeters and De Roeck (1999); Brincker, Zhang and Andersen (2001); pyOMA_2 (Pasca et al.).
"""

import importlib.util
import logging
import os
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy import signal

from nerfmodal.identify.readings import Reading, Record, normalised
from nerfmodal.identify.shapes import coordinates_of, rotate_to_real
from nerfmodal.identify.subspace import (
    LOWEST_HZ,
    Pole,
    at_frames,
    block_rows,
    even_scores,
    mark_stable,
    read_poles,
    read_subspace,
)

ORDERS_PER_MODE = 4
SHORTEST_SEGMENT, LONGEST_SEGMENT = 64, 1024
SEGMENTS = 4
"""The record is cut into this many (with overlap), so that the spectral matrix is an average."""
PEAK_DB = 6.0
"""Of the first singular value over its surroundings: less is no peak."""


def is_installed() -> bool:
    """Whether pyOMA_2 is here."""
    return importlib.util.find_spec("pyoma2") is not None


def read_ambient(record: Record, count: int, *, max_modes: int) -> tuple[Reading, ...]:
    """The subspace method's reading of `count` leading scores, and that of the frequency domain if pyOMA_2 is here."""
    if not is_installed():
        return (read_subspace(record, count, max_modes=max_modes),)
    even, rate = even_scores(record, count), record.displacement.frame_rate
    poles = pyoma_poles(even, rate, max_modes=max_modes)
    subspace = read_poles(record, even, poles, max_modes=max_modes)
    return subspace, read_spectrum(record, even, max_modes=max_modes)


def pyoma_poles(
    series: Float[np.ndarray, "samples channels"], frame_rate: float, *, max_modes: int
) -> tuple[Pole, ...]:
    """The stabilisation diagram by pyOMA_2's SSI-cov: even orders up to 4 x `max_modes`."""
    setup = _setup(series, frame_rate)
    from pyoma2.algorithms import SSI

    highest = min(ORDERS_PER_MODE * max_modes, (block_rows(series) - 1) * series.shape[1])
    algorithm = SSI(name="ssi", method="cov", br=block_rows(series), ordmin=2, ordmax=highest, step=2)
    setup.add_algorithms(algorithm)
    setup.run_by_name("ssi")
    result = algorithm.result
    found = [
        Pole(
            order=2 + 2 * column,
            frequency=float(result.Fn_poles[row, column]),
            damping_ratio=float(result.Xi_poles[row, column]),
            shape=np.asarray(result.Phi_poles[row, column], dtype=complex),
        )
        for column in range(result.Fn_poles.shape[1])
        for row in np.flatnonzero(np.isfinite(result.Fn_poles[:, column]))
        if result.Fn_poles[row, column] >= LOWEST_HZ
    ]
    return mark_stable(found)


def read_spectrum(record: Record, even: Float[np.ndarray, "samples count"], *, max_modes: int) -> Reading:
    """Modes by pyOMA_2's frequency-domain decomposition: peaks of the first singular value of the spectral matrix.

    It gives no damping (NaN): the window of a segment is about as wide as a resonance.
    """
    displacement = record.displacement
    setup = _setup(even, displacement.frame_rate)
    from pyoma2.algorithms import FDD

    algorithm = FDD(name="fdd", nxseg=_segment(len(even)))
    setup.add_algorithms(algorithm)
    setup.run_by_name("fdd")
    result = algorithm.result
    level = 20 * np.log10(np.maximum(result.S_val[0, 0], 1e-300))  # S_val holds roots
    peaks = [peak for peak in signal.find_peaks(level, prominence=PEAK_DB)[0] if result.freq[peak] >= LOWEST_HZ]
    strongest = np.sort(sorted(peaks, key=lambda peak: -level[peak])[:max_modes]).astype(int)
    local, shapes, _ = normalised(record.axes, rotate_to_real(result.S_vec[0][:, strongest].conj()))
    coordinates = coordinates_of(even, local) if len(strongest) else np.zeros((len(even), 0))
    return Reading(
        method="frequency_domain",
        frequencies=np.array([_top(result.freq, level, int(peak)) for peak in strongest]),
        damping_ratios=np.full(len(strongest), np.nan),
        local=local,
        shapes=shapes,
        coordinates=at_frames(displacement, coordinates),
    )


def _segment(samples: int) -> int:
    """Length of a segment: a power of two, about a quarter of the record."""
    return min(2 ** int(np.log2(max(samples // SEGMENTS, SHORTEST_SEGMENT))), LONGEST_SEGMENT, samples)


def _top(lines: np.ndarray, level: np.ndarray, peak: int) -> float:
    """Frequency of a parabola's top through three values in decibels."""
    left, middle, right = level[peak - 1 : peak + 2]
    return float(lines[peak] + 0.5 * (left - right) / (left - 2 * middle + right) * (lines[1] - lines[0]))


def _setup(series: np.ndarray, frame_rate: float) -> Any:
    """pyOMA_2's record, without its progress bars and messages."""
    os.environ.setdefault("TQDM_DISABLE", "1")
    from pyoma2.setup import SingleSetup

    logging.getLogger("pyoma2").setLevel(logging.WARNING)
    return SingleSetup(series - series.mean(axis=0), fs=frame_rate)
