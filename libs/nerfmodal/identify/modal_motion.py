"""The second pass over a record: its displacement as the sum of its modes, each with one time course for all sensors.

Frames are found one by one, and each errs in its own way. A free decay has few degrees of freedom: once frequencies and
damping ratios are known, every channel is a constant and one damped cosine and sine for each mode,

    D(t) ~ K + Σ_j exp(-ζ_j ω_j t) (A_j cos ω_dj t + B_j sin ω_dj t),

by least squares over all frames at once. What the modes do not explain is noise, or a mode that was not accepted.
"""

from dataclasses import replace

import numpy as np

from nerfmodal.identify.lines import damped_columns
from nerfmodal.types import DisplacementMatrix, ModalModel, Verdict


def modal_motion(displacement: DisplacementMatrix, model: ModalModel) -> DisplacementMatrix:
    """The part of the displacement (m) that decays freely in the accepted modes; frames that were lost are filled.

    Parameters
    ----------
    displacement
        As it was measured; its factors' channels are fitted, not each sensor's.
    model
        Its modes: frequencies in Hz and damping ratios are taken as they are.
    """
    accepted = np.array([quality.verdict is Verdict.ACCEPTED for quality in model.quality], dtype=bool)
    lines = np.column_stack([model.frequencies[accepted], model.damping_ratios[accepted]])
    columns = damped_columns(displacement.times, lines)
    seen = displacement.valid
    amplitudes = np.linalg.lstsq(columns[seen], displacement.coefficients[seen], rcond=None)[0]
    return replace(displacement, coefficients=columns @ amplitudes, valid=np.ones_like(seen))
