"""A trunk or branch: a curved centreline (Chebyshev) with a radius that changes linearly along it.

Local axes: the third runs along the rod (s), the first two across it (u, v). A point's residual is its distance from
the centreline minus the radius there. Cauchy loss of 4 mm: stray points and leaf bases do not pull; a view of one
side suffices. Gauss-Newton with the analytic Jacobian, started from the pooled fit.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy import special

from nerfmodal.geometry.frames import LocalFrame
from nerfmodal.surface.plane import rod_frame
from nerfmodal.surface.robust import Prior, RobustFit, robust_scale, solve_symmetric

CAUCHY_M = 0.004
DEGREE = 4
RADIUS_TERMS = 2
MOST_STEPS = 30
SETTLED_M = 1e-7
INLIER_LOSSES = 4.0
"""Residuals within this many Cauchy scales count as inliers."""
SHRINK = 0.95
ENDS = 0.002
"""Quantile of the pooled points along the rod that its ends are taken at."""
MARGIN = 1.02


@dataclass(frozen=True, slots=True, kw_only=True)
class CylinderSurface:
    """What stays fixed: the frame, where the rod lies, the start and the sensors.

    `middle` ± `half` are its ends along the frame's third axis, metres; sensors are at s from -1 to 1 between them.
    Coefficients are (u terms, v terms, radius at the middle, radius slope), metres.
    """

    frame: LocalFrame
    middle: float
    half: float
    degree: int
    start: Float[np.ndarray, " coefficients"]
    sensors: Float[np.ndarray, " sensors"]

    @property
    def directions(self) -> Float[np.ndarray, "2 3"]:
        """The two directions across the rod."""
        return self.frame.axes[:, :2].T

    @property
    def size(self) -> int:
        """Number of coefficients, the radius' two included."""
        return len(self.start)

    def fit(
        self,
        points: Float[np.ndarray, "points 3"],
        *,
        start: Float[np.ndarray, " coefficients"] | None = None,
        prior: Prior | None = None,
    ) -> RobustFit | None:
        """The coefficients of one frame's points (world, metres); None without more points than coefficients."""
        across, along = _split(self.frame.to_local(points), self.middle, self.half)
        if len(along) <= len(self.start):
            return None
        return _gauss_newton(across, along, self.start if start is None else start, self.degree, prior)

    def displacement_basis(self) -> Float[np.ndarray, "dofs terms"]:
        """B of D = C Bᵀ: the centreline's two offsets at every sensor; the radius does not displace."""
        terms = _chebyshev(self.sensors, self.degree)
        basis = np.zeros((len(self.sensors), 2, 2 * terms.shape[1]))
        basis[:, 0, : terms.shape[1]] = terms
        basis[:, 1, terms.shape[1] :] = terms
        return basis.reshape(2 * len(self.sensors), -1)

    def positions(self, coefficients: Float[np.ndarray, " coefficients"]) -> Float[np.ndarray, "sensors 3"]:
        """The sensors on the centreline (world, metres)."""
        basis = self.displacement_basis()
        offsets = (basis @ coefficients[: basis.shape[1]]).reshape(-1, 2)
        return self.frame.to_world(np.column_stack([offsets, self.middle + self.half * self.sensors]))


@dataclass(frozen=True, slots=True, kw_only=True)
class Sections:
    """The rod at every sensor: where its centreline is (world, metres), its radius (metres), how it is bent (1/m).

    `bending` is the second derivative of the centreline along the rod in the two directions across it.
    """

    positions: Float[np.ndarray, "sensors 3"]
    radii: Float[np.ndarray, " sensors"]
    bending: Float[np.ndarray, "sensors 2"]


def sections(surface: CylinderSurface, coefficients: Float[np.ndarray, " coefficients"]) -> Sections:
    """Position, radius and bending of every section of a frame's rod."""
    terms = surface.degree + 1
    offsets = np.stack([coefficients[:terms], coefficients[terms : 2 * terms]], axis=1)
    curved = _chebyshev_bent(surface.sensors, surface.degree) @ offsets
    return Sections(
        positions=surface.positions(coefficients),
        radii=coefficients[-2] + coefficients[-1] * surface.sensors,
        bending=curved / surface.half**2,
    )


