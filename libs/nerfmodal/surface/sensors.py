"""Virtual Lagrangian sensors and the displacement matrix (eq 11).

Rows are time, columns are degrees of freedom (sensor-major: sensor 0 axis 0, sensor 0 axis 1, …). With the
coefficients C (frames, terms) of a surface and its basis B (dofs, terms) at the sensors, D = C Bᵀ: C and the recipe
of B are stored, and the number of sensors is a matter of display.
"""

from dataclasses import dataclass
from typing import Literal, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float

from nerfmodal.surface.robust import Prior, RobustFit
from nerfmodal.types import DisplacementMatrix, SensorGrid, SurfaceKind

Reference = Literal["mean", "first", "previous"]


@runtime_checkable
class Surface(Protocol):
    """What a leaf's and a trunk's surface have in common: fixed through the record, fitted to every frame."""

    @property
    def directions(self) -> Float[np.ndarray, "axes 3"]:
        """Unit vectors (world) that displacement is measured along."""

    @property
    def size(self) -> int:
        """Number of coefficients of a frame."""

    def fit(
        self,
        points: Float[np.ndarray, "points 3"],
        *,
        start: Float[np.ndarray, " coefficients"] | None = None,
        prior: Prior | None = None,
    ) -> RobustFit | None:
        """Coefficients of one frame's points, from `start` on; None if there are too few."""

    def displacement_basis(self) -> Float[np.ndarray, "dofs terms"]:
        """B: what the leading coefficients displace at every sensor."""

    def positions(self, coefficients: Float[np.ndarray, " coefficients"]) -> Float[np.ndarray, "sensors 3"]:
        """Where the sensors are, world."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Track:
    """The motion of one organ."""

    organ: str
    surface: SurfaceKind
    displacement: DisplacementMatrix


def displace(
    coefficients: Float[np.ndarray, "frames terms"], valid: Bool[np.ndarray, " frames"], reference: Reference
) -> tuple[Float[np.ndarray, "frames terms"], Bool[np.ndarray, " frames"]]:
    """Coefficients from the reference (eq 11), and which frames have them.

    `mean`: from the mean over time (default). `first`: from the first usable frame. `previous`: from the frame
    before, as printed; a mode's amplitude is then multiplied by 2 sin(π f / frame rate), the noise doubles and turns
    blue, and a frame after a lost one is lost too.
    """
    masked = np.where(valid[:, None], coefficients, np.nan)
    if not valid.any():
        return masked, valid
    if reference == "first":
        return masked - masked[np.argmax(valid)], valid
    if reference == "mean":
        return masked - masked[valid].mean(axis=0), valid
    difference = np.vstack([np.full((1, masked.shape[1]), np.nan), masked[1:] - masked[:-1]])  # eq 11 as printed
    return difference, np.asarray(np.isfinite(difference).all(axis=1))


def track_of(
    surface: Surface,
    fits: list[RobustFit | None],
    *,
    organ: str,
    kind: SurfaceKind,
    reference: Reference,
    times: Float[np.ndarray, " frames"],
    frame_rate: float,
) -> Track:
    """The displacement of every sensor from the frames' fits; None is a lost frame."""
    basis = surface.displacement_basis()
    seen = np.array([fit is not None for fit in fits])
    whole = np.stack([_coefficients(fit, surface) for fit in fits])
    rest = np.nanmean(whole, axis=0) if seen.any() else np.zeros(whole.shape[1])
    moved, valid = displace(whole[:, : basis.shape[1]], seen, reference)
    displacement = DisplacementMatrix(
        coefficients=moved,
        basis=basis,  # D = C Bᵀ
        directions=surface.directions,
        times=times,
        frame_rate=frame_rate,
        sensors=SensorGrid(organ=organ, positions=surface.positions(rest)),
        valid=valid,
    )
    return Track(organ=organ, surface=kind, displacement=displacement)


def _coefficients(fit: RobustFit | None, surface: Surface) -> np.ndarray:
    return np.full(surface.size, np.nan) if fit is None else fit.coefficients
