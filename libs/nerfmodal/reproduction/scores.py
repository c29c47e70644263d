"""A result held against what was imposed: modes in pairs, displacement, and the eigenvalues that stand out.

Only here, and in comparisons, is the truth of a simulation read: identification never sees it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from nerfmodal.identify.comparison import ComparisonRow, compare, truth_at_sensors
from nerfmodal.types import OrganResult, ScanResult, TrueMode, Verdict

ACTIVE_SHARE = 0.01
"""An eigenvalue is active from this share of the largest: below it none is seen above the axis of a plot such as the
paper's Figure 5, which gives no rule."""
NEAR_HZ = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class ScoredMode:
    """A row of the comparison and the name of the imposed shape (None where nothing was imposed)."""

    row: ComparisonRow
    shape: str | None


@dataclass(frozen=True, slots=True, kw_only=True)
class OrganScore:
    """What is said of a whole organ.

    `displacement_error` is the root mean square of the measured minus the true displacement of all sensors in all
    frames, over that of the true one; None where fewer than two frames could be measured. `active` and `true_active`
    count eigenvalues of at least 1 % of the largest.
    """

    organ: str
    sensors: int
    active: int
    true_active: int
    displacement_error: float | None


def score(result: ScanResult, truth: Sequence[TrueMode]) -> tuple[list[ScoredMode], list[OrganScore]]:
    """Every mode beside its truth, unmatched ones of either side kept, and every organ that has a truth."""
    rows = [ScoredMode(row=row, shape=_shape_of(row, truth)) for row in compare(result, truth)]
    names = {mode.organ for mode in truth}
    return rows, [score_organ(organ, truth) for organ in result.organs if organ.organ in names]


def score_organ(organ: OrganResult, truth: Sequence[TrueMode]) -> OrganScore:
    """Eigenvalues and displacement of one organ against the imposed motion."""
    imposed = true_displacement(organ, truth)
    seen = organ.displacement.valid
    if seen.sum() < 2:
        sensors = len(organ.displacement.sensors.positions)
        return OrganScore(organ=organ.organ, sensors=sensors, active=0, true_active=0, displacement_error=None)
    measured = organ.displacement.values.reshape(len(seen), -1)
    measured, imposed = (_centred(values[seen]) for values in (measured, imposed))
    scale = float(np.sqrt(np.mean(imposed**2)))
    return OrganScore(
        organ=organ.organ,
        sensors=len(organ.displacement.sensors.positions),
        active=active_eigenvalues(_spectrum(measured)),
        true_active=active_eigenvalues(_spectrum(imposed)),
        displacement_error=float(np.sqrt(np.mean((measured - imposed) ** 2))) / max(scale, 1e-12),
    )


def true_displacement(organ: OrganResult, truth: Sequence[TrueMode]) -> Float[np.ndarray, "frames dofs"]:
    """What the organ's sensors should have seen along their directions, metres: the sum of its imposed modes."""
    mine = [mode for mode in truth if mode.organ == organ.organ]
    moved = np.zeros((len(organ.displacement.times), organ.displacement.basis.shape[0]))
    for mode in mine:
        moved += np.outer(mode.coordinates, truth_at_sensors(organ, mode))
    return moved


def active_eigenvalues(values: Float[np.ndarray, " components"]) -> int:
    """How many eigenvalues are at least 1 % of the largest."""
    return int(np.count_nonzero(values >= ACTIVE_SHARE * max(float(values.max(initial=0.0)), 1e-300)))


def is_right(mode: ScoredMode) -> bool:
    """Whether a mode that was imposed was found and accepted."""
    return mode.row.truth_hz is not None and mode.row.verdict is Verdict.ACCEPTED


def is_false(mode: ScoredMode) -> bool:
    """Whether a mode was accepted that nobody imposed."""
    return mode.row.truth_hz is None and mode.row.verdict is Verdict.ACCEPTED


def _centred(values: Float[np.ndarray, "frames dofs"]) -> Float[np.ndarray, "frames dofs"]:
    return np.asarray(values - values.mean(axis=0))


def _spectrum(values: Float[np.ndarray, "frames dofs"]) -> Float[np.ndarray, " frames"]:
    """Eigenvalues of the frames' products: those of the covariance, up to a factor."""
    return np.asarray(np.linalg.eigvalsh(values @ values.T))


def _shape_of(row: ComparisonRow, truth: Sequence[TrueMode]) -> str | None:
    if row.truth_hz is None:
        return None
    near = (mode for mode in truth if abs(mode.frequency - row.truth_hz) < NEAR_HZ and mode.organ == row.organ)
    return next((mode.name for mode in near), None)
