"""Refinement of ambient modes in the frequency domain: Whittle's likelihood of one resonance in white noise.

The periodogram of a modal coordinate is exponentially distributed about S f^a |H(f)|² + E around its resonance; under
a white force a is 0 for displacement, 2 for velocity and 4 for acceleration. The most likely (frequency, damping
ratio, S, E) have about the deviations of Au's laws, where the subspace method alone errs up to 1.6 times as much.
"""

import numpy as np
from jaxtyping import Float
from scipy import optimize

from nerfmodal.identify.spectra import power_spectral_density

HALF_BAND = 0.3
"""Of the frequency: how far around the resonance the spectrum is fitted."""
FEWEST_LINES = 40
HIGHEST_DAMPING = 0.2
SLOPES = (0.0, 2.0, 4.0)
"""Displacement, velocity, acceleration."""


def refine_resonance(
    series: Float[np.ndarray, " samples"],
    frame_rate: float,
    start: tuple[float, float],
    neighbours: list[float],
    slope: float = 0.0,
) -> tuple[tuple[float, float], float]:
    """Frequency (Hz) and damping ratio of one modal coordinate, and the negative logarithm of their likelihood.

    They are the start itself if the record is short.

    Parameters
    ----------
    series
        The coordinate, evenly sampled.
    frame_rate
        In Hz.
    start
        Frequency and damping ratio of the subspace method.
    neighbours
        Frequencies of the other modes: the band ends half-way to them.
    slope
        The exponent a: one of `SLOPES`.
    """
    frequencies, density = power_spectral_density(series[:, None], frame_rate)
    inside = _band(frequencies, start[0], neighbours)
    if inside.sum() < FEWEST_LINES:
        return start, 0.0
    lines, power = frequencies[inside], density[inside, 0]
    scale = float(power.mean())
    first = np.array([0.0, np.log(start[1]), *_levels(lines, power / scale, start)])
    best = optimize.minimize(
        _negative_log_likelihood,
        first,
        args=(lines, power / scale, start[0], slope),
        method="Nelder-Mead",
        options={"xatol": 1e-5, "fatol": 1e-6, "maxiter": 2000, "initial_simplex": _simplex(first)},
    )
    frequency, ratio = start[0] * float(np.exp(best.x[0])), float(np.exp(best.x[1]))
    inner = ratio <= HIGHEST_DAMPING and lines[0] < frequency < lines[-1]
    return ((frequency, ratio) if inner else start), float(best.fun)


def resonance(
    lines: Float[np.ndarray, " lines"], frequency: float, damping_ratio: float
) -> Float[np.ndarray, " lines"]:
    """|H|² of a displacement response, normalised to 1 at resonance."""
    detuned = (lines**2 - frequency**2) ** 2 + (2 * damping_ratio * lines * frequency) ** 2
    return np.asarray((2 * damping_ratio * frequency**2) ** 2 / detuned)


def _band(frequencies: np.ndarray, center: float, neighbours: list[float]) -> np.ndarray:
    low, high = (1 - HALF_BAND) * center, (1 + HALF_BAND) * center
    for other in neighbours:
        if other < center:
            low = max(low, (other + center) / 2)
        elif other > center:
            high = min(high, (other + center) / 2)
    return np.asarray((frequencies >= low) & (frequencies <= high))


def _levels(lines: np.ndarray, power: np.ndarray, start: tuple[float, float]) -> tuple[float, float]:
    """Logarithms of the peak and of the floor of the spectrum."""
    shape = resonance(lines, *start)
    peak = float((power * shape).sum() / (shape**2).sum())
    return float(np.log(max(peak, 1e-6))), float(np.log(max(np.quantile(power, 0.1), 1e-6)))


def _simplex(first: np.ndarray) -> np.ndarray:
    return np.vstack([first, first + np.diag([0.01, 0.3, 0.5, 0.5])])


def _negative_log_likelihood(
    parameters: np.ndarray, lines: np.ndarray, power: np.ndarray, center: float, slope: float
) -> float:
    shift, log_ratio, log_peak, log_floor = np.clip(parameters, -30, 30)
    peak = np.exp(log_peak) * resonance(lines, center * np.exp(shift), np.exp(log_ratio))
    model = peak * (lines / center) ** slope + np.exp(log_floor)
    return float((np.log(model) + power / model).sum())
