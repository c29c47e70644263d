"""One organ, one level of detail: the smooth displacement under which frame 0's pixels become the frame's.

A pixel of frame 0 with the opacity a shows I0 = F + (1 - a) B: the structure's part F, and the background B, which
stands still. The part moves, so where its place X is seen after the displacement u(X) the frame must show
I(p) = (1 + g) F + (1 - a) B(p), with a smooth change of light g. Gauss-Newton steps, robustly weighted (Geman-McClure's
neighbour, Cauchy), on the difference: forward-additive Lucas-Kanade (Baker and Matthews 2004) over all cameras at once.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from nerfmodal.geometry.cameras import project
from nerfmodal.geometry.deformation import Deformation
from nerfmodal.tracking.equations import accumulate
from nerfmodal.tracking.pyramid import Level, read
from nerfmodal.types import Camera

LIGHT_DEGREES = (3, 1, 0)
"""Degrees of the change of light along the organ, for each degree across it."""
LIGHT_STD, LIGHT_DECAY = 0.5, 0.8
MOTION_SHARE = 0.1
"""Expected size of the displacement, in lengths of the organ, before a coarser level has said more."""
LEAST_SHARE, DOUBT = 0.01, 4.0
"""The coarser level's root mean square times so much is the expected size, or at least this share of the length."""
TUNING = 0.6
"""A pixel whose difference, with its neighbours', is so many robust standard deviations has half its weight."""
NEAR = 0.6
"""Pixels (of the level) over which differences are averaged to weigh a pixel: a hidden leaflet is more than one pixel,
noise is not, and a weight that noise moves takes from the loss its curvature."""
DARKEST = 1e-3
STEPS = 6
SETTLED_PIXELS = 0.02
"""The search on a level ends when its steps move the organ's pixels by less than this, times the level's factor."""
RESTLESS = 0.06
"""Slope of the background (of 1 per pixel) behind a half transparent pixel from which on it is believed less."""
PROBE = 1e-4
"""Metres by which a place is moved to see how its pixel moves."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Pixels:
    """The pixels of an organ, camera after camera: place of frame 0 (world, m), pixel centre (x, y), weights (see
    `Reference`)."""

    camera: Int[np.ndarray, " pixels"]
    points: Float[np.ndarray, "pixels 3"]
    centers: Float[np.ndarray, "pixels 2"]
    trust: Float[np.ndarray, " pixels"]
    unrest: Float[np.ndarray, " pixels"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Alignment:
    """Coefficients of displacement (terms, 3) and light (terms, 3), the displacement's covariance, and the misfit.

    `residual` and `contrast` are robust sizes (of 1) of what is left and of the structure's part itself.
    """

    motion: Float[np.ndarray, "terms 3"]
    light: Float[np.ndarray, "light_terms 3"]
    covariance: Float[np.ndarray, "dofs dofs"]
    residual: float
    contrast: float


@dataclass(frozen=True, slots=True, kw_only=True)
class _Equations:
    normal: np.ndarray
    slope: np.ndarray
    scatter: np.ndarray
    residual: float
    contrast: float


def align(
    pixels: Pixels,
    template: Level,
    background: Level,
    frame: Level,
    cameras: Sequence[Camera],
    deformation: Deformation,
    *,
    start: Alignment | None,
    decay: float,
) -> Alignment:
    """Gauss-Newton from `start` on one level.

    Parameters
    ----------
    template, background, frame
        At the same level: frame 0 (channels 0-2 its picture, 3 the opacity) as it is, and as splines the backgrounds
        and the frame's pictures.
    decay
        Prior size of a term against that of the next lower degree.
    """
    problem = _Problem(pixels, template, background, frame, cameras, deformation)
    length = 2 * float(deformation.half[0])
    unknowns = (
        np.zeros(problem.size) if start is None else np.concatenate([start.motion.T.ravel(), start.light.T.ravel()])
    )
    precision = problem.precision(_expected_size(problem.basis, start, length), decay)
    for step in range(STEPS):
        equations = problem.equations(unknowns)
        prior = precision * problem.overlap * (TUNING * equations.residual) ** 2
        change = np.linalg.solve(equations.normal + np.diag(prior), -equations.slope - prior * unknowns)
        unknowns = unknowns + change
        if problem.moves(change) < SETTLED_PIXELS * template.factor or step == STEPS - 1:
            break
    # what was not seen must not pass for a motion known to be small
    unsure = problem.precision(MOTION_SHARE * length, decay)
    return problem.answer(unknowns, problem.equations(unknowns), unsure)


def _expected_size(basis: Float[np.ndarray, "pixels terms"], start: Alignment | None, length: float) -> float:
    """Prior standard deviation of the displacement's lowest terms, metres."""
    if start is None:
        return MOTION_SHARE * length
    found = float(np.sqrt(((basis @ start.motion) ** 2).sum(axis=1).mean()))
    return float(np.clip(DOUBT * found, LEAST_SHARE * length, MOTION_SHARE * length))


