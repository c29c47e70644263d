"""A record that grows: a frame at a time, in any order, and the modes so far without starting over.

A frame is the coefficients of its surface and their information matrix, some kilobytes; clouds are not needed again.
The lines known from the last answer are the start of the next: they are refined on all frames, the weakest must still
stand out of the noise, and one search tells whether there is one more. The record that ends is the same as one that
was never interrupted.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from nerfmodal.identify.model import identify
from nerfmodal.spec import IdentificationSpec
from nerfmodal.types import DisplacementMatrix, OrganResult, SensorGrid, SurfaceKind

FLOOR = 0.2
"""Of a plain fit's variance: no direction is held more rigid than this (`surface.pooled` has the reason)."""
RIDGE = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameFit:
    """One frame of an organ: when (s), its surface's coefficients (metres), and the inverse of their covariance."""

    time: float
    coefficients: Float[np.ndarray, " terms"]
    information: Float[np.ndarray, "terms terms"]


@dataclass(frozen=True, slots=True, kw_only=True)
class GrowingRecord:
    """The frames of an organ so far, in time order, and the lines (Hz, damping ratio) known from the last answer.

    `basis` B and `directions` say what coefficients displace (`types.DisplacementMatrix`).
    """

    sensors: SensorGrid
    surface: SurfaceKind
    basis: Float[np.ndarray, "dofs terms"]
    directions: Float[np.ndarray, "axes 3"]
    frame_rate: float
    frames: tuple[FrameFit, ...] = ()
    known: Float[np.ndarray, "modes 2"] | None = None

    def with_frame(self, frame: FrameFit) -> "GrowingRecord":
        """The record with one more frame; a frame of the same instant is replaced (a step that ran twice)."""
        others = [other for other in self.frames if other.time != frame.time]
        return replace(self, frames=tuple(sorted([*others, frame], key=lambda each: each.time)))

    def displacement(self) -> DisplacementMatrix:
        """D so far, from the mean over time (eq 11), each frame drawn to the others by what it saw of itself."""
        pooled = pool(self.frames) if self.frames else np.zeros((0, self.basis.shape[1]))
        return DisplacementMatrix(
            coefficients=pooled - pooled.sum(axis=0) / max(len(pooled), 1),
            basis=self.basis,
            directions=self.directions,
            times=np.array([frame.time for frame in self.frames]),
            frame_rate=self.frame_rate,
            sensors=self.sensors,
            valid=np.ones(len(self.frames), dtype=bool),
        )


def modes_so_far(
    record: GrowingRecord, settings: IdentificationSpec, *, seed: int
) -> tuple[OrganResult, GrowingRecord]:
    """What the frames so far say, and the record that remembers it.

    With fewer than 16 frames the result has no modes and says so (`Outcome.TOO_FEW_FRAMES`). Modes of which fewer
    than two periods are in yet are doubtful (`Reason.RECORD_TOO_SHORT`), as in a finished record.
    """
    result = identify(record.displacement(), settings, seed=seed, surface=record.surface, known=record.known)
    fitted = next((opinion for opinion in result.opinions if opinion.method == "damped_sinusoids"), None)
    if fitted is None:
        return result, record
    return result, replace(record, known=np.column_stack([fitted.frequencies, fitted.damping_ratios]))


def pool(frames: tuple[FrameFit, ...]) -> Float[np.ndarray, "frames terms"]:
    """Coefficients of every frame given the others: the mean of N(mean, V) and the frame's own measurement.

    V is the scatter over the frames less their typical error, in no direction below a fifth of that error. (The
    surface's pooled refit also asks the points again which of them are outliers; a frame's information cannot.)
    """
    raw = np.stack([frame.coefficients for frame in frames])
    if len(frames) <= raw.shape[1] + 1:
        return raw
    errors = np.stack([np.linalg.inv(_regular(frame.information)) for frame in frames])
    typical = errors.mean(axis=0)
    root = np.linalg.cholesky(typical)
    white = np.linalg.solve(root, np.linalg.solve(root, np.cov(raw, rowvar=False) - typical).T)
    sizes, axes = np.linalg.eigh((white + white.T) / 2)
    back = root @ axes
    scatter = (back * np.maximum(sizes, FLOOR)) @ back.T
    mean = raw.mean(axis=0)
    gains = np.linalg.solve(scatter + errors, np.broadcast_to(scatter, errors.shape))
    return np.asarray(mean + np.einsum("fij,fi->fj", gains, raw - mean))


def _regular(information: np.ndarray) -> np.ndarray:
    return np.asarray(information + RIDGE * np.trace(information) / len(information) * np.eye(len(information)))
