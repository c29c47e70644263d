"""The search for one more line in a long record: its spectrum, and those under decays of T/2, T/4 … seconds.

An undamped line is sharp, 1 / T wide, and a damped one lives in the first seconds only. A spectrum under the line's
own decay is its matched filter; Fourier transforms of shorter and shorter beginnings are as cheap as a few of the
whole, where a grid of damped lines (`lines`) would need frames x candidates. The frame-shuffle test is the same.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Float32, Int
from scipy import fft

SHORTEST_S = 0.25
LIVES = 4.0
"""A decay is followed for so many times its time constant."""
SHUFFLES = 600
OBVIOUS = 2.0
"""Times the best of the first shuffles: such a line needs no more of them."""
FIRST_SHUFFLES = 40
LARGEST_START = 0.1


@dataclass(frozen=True, slots=True, kw_only=True)
class Windows:
    """Which samples of an even grid the frames are, and where lines are looked for (Hz)."""

    samples: Int[np.ndarray, " frames"]
    frame_rate: float
    low: float
    high: float
    left_out: tuple[tuple[float, float], ...] = ()

    def without(self, frequency: float, width: float) -> "Windows":
        """The search less the lines within `width` (Hz) of a frequency."""
        return replace(self, left_out=(*self.left_out, (frequency - width, frequency + width)))

    def find(
        self, white: Float[np.ndarray, "frames channels"], freedom: float, rng: np.random.Generator
    ) -> Float[np.ndarray, " 2"] | None:
        """The line (Hz, damping ratio) that explains most of a whitened residual, None if shuffled frames do as well.

        `white` has orthonormal columns; `freedom` is the share of the energy that a model has not taken yet.
        """
        observed, line = self._best(white)
        for done in range(SHUFFLES):
            strongest = self._best(white[rng.permutation(len(white))])[0] / freedom
            if strongest >= observed:
                return None
            if done >= FIRST_SHUFFLES and OBVIOUS * strongest <= observed:
                break
        return line

    def _best(self, white: np.ndarray) -> tuple[float, np.ndarray]:
        """The largest share of energy in one decaying sinusoid, and that line."""
        best, line = -1.0, np.zeros(2)
        for decay, frequencies, shares in self._spectra(white.astype(np.float32)):
            top = int(np.argmax(shares))
            if shares[top] > best:
                ratio = decay / (2 * np.pi * frequencies[top])
                best, line = float(shares[top]), np.array([frequencies[top], min(ratio, LARGEST_START)])
        return best, line

    def _spectra(
        self, white: Float32[np.ndarray, "frames channels"]
    ) -> Iterator[tuple[float, Float[np.ndarray, " lines"], Float32[np.ndarray, " lines"]]]:
        """Decay (1/s), frequencies and shares of energy of every window."""
        whole = int(self.samples[-1]) + 1
        even = np.zeros((white.shape[1], whole), dtype=np.float32)
        even[:, self.samples] = white.T
        for decay in self._decays(whole):
            length = min(whole, int(LIVES * self.frame_rate / decay)) if decay else whole
            taper = np.exp(-decay / self.frame_rate * np.arange(length, dtype=np.float32))
            padded = fft.next_fast_len(2 * length, real=True)
            spectrum = fft.rfft(even[:, :length] * taper, n=padded, axis=1)
            size = (taper[self.samples[: np.searchsorted(self.samples, length)]] ** 2).sum()
            shares = (spectrum.real**2 + spectrum.imag**2).sum(axis=0) * (2.0 / max(size, 1e-30))
            frequencies = np.arange(len(shares)) * self.frame_rate / padded
            yield decay, frequencies, np.where(self._allowed(frequencies), shares, 0.0)

    def _decays(self, whole: int) -> list[float]:
        """No decay, then time constants of half the record, a quarter …"""
        longest = whole / self.frame_rate / 2
        count = 1 + int(np.log2(longest / SHORTEST_S))
        return [0.0, *(2.0**halving / longest for halving in range(count))]

    def _allowed(self, frequencies: np.ndarray) -> np.ndarray:
        inside = (frequencies >= self.low) & (frequencies <= self.high)
        for low, high in self.left_out:
            inside &= (frequencies < low) | (frequencies > high)
        return np.asarray(inside)


def windows_of(times: Float[np.ndarray, " frames"], frame_rate: float, low: float, high: float) -> Windows:
    """The search in a record with these instants; each frame goes to the nearest sample."""
    return Windows(
        samples=np.round((times - times[0]) * frame_rate).astype(int), frame_rate=frame_rate, low=low, high=high
    )
