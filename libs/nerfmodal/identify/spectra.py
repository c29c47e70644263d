"""Power spectral densities of scores and modal coordinates, and the frequency of a spectral line."""

import numpy as np
from jaxtyping import Float

PADDING = 16
"""Zero padding of a line's search: the peak of a short record lies between its FFT bins."""


def bridge_gaps(series: Float[np.ndarray, "frames channels"]) -> Float[np.ndarray, "frames channels"]:
    """NaN frames replaced by straight lines between their neighbours, for methods that need even sampling."""
    seen = np.isfinite(series).all(axis=1)
    if seen.all() or not seen.any():
        return np.where(seen[:, None], series, 0.0)
    places = np.arange(len(series))
    return np.stack([np.interp(places, places[seen], channel[seen]) for channel in series.T], axis=1)


def resample_evenly(
    times: Float[np.ndarray, " frames"], series: Float[np.ndarray, "frames channels"], frame_rate: float
) -> Float[np.ndarray, "samples channels"]:
    """The series on an even grid of `frame_rate` over the same time, straight lines between samples; NaN bridged."""
    seen = np.isfinite(series).all(axis=1)
    count = round((times[-1] - times[0]) * frame_rate) + 1
    grid = times[0] + np.arange(count) / frame_rate
    return np.stack([np.interp(grid, times[seen], channel[seen]) for channel in series.T], axis=1)


def power_spectral_density(
    series: Float[np.ndarray, "frames channels"], frame_rate: float
) -> tuple[Float[np.ndarray, " lines"], Float[np.ndarray, "lines channels"]]:
    """Frequencies in Hz and the one-sided periodogram in unit²/Hz, rectangular window, mean removed.

    Its integral over frequency is the variance (Parseval).
    """
    whole = bridge_gaps(series)
    whole = whole - whole.mean(axis=0)
    spectrum = np.abs(np.fft.rfft(whole, axis=0)) ** 2 / (len(whole) * frame_rate)
    inner = slice(1, -1 if len(whole) % 2 == 0 else None)
    spectrum[inner] *= 2.0
    return np.fft.rfftfreq(len(whole), 1.0 / frame_rate), spectrum


def peak_frequency(series: Float[np.ndarray, " frames"], frame_rate: float) -> float:
    """Frequency of the highest line in Hz: zero-padded periodogram, then a parabola through its top.

    The first 0.5 / record length is left out: it is the mean and drift.
    """
    count = PADDING * len(series)
    spectrum = np.abs(np.fft.rfft(series - series.mean(), n=count)) ** 2
    lowest = PADDING // 2
    top = lowest + int(np.argmax(spectrum[lowest:]))
    shift = 0.0
    if 0 < top < len(spectrum) - 1:
        left, middle, right = np.log(spectrum[top - 1 : top + 2] + 1e-300)
        curvature = left - 2 * middle + right
        shift = 0.5 * (left - right) / curvature if curvature < 0 else 0.0
    return float((top + shift) * frame_rate / count)
