"""What the paper's chain says: complexity pursuit, then every source's spectral peak and logarithmic decrement."""

import numpy as np

from nerfmodal.identify.damping import logarithmic_decrement
from nerfmodal.identify.separation import pursue_complexity
from nerfmodal.identify.shapes import shapes_of_sources, unit_max
from nerfmodal.identify.spectra import peak_frequency, resample_evenly
from nerfmodal.types import DisplacementMatrix, Opinion, Reduction


def pursue(displacement: DisplacementMatrix, reduction: Reduction) -> Opinion:
    """Modes by PCA + complexity pursuit + peak + decrement (eqs 12-16), the most energetic first.

    Gaps and uneven stamps are bridged by straight lines here only; coordinates are at the frames' own instants.
    """
    even = resample_evenly(displacement.times, reduction.scores, displacement.frame_rate)
    sources = pursue_complexity(even)
    shapes, factors = unit_max(shapes_of_sources(reduction, sources))
    coordinates = sources.coordinates * factors
    rate = displacement.frame_rate
    frequencies = np.array([peak_frequency(series, rate) for series in coordinates.T])
    ratios = np.array(
        [logarithmic_decrement(series, line, rate) for series, line in zip(coordinates.T, frequencies, strict=True)]
    )
    grid = displacement.times[0] + np.arange(len(even)) / rate
    return Opinion(
        method="complexity_pursuit",
        frequencies=frequencies,
        damping_ratios=ratios,
        mode_shapes=shapes.reshape(len(displacement.sensors.positions), -1, shapes.shape[1]),
        coordinates=np.stack([np.interp(displacement.times, grid, series) for series in coordinates.T], axis=1),
    )
