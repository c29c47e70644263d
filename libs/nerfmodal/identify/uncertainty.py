"""How well a record can possibly determine a mode: the Cramér-Rao bound of one damped sinusoid in white noise.

Five unknowns (frequency, damping ratio, amplitude, phase, constant), averaged over the unknown phase. Twice the
record is worth 2.8 times for small damping; more sensors buy nothing, because the errors of a frame's surface are
common to all of them.
"""

import numpy as np
from jaxtyping import Float

from nerfmodal.identify.lines import column_derivatives, damped_columns

PHASES = 8


def cramer_rao(
    times: Float[np.ndarray, " frames"], frequency: float, damping_ratio: float, amplitude_to_noise: float
) -> tuple[float, float]:
    """Smallest standard deviations (frequency in Hz, damping ratio) that any unbiased estimator can reach.

    Parameters
    ----------
    times
        Instants of the frames, seconds.
    frequency, damping_ratio
        Of the mode: undamped Hz, 0-1.
    amplitude_to_noise
        First amplitude of the modal coordinate over the standard deviation of its noise in one frame.
    """
    line = np.array([[frequency, damping_ratio]])
    columns = damped_columns(times, line)
    by_frequency, by_damping = (column_derivatives(times, line, parameter)[0] for parameter in (0, 1))
    information = np.zeros((2, 2))
    for phase in np.pi * np.arange(PHASES) / PHASES:
        direction = np.array([np.cos(phase), np.sin(phase)])
        slopes = np.stack([by_frequency @ direction, by_damping @ direction], axis=1)
        slopes = slopes - columns @ np.linalg.lstsq(columns, slopes, rcond=None)[0]
        information += slopes.T @ slopes / PHASES
    frequency_sd, damping_sd = np.sqrt(np.diag(np.linalg.inv(information))) / amplitude_to_noise
    return float(frequency_sd), float(damping_sd)
