"""How well a record can possibly determine a mode; no method reads more out of it.

Free decay and steady motion: the Cramér-Rao bound of one damped sinusoid in white noise. Five unknowns (frequency,
damping ratio, amplitude, phase, constant), averaged over the unknown phase. Twice the record is worth 2.8 times for
small damping; more sensors buy nothing, because the errors of a frame's surface are common to all of them.

Ambient vibration: Au's laws for long records (Au, Mechanical Systems and Signal Processing 48, 2014).
"""

import numpy as np
from jaxtyping import Float

PHASES = 8
LEAST_DAMPING = 1e-4
"""An undamped mode under a random force has no law: it is taken for this ratio."""


def cramer_rao(
    times: Float[np.ndarray, " frames"], frequency: float, damping_ratio: float, amplitude_to_noise: float
) -> tuple[float, float]:
    """Smallest standard deviations (frequency in Hz, damping ratio) that any unbiased estimator can reach.

    Parameters
    ----------
    times
        Instants of the frames, seconds; the amplitude is that of the first.
    frequency, damping_ratio
        Of the mode: undamped Hz, 0-1.
    amplitude_to_noise
        First amplitude of the modal coordinate over the standard deviation of its noise in one frame.
    """
    elapsed, omega = times - times[0], 2 * np.pi * frequency
    root = np.sqrt(1 - damping_ratio**2)
    pole = omega * (-damping_ratio + 1j * root)
    decay = np.exp(pole * elapsed)
    by_frequency = 2 * np.pi * (pole / omega) * elapsed * decay
    by_damping = omega * (-1 - 1j * damping_ratio / root) * elapsed * decay
    nuisance = np.linalg.qr(np.column_stack([np.ones_like(elapsed), decay.real, decay.imag]))[0]
    information = np.zeros((2, 2))
    for turn in np.exp(1j * np.pi * np.arange(PHASES) / PHASES):
        slopes = np.real(turn * np.column_stack([by_frequency, by_damping]))
        slopes = slopes - nuisance @ (nuisance.T @ slopes)
        information += slopes.T @ slopes / PHASES
    frequency_sd, damping_sd = np.sqrt(np.diag(np.linalg.inv(information))) / amplitude_to_noise
    return float(frequency_sd), float(damping_sd)


def ambient_deviations(frequency: float, damping_ratio: float, duration: float) -> tuple[float, float]:
    """Standard deviations (Hz, ratio) that a record of ambient vibration of this length (s) cannot beat.

    (sd f / f)² = ζ / (2π N) and (sd ζ / ζ)² = 1 / (2π ζ N) with N periods in the record.
    """
    ratio, periods = max(damping_ratio, LEAST_DAMPING), max(frequency * duration, 1e-9)
    frequency_sd = frequency * np.sqrt(ratio / (2 * np.pi * periods))
    return float(frequency_sd), float(ratio / np.sqrt(2 * np.pi * ratio * periods))
