"""Modal coordinates q(t) of the oscillator q'' + 2 zeta w q' + w² q = p(t), in closed form at any instant.

Nothing is stepped: a decay, a harmonic, a half-sine push and a wind that is a sum of many sinusoids (Shinozuka and
Deodatis, Applied Mechanics Reviews 44, 1991) all have exact responses, so that a shutter may open between frames.
"""

import zlib
from typing import assert_never

import numpy as np
from jaxtyping import Complex, Float

from nerfmodal.spec import AirPulse, Excitation, FreeDecay, Harmonic, ImposedMode, SimulationSource, Wind

LINES_PER_BIN = 2.0
"""Sinusoids of the wind in every 1/T Hz: fewer, and it would repeat itself within the record."""
FEWEST_LINES = 512
FRESH = 256
"""Steps after which turning weights are computed anew, so that their rounding does not add up."""
LEAST_DAMPING = 1e-9
"""Keeps the response defined where an undamped mode is pushed at its own frequency."""
PEAK_OF_WIND = 4.0
"""Standard deviations that a random motion hardly ever leaves."""


def modal_coordinate(
    mode: ImposedMode,
    times: Float[np.ndarray, " times"],
    excitation: Excitation | None = None,
    *,
    organ: str = "",
    duration: float = 1.0,
) -> Float[np.ndarray, " times"]:
    """Coordinate of the mode, metres; a free decay from t = 0 without an `excitation`.

    `organ` and the mode decide which wind of its seed it meets, `duration` (s) how finely the wind is drawn.
    """
    match excitation:
        case None | FreeDecay():
            return _decay(mode, times)
        case Harmonic():
            return _harmonic(mode, times, excitation)
        case Wind():
            return _wind(mode, times, excitation, _generator(excitation.seed, organ, mode), duration)
        case AirPulse():
            return _pulse(mode, times, excitation)
        case _:
            assert_never(excitation)


def coordinate_of(
    source: SimulationSource, organ: str, mode: ImposedMode, times: Float[np.ndarray, " times"]
) -> Float[np.ndarray, " times"]:
    """Coordinate of one of the source's modes on one organ, metres."""
    return modal_coordinate(mode, times, _bounded(source), organ=organ, duration=source.frames / source.frame_rate_hz)


def largest_swing(mode: ImposedMode, excitation: Excitation) -> float:
    """How far (m) the mode's largest point goes, hardly ever exceeded by a wind."""
    return mode.amplitude_m * (PEAK_OF_WIND if isinstance(excitation, Wind) else 1.0)


def response(mode: ImposedMode, frequencies: Float[np.ndarray, " lines"]) -> Complex[np.ndarray, " lines"]:
    """Response to a force of unit amplitude at `frequencies` (Hz), s² : 1 / (w_n² - w² + 2 i zeta w_n w)."""
    w, own = 2 * np.pi * frequencies, 2 * np.pi * mode.frequency_hz
    return np.asarray(1.0 / (own**2 - w**2 + 2j * mode.damping_ratio * own * w))


def wind_spectrum(
    mode: ImposedMode, wind: Wind, frequencies: Float[np.ndarray, " lines"]
) -> Float[np.ndarray, " lines"]:
    """One-sided power spectral density of the mode's coordinate in the wind, m²/Hz.

    A white wind would give the variance `amplitude_m`²: S ∫|H|² df = S / (8 zeta w_n³) (Crandall and Mark, 1963).
    """
    own = 2 * np.pi * mode.frequency_hz
    force = mode.amplitude_m**2 * 8 * mode.damping_ratio * own**3
    blown = (frequencies >= wind.low_hz) & (frequencies <= (wind.high_hz or np.inf))
    return np.asarray(blown * force * np.abs(response(mode, frequencies)) ** 2)


def _decay(mode: ImposedMode, times: Float[np.ndarray, " times"]) -> Float[np.ndarray, " times"]:
    w, zeta = 2 * np.pi * mode.frequency_hz, mode.damping_ratio
    phase = np.radians(mode.phase_deg)
    return mode.amplitude_m * np.exp(-zeta * w * times) * np.cos(w * np.sqrt(1 - zeta**2) * times + phase)


