"""What the paper's chain says: complexity pursuit, then every source's spectral peak and logarithmic decrement."""

import numpy as np

from nerfmodal.identify.damping import logarithmic_decrement
from nerfmodal.identify.readings import Reading, Record, normalised
from nerfmodal.identify.separation import pursue_complexity
from nerfmodal.identify.spectra import peak_frequency
from nerfmodal.identify.subspace import at_frames, even_scores


def pursue(record: Record, count: int) -> Reading:
    """Modes by `count` principal components + complexity pursuit + peak + decrement (eqs 12-16), strongest first.

    Gaps and uneven stamps are bridged by straight lines here only; coordinates are at the frames' own instants.
    """
    displacement = record.displacement
    even = even_scores(record, count)
    sources = pursue_complexity(even)
    local, shapes, factors = normalised(record.axes, sources.mixing.T)  # eq 15: Phi = Psi U_rᵀ
    coordinates = sources.coordinates * factors
    rate = displacement.frame_rate
    frequencies = np.array([peak_frequency(series, rate) for series in coordinates.T])
    ratios = np.array(
        [logarithmic_decrement(series, line, rate) for series, line in zip(coordinates.T, frequencies, strict=True)]
    )
    return Reading(
        method="complexity_pursuit",
        frequencies=frequencies,
        damping_ratios=ratios,
        local=local,
        shapes=shapes,
        coordinates=at_frames(displacement, coordinates),
    )
