"""Damping ratio of one modal coordinate by the logarithmic decrement.

The extrema of a free decay, one every half period, fall as exp(-zeta omega t): a straight line through the logarithm
of their sizes has slope -delta per period, and zeta = delta / sqrt(4 pi² + delta²).
"""

import numpy as np
from jaxtyping import Float

FEWEST_EXTREMA = 3


def logarithmic_decrement(series: Float[np.ndarray, " frames"], frequency: float, frame_rate: float) -> float:
    """Damping ratio (0-1, negative for a growing series) of a single decaying sinusoid.

    Parameters
    ----------
    series
        One modal coordinate, any unit, evenly sampled.
    frequency
        Its damped frequency in Hz, which spaces the extrema.
    frame_rate
        In Hz.

    Returns
    -------
    float
        The ratio, or NaN with fewer than three half periods in the record.
    """
    times, sizes = extrema(series, frequency, frame_rate)
    if len(times) < FEWEST_EXTREMA:
        return float("nan")
    slope = np.polyfit(times, np.log(sizes), 1)[0]
    delta = -slope / frequency
    return float(delta / np.sqrt(4 * np.pi**2 + delta**2))


def extrema(
    series: Float[np.ndarray, " frames"], frequency: float, frame_rate: float
) -> tuple[Float[np.ndarray, " peaks"], Float[np.ndarray, " peaks"]]:
    """Instants (s) and sizes of the largest deflection in every whole half period, a parabola through its top.

    A half period shorter than two samples is not resolved; whole periods are taken then.
    """
    size = np.abs(series - series.mean())
    window = frame_rate / (2 * frequency)
    window = window if window >= 2 else max(2.0, 2 * window)
    places, sizes = [], []
    for start in np.arange(0, len(size) - window + 1e-9, window):
        inside = np.arange(int(np.ceil(start)), min(int(np.ceil(start + window)), len(size)))
        highest = int(inside[np.argmax(size[inside])])
        if not _is_top(size, highest):
            continue
        place, top = _refined(size, highest)
        places.append(place / frame_rate)
        sizes.append(top)
    kept = np.array(sizes) > 0
    return np.array(places)[kept], np.array(sizes)[kept]


def _is_top(size: np.ndarray, place: int) -> bool:
    """Whether the series turns there; the edge of a half period, or of the record, need not be an extremum."""
    return bool(0 < place < len(size) - 1 and size[place] >= max(size[place - 1], size[place + 1]))


def _refined(size: np.ndarray, place: int) -> tuple[float, float]:
    left, middle, right = size[place - 1 : place + 2]
    curvature = left - 2 * middle + right
    if curvature >= 0:
        return float(place), float(middle)
    shift = 0.5 * (left - right) / curvature
    return place + shift, float(middle - 0.25 * (left - right) * shift)
