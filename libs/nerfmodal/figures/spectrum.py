"""Power spectral density for pictures: a direct Fourier sum, so that missing frames are left out, not filled in.

One-sided, in unit²/Hz; no taper (a taper erases the early part of a decay). Records longer than `LONGEST_SEGMENT`
frames are cut into equal segments whose densities are averaged (Bartlett, Biometrika 37, 1950).
"""

import numpy as np
from jaxtyping import Float

LONGEST_SEGMENT = 1024
ZERO_PADDING = 4
"""Frequencies a Fourier bin is divided into, so that a peak between bins is seen at its place …"""
SHORT = 512
"""… in records of at most so many frames; in longer ones bins are narrow, and the lobes between them would be ink."""


def power_spectral_density(
    times: Float[np.ndarray, " frames"], values: Float[np.ndarray, " frames"], frame_rate: float
) -> tuple[Float[np.ndarray, " bins"], Float[np.ndarray, " bins"]]:
    """Frequencies in Hz (0 to the Nyquist frequency) and density in unit²/Hz; frames that are NaN are left out."""
    seen = np.isfinite(values)
    segments = max(1, int(np.ceil(seen.sum() / LONGEST_SEGMENT)))
    longest = int(np.ceil(seen.sum() / segments))
    padding = ZERO_PADDING if seen.sum() <= SHORT else 1
    frequencies = np.linspace(0, frame_rate / 2, padding * max(longest, 2) // 2 + 1)
    centred = values[seen] - values[seen].mean()
    pieces = zip(np.array_split(times[seen], segments), np.array_split(centred, segments), strict=True)
    densities = [_direct(frequencies, at, piece, frame_rate) for at, piece in pieces if piece.size]
    return frequencies, np.mean(densities, axis=0)


def _direct(
    frequencies: Float[np.ndarray, " bins"],
    times: Float[np.ndarray, " frames"],
    values: Float[np.ndarray, " frames"],
    frame_rate: float,
) -> Float[np.ndarray, " bins"]:
    turns = np.exp(-2j * np.pi * np.outer(frequencies, times - times[0]))
    return 2 * np.abs(turns @ values) ** 2 / (frame_rate * values.size)
