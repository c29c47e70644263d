"""How well a mode will be read: the bound of the record times what the estimator loses against it.

Free decay and steady motion: 1.15 times the Cramér-Rao bound (measured, docs/benchmarks.md). Wind: Au's law, and for
records of few periods what was measured at 3 s. Bounds are for one mode alone: two lines closer than a Fourier bin
are read worse, and preflight says so.
"""

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from jaxtyping import Float

from nerfmodal.bounds import ambient_deviations, cramer_rao
from nerfmodal.preflight.answer import Chance, Excitation, ModeForecast, RecordLimits
from nerfmodal.preflight.expected import ExpectedMode

OVER_THE_BOUND = 1.15
"""Error of the whitened joint fit over the bound (docs/benchmarks.md, identification: worst of three modes)."""
LIKELY, UNCERTAIN = 14.0, 7.0
"""Strengths between which a mode is found in some records only: 72 to 88 % were found at strengths of about 11."""
SHOWN_TO_NOISE = 10.0
SHOWN_DAMPING = 0.01
SHOWN = 5
"""Lines that show what a record can do, where nobody said what is expected."""
MOST_INSTANTS = 4096
"""Longer records are thinned for the sum: the bound changes with the number of frames by its root alone."""
STEEPEST = 0.99
LEAST_PERIODS = 0.1
MOST_TO_NOISE = 1e9


def forecast(mode: ExpectedMode, record: RecordLimits, excitation: Excitation, noise: float | None) -> ModeForecast:
    """What to expect of one mode. Without a known noise the amplitude is taken for ten times it."""
    ratio = SHOWN_TO_NOISE if noise is None else min(mode.amplitude / max(noise, 1e-12), MOST_TO_NOISE)
    damping = 0.0 if excitation == "harmonic" else min(mode.damping_ratio, STEEPEST)
    frequency_std, damping_std = _deviations(mode.frequency, damping, record, excitation, ratio)
    times, worth = instants(record)
    lasting = 1.0 if excitation == "ambient" else _root_energy(times, mode.frequency, damping) / math.sqrt(len(times))
    strength = ratio * worth * math.sqrt(len(times)) * lasting
    return ModeForecast(
        organ=mode.organ,
        shape=mode.shape,
        frequency_hz=mode.frequency,
        damping_ratio=mode.damping_ratio,
        amplitude_m=None if noise is None else mode.amplitude,
        amplitude_to_noise=ratio,
        periods=mode.frequency * record.duration_s,
        frequency_std_hz=frequency_std,
        damping_std=None if excitation == "harmonic" else damping_std,
        strength=strength,
        found="unknown" if noise is None else chance_of(strength),
    )


def _deviations(
    frequency: float, damping: float, record: RecordLimits, excitation: Excitation, ratio: float
) -> tuple[float | None, float | None]:
    """Of frequency (Hz) and damping ratio; None where the record holds next to nothing of a period."""
    if frequency * record.duration_s < LEAST_PERIODS or frequency > record.frame_rate_hz:
        return None, None
    if excitation == "ambient":
        return ambient_deviations(frequency, damping, record.duration_s)
    times, worth = instants(record)
    bound = cramer_rao(times, frequency, damping, max(ratio * worth, 1e-12))
    if not all(map(math.isfinite, bound)):
        return None, None
    return OVER_THE_BOUND * bound[0], OVER_THE_BOUND * bound[1]


def what_it_resolves(record: RecordLimits, excitation: Excitation) -> tuple[ModeForecast, ...]:
    """Five lines over the record's band, each ten times its noise and damped by 1 %."""
    if record.highest_hz <= record.lowest_hz:
        return ()
    frequencies = np.geomspace(record.lowest_hz, record.highest_hz, SHOWN)
    lines = (ExpectedMode(frequency=float(f), damping_ratio=SHOWN_DAMPING, amplitude=0.0) for f in frequencies)
    return tuple(forecast(line, record, excitation, None) for line in lines)


def chance_of(strength: float) -> Chance:
    """Whether a mode of this strength is found."""
    return "likely" if strength >= LIKELY else "uncertain" if strength >= UNCERTAIN else "unlikely"


def instants(record: RecordLimits) -> tuple[Float[np.ndarray, " frames"], float]:
    """Instants of the frames, at most `MOST_INSTANTS`, and the root of how many frames each stands for."""
    kept = min(record.frames, MOST_INSTANTS)
    times = np.arange(record.frames) / record.frame_rate_hz
    if kept < record.frames:
        rng = np.random.default_rng(0)  # an even choice of every n-th frame would alias
        times = np.sort(rng.choice(times, kept, replace=False))
    return times, math.sqrt(record.frames / kept)


def closest(modes: Sequence[ExpectedMode]) -> list[tuple[int, int, float]]:
    """Pairs of modes of one organ that follow one another in frequency, and their distance in Hz."""
    pairs = []
    for organ in dict.fromkeys(mode.organ for mode in modes):
        mine = sorted((mode.frequency, index) for index, mode in enumerate(modes) if mode.organ == organ)
        pairs += [(a, b, high - low) for (low, a), (high, b) in pairwise(mine)]
    return pairs


def _root_energy(times: Float[np.ndarray, " frames"], frequency: float, damping: float) -> float:
    decay = np.exp(-2 * damping * 2 * np.pi * frequency * times)
    return float(np.sqrt(0.5 * decay.sum()))
