"""A leaf: heights over its own plane as a sum of basis functions (by default the paper's `poly55`, 21 terms)."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

from nerfmodal.geometry.frames import LocalFrame
from nerfmodal.surface.basis import Basis, basis_around, spline_around
from nerfmodal.surface.outline import Outline, place_sensors, trace_outline
from nerfmodal.surface.plane import plane_frame
from nerfmodal.surface.robust import Prior, RobustFit, fit_robustly

SheetKind = Literal["polynomial", "tensor", "spline"]
ON_SURFACE_SDS = 4.0
"""Pooled points within this many robust scales of the pooled surface (its motion included) draw the outline."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SheetSurface:
    """What stays fixed through the record: the frame, the basis, the outline and the sensors' (x, y)."""

    frame: LocalFrame
    basis: Basis
    outline: Outline
    sensors: Float[np.ndarray, "sensors 2"]

    @property
    def directions(self) -> Float[np.ndarray, "1 3"]:
        """Displacement is measured along the normal of the leaf's plane."""
        return self.frame.axes[:, 2][None, :]

    @property
    def size(self) -> int:
        """Number of coefficients: the terms of the polynomial."""
        return self.basis.terms

    def fit(
        self,
        points: Float[np.ndarray, "points 3"],
        *,
        start: Float[np.ndarray, " coefficients"] | None = None,
        prior: Prior | None = None,
    ) -> RobustFit | None:
        """The coefficients of one frame's points (world, metres); None without more points than terms."""
        local = self.frame.to_local(points)
        local = local[self.basis.contains(local[:, :2])]
        if len(local) <= self.basis.terms:
            return None
        return fit_robustly(self.basis.evaluate(local[:, :2]), local[:, 2], start=start, prior=prior)

    def displacement_basis(self) -> Float[np.ndarray, "dofs terms"]:
        """B of D = C Bᵀ: the basis at the sensors."""
        return self.basis.evaluate(self.sensors)

    def positions(self, coefficients: Float[np.ndarray, " terms"]) -> Float[np.ndarray, "sensors 3"]:
        """Where the sensors are (world, metres) when the surface has these coefficients."""
        heights = self.displacement_basis() @ coefficients
        return self.frame.to_world(np.column_stack([self.sensors, heights]))


def choose_sheet(
    pooled: Float[np.ndarray, "points 3"], *, kind: SheetKind = "polynomial", degree: int, sensors: int
) -> SheetSurface:
    """The fixed parts, from points pooled over the record. Raises `InvalidClouds` if they lie on a line."""
    frame = plane_frame(pooled)
    local = frame.to_local(pooled)
    rough = basis_around(trace_outline(local[:, :2]).corners(), degree)
    local = local[rough.contains(local[:, :2])]
    design = rough.evaluate(local[:, :2])
    fit = fit_robustly(design, local[:, 2])
    near = np.abs(local[:, 2] - design @ fit.coefficients) <= ON_SURFACE_SDS * fit.scale
    outline = trace_outline(local[near, :2])
    return SheetSurface(
        frame=frame,
        basis=_basis(kind, outline, degree, local[near, :2]),
        outline=outline,
        sensors=place_sensors(outline, sensors),
    )


def _basis(kind: SheetKind, outline: Outline, degree: int, points: Float[np.ndarray, "points 2"]) -> Basis:
    if kind == "spline":
        return spline_around(outline.corners(), degree, points[outline.contains(points)])
    return basis_around(outline.corners(), degree, tensor=kind == "tensor")
