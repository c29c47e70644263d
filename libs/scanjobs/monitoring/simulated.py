"""A plant in a greenhouse, simulated: what its scans would find over weeks. For the demonstration and the benchmark.

ln(f/f0) of a mode is the sum of what temperature, growth and drying do to it and of scatter from scan to scan. Sizes
are those of potted plants: -0.1 % per kelvin, some percent of drying in days (turgor and mass work against one
another, so leaves fall and stems rise), 0.4 % of scatter, one scan in fifty an outlier of four times that, one mode in
thirty not found.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

DAY_S: Final = 24 * 3600.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Kind:
    """What sort of modes a plant has: frequencies Hz, damping ratios, and what drying to the full does to ln f."""

    organs: tuple[str, ...] = ("leaf_0", "leaf_0", "trunk")
    frequencies: tuple[float, ...] = (2.2, 4.9, 1.1)
    damping_ratios: tuple[float, ...] = (0.012, 0.018, 0.009)
    drying: tuple[float, ...] = (-0.08, -0.08, 0.02)


@dataclass(frozen=True, slots=True, kw_only=True)
class Nature:
    """How modes scatter and what else moves them; relative, per unit."""

    scatter: float = 0.004
    common: float = 0.5
    """Share of the scatter's variance that all modes of a scan have in common."""
    outliers: float = 0.02
    missed: float = 0.03
    per_kelvin: float = -0.001
    growth_per_day: float = 0.0
    std: float = 0.003
    """What the identification says of its own uncertainty, relative."""


@dataclass(frozen=True, slots=True)
class Life:
    """A plant's scans: `at` s, surroundings (scans,), and `frequencies` (scans, modes) Hz, NaN where not found."""

    at: np.ndarray
    temperature_c: np.ndarray
    soil_water_percent: np.ndarray
    mass_g: np.ndarray
    frequencies: np.ndarray
    stds: np.ndarray
    damping_ratios: np.ndarray


def temperature(at: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Degrees Celsius of a greenhouse: warmest at three in the afternoon UTC, some days warmer than others."""
    day = at / DAY_S
    phase = 2.0 * np.pi * (day - 15.0 / 24.0)
    slow = np.interp(day, *_daily_walk(day, rng))
    return 23.0 + 4.0 * np.cos(phase) + slow + rng.normal(0.0, 0.3, len(at))


def soil_water(at: np.ndarray, dry_from: float | None, again_from: float | None = None) -> np.ndarray:
    """Percent by volume: watered every second day; from `dry_from` on it falls, until `again_from`."""
    watered = 32.0 - 3.0 * np.mod(at / DAY_S, 2.0)
    if dry_from is None:
        return watered
    days = np.maximum(at - dry_from, 0.0) / DAY_S
    dry = 6.0 + (watered - 6.0) * np.exp(-days / 3.0)
    return np.where((again_from is not None) & (at >= (again_from or np.inf)), watered, dry)


def live(
    at: np.ndarray,
    temperature_c: np.ndarray,
    dryness: np.ndarray,
    *,
    rng: np.random.Generator,
    kind: Kind | None = None,
    nature: Nature | None = None,
) -> Life:
    """A plant's life: `dryness` (scans,) is 0 for watered and 1 for dried out; temperatures are those at the scans."""
    kind, nature = kind or Kind(), nature or Nature()
    modes = len(kind.frequencies)
    own = np.exp(rng.normal(0.0, 0.06, modes))
    slopes = nature.per_kelvin * np.exp(rng.normal(0.0, 0.25, modes))
    days = (at - at[0]) / DAY_S
    moved = (
        np.outer(temperature_c - 23.0, slopes)
        + np.outer(days, np.full(modes, nature.growth_per_day))
        + np.outer(dryness, kind.drying)
    )
    together = rng.normal(0.0, nature.scatter * np.sqrt(nature.common), (len(at), 1))
    alone = rng.normal(0.0, nature.scatter * np.sqrt(1.0 - nature.common), (len(at), modes))
    wild = rng.random(len(at)) < nature.outliers
    alone[wild] += rng.normal(0.0, 4.0 * nature.scatter, (int(wild.sum()), modes))
    frequencies = np.array(kind.frequencies) * own * np.exp(moved + together + alone)
    frequencies[rng.random(frequencies.shape) < nature.missed] = np.nan
    damping = np.array(kind.damping_ratios) * np.exp(rng.normal(0.0, 0.08, frequencies.shape) + 0.5 * dryness[:, None])
    mass = rng.uniform(700.0, 900.0) - 160.0 * dryness + 1.5 * days + rng.normal(0.0, 1.0, len(at))
    stds = frequencies * nature.std * np.exp(rng.normal(0.0, 0.2, frequencies.shape))
    return Life(at, temperature_c, 32.0 - 26.0 * dryness, mass, frequencies, stds, damping)


def _daily_walk(days: np.ndarray, rng: np.random.Generator) -> tuple[Sequence[float], np.ndarray]:
    whole = np.arange(np.floor(days.min()), np.ceil(days.max()) + 2.0)
    return whole.tolist(), rng.normal(0.0, 1.5, len(whole))
