"""What an organ's pictures show, as numbers: `<organ>.json` beside them, for who draws them anew (the web page).

Millimetres as in the pictures, six digits; null in lost frames. Components and modes are in the order of the result.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from nerfmodal.figures.eigenvalues import MOST_SHOWN, covariance_eigenvalues
from nerfmodal.figures.spectrum import power_spectral_density
from nerfmodal.figures.stabilisation import diagram_of
from nerfmodal.io import atomic_write
from nerfmodal.types import OrganResult

DIGITS = 6
FRAMES_FOR_SPECTRUM = 2


def write_numbers(organ: OrganResult, path: Path) -> Path:
    """Write the numbers of one organ."""
    with atomic_write(path) as temporary:
        temporary.write_text(json.dumps(numbers(organ), allow_nan=False, separators=(",", ":")) + "\n")
    return path


def numbers(organ: OrganResult) -> dict[str, Any]:
    """Histories and spectra of modes (Figure 7) and of their sum, eigenvalues (Figure 5), and stabilisation diagram."""
    displacement, model = organ.displacement, organ.model
    coordinates = 1e3 * np.where(displacement.valid[:, None], model.coordinates, np.nan)
    spectra = [_spectrum(organ, values) for values in coordinates.T]
    return {
        "organ": organ.organ,
        "frame_rate_hz": displacement.frame_rate,
        "times_s": _rounded(displacement.times),
        "coordinates_mm": [_rounded(values) for values in coordinates.T],
        "frequencies_hz": _rounded(spectra[0][0]) if spectra else [],
        "densities_mm2_per_hz": [_rounded(density) for _, density in spectra],
        "eigenvalues": _eigenvalues(organ),
        "stabilisation": _stabilisation(organ),
    }


def _spectrum(
    organ: OrganResult, values: Float[np.ndarray, " frames"]
) -> tuple[Float[np.ndarray, " bins"], Float[np.ndarray, " bins"]]:
    if np.isfinite(values).sum() < FRAMES_FOR_SPECTRUM:
        return np.empty(0), np.empty(0)
    return power_spectral_density(organ.displacement.times, values, organ.displacement.frame_rate)


def _eigenvalues(organ: OrganResult) -> dict[str, Any] | None:
    """Mean squares in mm² that the components carry, how many were kept, and the sum over all."""
    if organ.reduction is None or not organ.reduction.singular_values.any():
        return None
    values = covariance_eigenvalues(organ)
    return {
        "mean_squares_mm2": _rounded(values[:MOST_SHOWN]),
        "sum_mm2": float(f"{values.sum():.{DIGITS}g}"),
        "kept": organ.reduction.scores.shape[1],
    }


def _stabilisation(organ: OrganResult) -> dict[str, Any] | None:
    diagram = diagram_of(organ)
    if diagram is None or not len(diagram.orders):
        return None
    return {
        "orders": diagram.orders.tolist(),
        "frequencies_hz": _rounded(diagram.frequencies),
        "damping_ratios": _rounded(diagram.damping_ratios),
        "stable": diagram.stable.tolist(),
    }


def _rounded(values: Float[np.ndarray, " any"]) -> list[float | None]:
    """As JSON takes them: six significant digits, null for what is no number."""
    return [float(f"{value:.{DIGITS}g}") if np.isfinite(value) else None for value in values]