class _Vicinity:
    """Averages over a pixel and those of its eight neighbours that show the organ too."""

    def __init__(
        self, camera: Int[np.ndarray, " pixels"], rows: Int[np.ndarray, " pixels"], columns: Int[np.ndarray, " pixels"]
    ) -> None:
        count = len(rows)
        number = np.full((int(camera.max()) + 1, int(rows.max()) + 3, int(columns.max()) + 3), count)
        number[camera, rows + 1, columns + 1] = np.arange(count)
        steps = [(down, right) for down in (-1, 0, 1) for right in (-1, 0, 1)]
        self._near = np.stack([number[camera, rows + 1 + down, columns + 1 + right] for down, right in steps], axis=1)
        share = np.exp([-0.5 * (down**2 + right**2) / NEAR**2 for down, right in steps])
        self._shares = share * (self._near < count)
        self._shares /= self._shares.sum(axis=1, keepdims=True)

    def mean(self, values: Float[np.ndarray, " pixels"]) -> Float[np.ndarray, " pixels"]:
        """The averages of a value that each pixel has."""
        return np.einsum("pn,pn->p", self._shares, np.append(values, 0.0)[self._near])


class _Problem:
    """The level's equations; rows are pixels times channels."""

    def __init__(
        self,
        pixels: Pixels,
        template: Level,
        background: Level,
        frame: Level,
        cameras: Sequence[Camera],
        deformation: Deformation,
    ) -> None:
        columns, rows = ((pixels.centers - 0.5).astype(int) // template.factor).T
        shown = template.images[pixels.camera, rows, columns]
        behind, _ = read(background, pixels.camera, pixels.centers)
        self.pixels, self.frame, self.cameras = pixels, frame, cameras
        self.background = background
        opacity = shown[:, 3]
        self.part = shown[:, :3] - (1 - opacity)[:, None] * behind
        self.clear = (1 - opacity)[:, None]
        self.basis = np.ascontiguousarray(deformation.at(pixels.points))
        self.orders = deformation.orders
        bright = Deformation(frame=deformation.frame, half=deformation.half, degrees=LIGHT_DEGREES)
        self.light_orders = bright.orders
        self.light = np.ascontiguousarray(bright.at(pixels.points))
        self.dofs = 3 * self.basis.shape[1]
        self.size = self.dofs + 3 * self.light.shape[1]
        self.weights = pixels.trust / (1 + (pixels.unrest * (1 - opacity) / RESTLESS) ** 2)
        sigma = template.sigma / template.factor
        self.overlap = 3 * (1 + 4 * np.pi * sigma**2)  # pixels and channels whose errors are one error
        self.vicinity = _Vicinity(pixels.camera, rows, columns)
        self._slopes: np.ndarray | None = None

    def precision(self, size: float, decay: float) -> np.ndarray:
        """Inverse prior variances of all unknowns."""
        motion = size * decay ** self.orders.sum(axis=1)
        light = LIGHT_STD * LIGHT_DECAY ** self.light_orders.sum(axis=1)
        return 1 / np.concatenate([np.tile(motion, 3), np.tile(light, 3)]) ** 2

    def equations(self, unknowns: np.ndarray) -> _Equations:
        """Normal matrix, slope of the loss, and the scatter of the cameras' slopes, at these unknowns."""
        moved = self.pixels.points + self.basis @ unknowns[: self.dofs].reshape(3, -1).T
        change = self.light @ unknowns[self.dofs :].reshape(3, -1).T
        places = self._projected(moved)
        if self._slopes is None:
            self._slopes = self._sight(moved, places)
        shown, rises = read(self.frame, self.pixels.camera, places)
        behind, behind_rises = read(self.background, self.pixels.camera, places)
        difference = shown - self.clear * behind - (1 + change) * self.part
        rises = rises - self.clear[..., None] * behind_rises
        residual = 1.4826 * float(np.median(np.abs(difference))) + DARKEST
        off = self.vicinity.mean((difference**2).mean(axis=1))
        weights = self.weights / (1 + off / (TUNING * residual) ** 2)
        return self._assembled(rises, difference, np.repeat(weights[:, None], 3, axis=1), residual)

    def moves(self, change: np.ndarray) -> float:
        """By how many pixels a change of the unknowns moves the organ, root mean square."""
        assert self._slopes is not None
        moved = self.basis @ change[: self.dofs].reshape(3, -1).T
        return float(np.sqrt((np.einsum("pxa,pa->px", self._slopes, moved) ** 2).sum(axis=1).mean()))

    def answer(self, unknowns: np.ndarray, equations: _Equations, precision: np.ndarray) -> Alignment:
        """The result, its covariance from the loss's curvature and the scatter between cameras (the sandwich of Huber
        1967): each camera errs in its own way, by more than its pixels' noise.
        """
        scale = self.overlap * (TUNING * equations.residual) ** 2
        prior = scale * np.diag(precision)
        inverse = np.linalg.inv(equations.normal + prior)
        sandwich = inverse @ (equations.scatter + scale * prior) @ inverse
        return Alignment(
            motion=unknowns[: self.dofs].reshape(3, -1).T,
            light=unknowns[self.dofs :].reshape(3, -1).T,
            covariance=sandwich[: self.dofs, : self.dofs],
            residual=equations.residual,
            contrast=equations.contrast,
        )

    def _projected(self, points: Float[np.ndarray, "pixels 3"]) -> Float[np.ndarray, "pixels 2"]:
        places = np.empty((len(points), 2))
        ends = np.searchsorted(self.pixels.camera, np.arange(len(self.cameras)), side="right")
        for camera, first, end in zip(self.cameras, (0, *ends), ends, strict=False):
            places[first:end], _ = project(camera, points[first:end])
        return places

    def _sight(self, points: np.ndarray, places: np.ndarray) -> Float[np.ndarray, "pixels 2 3"]:
        """How a pixel moves as its place does, pixels per metre."""
        return np.stack([(self._projected(points + PROBE * axis) - places) / PROBE for axis in np.eye(3)], axis=-1)

    def _assembled(self, rises: np.ndarray, difference: np.ndarray, weights: np.ndarray, residual: float) -> _Equations:
        assert self._slopes is not None
        normal, by_camera = accumulate(
            rises,
            self._slopes,
            difference,
            weights,
            self.part,
            self.basis,
            self.light,
            self.pixels.camera,
            len(self.cameras),
        )
        seeing = max(len(np.unique(self.pixels.camera)), 2)
        return _Equations(
            normal=normal,
            slope=by_camera.sum(axis=0),
            scatter=by_camera.T @ by_camera * seeing / (seeing - 1),
            residual=residual,
            contrast=float(np.sqrt(np.average((self.part**2).mean(axis=1), weights=self.weights + 1e-9))),
        )
