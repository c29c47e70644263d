"""Frames that went astray: no motion explains them, while those before and after are explained.

A frame is reconstructed, or followed, by itself, and now and then one ends in a wrong minimum. One such frame of ninety
was seen to cost a torsion mode a twentieth of its MAC. It stands out of the residual of the joint fit by far and stands
alone; what lasts longer, as a blow or a gust does, is motion and stays.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float

from nerfmodal.types import DisplacementMatrix

FAR = 8.0
"""Residual of a stray frame over that of the usual one; noise alone does not reach twice."""
LONGEST = 2
"""Frames in a row that may go astray together."""


def stray_frames(
    residuals: Float[np.ndarray, "seen channels"], valid: Bool[np.ndarray, " frames"]
) -> Bool[np.ndarray, " frames"]:
    """The frames that are astray, from what the fit leaves of the `valid` ones."""
    sizes = np.linalg.norm(residuals, axis=1)
    far = np.zeros(len(valid), dtype=bool)
    far[valid] = sizes > FAR * np.median(sizes)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], far, [False]]).astype(int)))
    for first, end in edges.reshape(-1, 2):
        if end - first > LONGEST:
            far[first:end] = False
    return far


def without(displacement: DisplacementMatrix, frames: Bool[np.ndarray, " frames"]) -> DisplacementMatrix:
    """The displacement with these frames lost."""
    return replace(
        displacement,
        coefficients=np.where(frames[:, None], np.nan, displacement.coefficients),
        valid=displacement.valid & ~frames,
    )