def _harmonic(mode: ImposedMode, times: Float[np.ndarray, " times"], force: Harmonic) -> Float[np.ndarray, " times"]:
    phase = np.radians(mode.phase_deg)
    if force.frequency_hz is None:
        return mode.amplitude_m * np.cos(2 * np.pi * mode.frequency_hz * times + phase)
    driven, own = response(mode, np.array([force.frequency_hz, mode.frequency_hz]))
    turning = np.exp(1j * (2 * np.pi * force.frequency_hz * times + phase))
    return np.asarray((mode.amplitude_m * driven / np.abs(own) * turning).real)


def _wind(
    mode: ImposedMode, times: Float[np.ndarray, " times"], wind: Wind, random: np.random.Generator, duration: float
) -> Float[np.ndarray, " times"]:
    """Independent Gaussian sinusoids, one at a random place in every slice of the band: unbiased for any slice."""
    assert wind.high_hz is not None
    count = max(FEWEST_LINES, int(np.ceil(LINES_PER_BIN * duration * (wind.high_hz - wind.low_hz))))
    slice_ = (wind.high_hz - wind.low_hz) / count
    lines = wind.low_hz + slice_ * (np.arange(count) + random.uniform(size=count))
    sizes = np.sqrt(wind_spectrum(mode, wind, lines) * slice_)
    weights = sizes * (random.normal(size=count) - 1j * random.normal(size=count))
    return _sum_of_lines(weights, 2 * np.pi * lines, times)


def _sum_of_lines(
    weights: Complex[np.ndarray, " lines"], angles: Float[np.ndarray, " lines"], times: Float[np.ndarray, " times"]
) -> Float[np.ndarray, " times"]:
    """The real part of a sum of turning weights; between equal steps they are turned on, not computed anew."""
    steps = np.diff(times)
    even = len(steps) > 1 and np.allclose(steps, steps[0], rtol=1e-9, atol=0.0)
    onward = np.exp(1j * angles * steps[0]) if even else None
    values, turning = np.empty(len(times)), weights
    for index, time in enumerate(times):
        turning = turning * onward if onward is not None and index % FRESH else weights * np.exp(1j * angles * time)
        values[index] = turning.sum().real
    return values


def _pulse(mode: ImposedMode, times: Float[np.ndarray, " times"], push: AirPulse) -> Float[np.ndarray, " times"]:
    """A push F sin(pi t / d) is a sine from t = 0 on and another from t = d on, which ends it.

    Its momentum 2 d F / pi is that of a blow that starts a decay of `amplitude_m`: A w_d.
    """
    left = times - push.at_s
    return _begun_sine(mode, left, push.duration_s) + _begun_sine(mode, left - push.duration_s, push.duration_s)


def _begun_sine(
    mode: ImposedMode, times: Float[np.ndarray, " times"], half_period: float
) -> Float[np.ndarray, " times"]:
    """Response from rest to a sine that begins at t = 0: its steady motion, and the decay that starts both at rest."""
    w, zeta, beat = 2 * np.pi * mode.frequency_hz, max(mode.damping_ratio, LEAST_DAMPING), np.pi / half_period
    damped = w * np.sqrt(1 - zeta**2)
    force = mode.amplitude_m * damped * np.pi / (2 * half_period)
    steady = force / (w**2 - beat**2 + 2j * zeta * w * beat)
    place, speed = -steady.imag, -beat * steady.real
    begun = np.maximum(times, 0.0)
    decay = place * np.cos(damped * begun) + (speed + zeta * w * place) / damped * np.sin(damped * begun)
    return np.asarray(
        np.where(times > 0, np.exp(-zeta * w * begun) * decay + (steady * np.exp(1j * beat * begun)).imag, 0)
    )


def _bounded(source: SimulationSource) -> Excitation:
    """The excitation, with a wind's upper limit filled in."""
    force = source.excitation
    if isinstance(force, Wind) and force.high_hz is None:
        return force.model_copy(update={"high_hz": source.frame_rate_hz / 2})
    return force


def _generator(seed: int, organ: str, mode: ImposedMode) -> np.random.Generator:
    """Every organ and mode meets gusts of its own."""
    return np.random.default_rng(
        [seed, zlib.crc32(f"{organ} {mode.shape} {mode.frequency_hz!r} {mode.direction}".encode())]
    )