def choose_cylinder(pooled: Float[np.ndarray, "points 3"], *, degree: int, sensors: int) -> CylinderSurface:
    """The fixed parts, from points pooled over the record. Raises `InvalidClouds` if they are one point."""
    frame = rod_frame(pooled)
    local = frame.to_local(pooled)
    low, high = np.quantile(local[:, 2], [ENDS, 1 - ENDS])
    middle, half = float(low + high) / 2, float(high - low) / 2
    across, along = _split(local, middle, half)
    centerline_degree = min(degree, DEGREE)
    start = _straight_start(across, along, centerline_degree)
    start = _gauss_newton(across, along, start, centerline_degree, None).coefficients
    return CylinderSurface(
        frame=frame,
        middle=middle,
        half=half,
        degree=centerline_degree,
        start=start,
        sensors=SHRINK * np.linspace(-1.0, 1.0, sensors),
    )


def radial_residuals(
    coefficients: Float[np.ndarray, " coefficients"],
    across: Float[np.ndarray, "points 2"],
    terms: Float[np.ndarray, "points terms"],
    along: Float[np.ndarray, " points"],
) -> tuple[Float[np.ndarray, " points"], Float[np.ndarray, "points coefficients"]]:
    """Distance of each point from the surface (metres, positive outside) and its Jacobian."""
    count = terms.shape[1]
    offsets = across - np.stack([terms @ coefficients[:count], terms @ coefficients[count : 2 * count]], axis=1)
    distances = np.maximum(np.linalg.norm(offsets, axis=1), 1e-12)
    inward = -offsets / distances[:, None]
    residuals = distances - (coefficients[-2] + coefficients[-1] * along)
    radius_columns = np.stack([-np.ones_like(along), -along], axis=1)
    return residuals, np.hstack([inward[:, :1] * terms, inward[:, 1:] * terms, radius_columns])


def _chebyshev(along: np.ndarray, degree: int) -> np.ndarray:
    """T_0 … T_degree at every point."""
    return np.asarray(special.eval_chebyt(np.arange(degree + 1), along[:, None]))


def _chebyshev_bent(along: np.ndarray, degree: int) -> np.ndarray:
    """Second derivatives of T_0 … T_degree inside (-1, 1): n ((n + 1) T_n - U_n) / (x² - 1)."""
    n, x = np.arange(degree + 1), along[:, None]
    return np.asarray(n * ((n + 1) * special.eval_chebyt(n, x) - special.eval_chebyu(n, x)) / (x**2 - 1))


def _split(local: np.ndarray, middle: float, half: float) -> tuple[np.ndarray, np.ndarray]:
    along = (local[:, 2] - middle) / half
    kept = np.abs(along) <= MARGIN
    return local[kept, :2], along[kept]


def _straight_start(across: np.ndarray, along: np.ndarray, degree: int) -> np.ndarray:
    """A polynomial through the points themselves, and their median distance from it as the radius."""
    terms = _chebyshev(along, min(2, degree))
    centers, *_ = np.linalg.lstsq(terms, across, rcond=None)
    start = np.zeros(2 * (degree + 1) + RADIUS_TERMS)
    start[: len(centers)] = centers[:, 0]
    start[degree + 1 : degree + 1 + len(centers)] = centers[:, 1]
    start[-2] = np.median(np.linalg.norm(across - terms @ centers, axis=1))
    return start


def _gauss_newton(
    across: np.ndarray, along: np.ndarray, start: np.ndarray, degree: int, prior: Prior | None
) -> RobustFit:
    """Cauchy-weighted Gauss-Newton; a small ridge keeps the direction that a one-sided view does not see."""
    terms = _chebyshev(along, degree)
    coefficients = start
    known = np.zeros((len(start), len(start)))
    for _ in range(MOST_STEPS):
        residuals, jacobian = radial_residuals(coefficients, across, terms, along)
        scale = robust_scale(residuals)
        weights = 1.0 / (1.0 + (residuals / CAUCHY_M) ** 2)
        weighted = jacobian * weights[:, None]
        normal = weighted.T @ jacobian
        gradient = weighted.T @ residuals
        if prior is not None:
            known = scale**2 * prior.precision
            gradient = gradient + known @ (coefficients - prior.mean)
        ridge = 1e-6 * np.trace(normal) / len(start) * np.eye(len(start))
        step = solve_symmetric(normal + known + ridge, gradient)
        coefficients = coefficients - step
        if np.abs(step).max() < SETTLED_M:
            break
    return RobustFit(
        coefficients=coefficients,
        information=normal / scale**2,
        scale=scale,
        inliers=int(np.count_nonzero(np.abs(residuals) <= INLIER_LOSSES * CAUCHY_M)),
    )
