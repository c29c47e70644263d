"""Pinnate leaves: a drooping rachis and separate leaflets that lie on one smooth surface P(s, y).

The rachis leaves the crown at `start_deg` above the horizon and bends steadily to `end_deg`; its length is exact.
A leaflet is a narrow lanceolate strip, angled forward off the rachis and slightly folded along its middle.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from nerfmodal.simulate.patches import Patch, grid_triangles, join, rod_masses, tube

STATIONS = 7
"""Cross sections of a leaflet."""
FIRST_LEAFLET, LAST_LEAFLET = 0.13, 0.97
"""Where on the rachis leaflets stand: below is the bare petiole."""
GREEN = np.array([0.10, 0.27, 0.045])
STALK = np.array([0.22, 0.33, 0.08])
DENSITY = 600.0
"""kg/m³ of a rachis."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LeafForm:
    """What a leaf looks like. Lengths in metres, angles above the horizon in degrees."""

    length: float = 0.98
    half_width: float = 0.18
    start_deg: float = 68.0
    end_deg: float = -51.0
    leaflets_per_side: int = 20
    cover: float = 0.92
    """Width of a leaflet at its widest, as a share of the room it has."""
    sag: float = 0.25
    """How far the edge hangs below the rachis, as a share of the half width."""
    leaflet_mass: float = 0.002
    """kg"""


@dataclass(frozen=True, slots=True, kw_only=True)
class LeafSurface:
    """The smooth surface P(s, y) that a leaf's leaflets lie on."""

    form: LeafForm
    base: Float[np.ndarray, " 3"]
    yaw: float

    @property
    def outward(self) -> Float[np.ndarray, " 3"]:
        """Horizontal unit vector from the crown to the tip."""
        return np.array([np.cos(self.yaw), np.sin(self.yaw), 0.0])

    @property
    def sideways(self) -> Float[np.ndarray, " 3"]:
        """Horizontal unit vector across the leaf, the direction of +y."""
        return np.array([-np.sin(self.yaw), np.cos(self.yaw), 0.0])

    def normals(self, s: Float[np.ndarray, " points"]) -> Float[np.ndarray, "points 3"]:
        """Unit normals of the rachis, on the leaf's upper side."""
        angle = self._angles(s)[:, None]
        return np.cos(angle) * np.array([0.0, 0.0, 1.0]) - np.sin(angle) * self.outward

    def rachis(self, s: Float[np.ndarray, " points"]) -> Float[np.ndarray, "points 3"]:
        """Points of the rachis; s is the share of its arc length."""
        start, turn = np.radians(self.form.start_deg), np.radians(self.form.end_deg - self.form.start_deg)
        reach = (np.sin(start + turn * s) - np.sin(start)) / turn
        rise = (np.cos(start) - np.cos(start + turn * s)) / turn
        up = np.array([0.0, 0.0, 1.0])
        return self.base + self.form.length * (reach[:, None] * self.outward + rise[:, None] * up)

    def points(self, s: Float[np.ndarray, " points"], y: Float[np.ndarray, " points"]) -> Float[np.ndarray, "points 3"]:
        """Points of the surface at s along and y metres across; the edges sag with y squared."""
        drop = self.form.sag * y**2 / self.form.half_width
        return self.rachis(s) + y[:, None] * self.sideways - drop[:, None] * self.normals(s)

    def _angles(self, s: Float[np.ndarray, " points"]) -> Float[np.ndarray, " points"]:
        return np.radians(self.form.start_deg + (self.form.end_deg - self.form.start_deg) * s)


def pinnate_leaf(surface: LeafSurface, random: np.random.Generator) -> Patch:
    """A leaf of separate leaflets; `random` varies the leaflets' length, tilt and green."""
    stands = np.linspace(FIRST_LEAFLET, LAST_LEAFLET, surface.form.leaflets_per_side)
    leaflets = [_leaflet(surface, float(stand), side, random) for side in (-1, 1) for stand in stands]
    return join([_rachis(surface), *leaflets])


def outline(form: LeafForm, stand: float) -> float:
    """How far across the leaf (metres) the leaflet that stands at s = `stand` reaches."""
    share = (stand - FIRST_LEAFLET) / (LAST_LEAFLET - FIRST_LEAFLET)
    return float(form.half_width * (0.5 + 0.5 * np.sin(np.pi * min(0.5, 1.4 * share))) * (1 - 0.62 * share**4))


def _leaflet(surface: LeafSurface, stand: float, side: int, random: np.random.Generator) -> Patch:
    form = surface.form
    reach = outline(form, stand) * random.uniform(0.93, 1.0)
    angle = np.radians(66.0 - 34.0 * stand + random.uniform(-3, 3))
    forward = min(reach / np.tan(angle), (1 - stand) * form.length)
    t = np.linspace(0.0, 1.0, STATIONS)
    middle_s, middle_y = stand + t * forward / form.length, side * t * reach
    room = (LAST_LEAFLET - FIRST_LEAFLET) * form.length / (form.leaflets_per_side - 1) * np.sin(angle)
    half = 0.5 * form.cover * room * _lanceolate(t)
    # turned by the side so that the triangles of both halves face up
    across = np.array([side * reach, -forward]) / np.hypot(reach, forward)
    s = np.clip(np.stack([middle_s + k * half * across[0] / form.length for k in (-1, 0, 1)], axis=1), 0, 1).ravel()
    y = np.stack([middle_y + k * half * across[1] for k in (-1, 0, 1)], axis=1).ravel()
    tilt = random.uniform(0.05, 0.35)
    lift = np.stack([-tilt * half, -0.25 * half, tilt * half], axis=1).ravel()
    return Patch(
        vertices=surface.points(s, y) + lift[:, None] * surface.normals(s),
        triangles=grid_triangles(STATIONS, 3),
        colors=_greens(t, random),
        along=s,
        across=y,
        masses=np.full(len(s), form.leaflet_mass / len(s)),
    )


def _lanceolate(t: Float[np.ndarray, " stations"]) -> Float[np.ndarray, " stations"]:
    """Width of a leaflet along it: a stalk, widest at 0.35, a point."""
    return np.maximum(np.sin(np.pi * (0.13 + 0.87 * t) ** 0.75) ** 0.8, 0.0)


def _greens(t: Float[np.ndarray, " stations"], random: np.random.Generator) -> Float[np.ndarray, "vertices 3"]:
    """One green per leaflet, yellower at the tip, paler along the middle."""
    shade = GREEN * random.uniform(0.6, 1.5) + np.array([0.05, 0.03, 0.0]) * random.uniform(0, 1)
    along = shade + t[:, None] ** 3 * np.array([0.10, 0.05, 0.0])
    columns = np.stack([along, along * 1.25, along * 0.9], axis=1)
    return np.clip(columns.reshape(-1, 3), 0, 1)


def _rachis(surface: LeafSurface) -> Patch:
    s = np.linspace(0, 1, 25)
    radii = 0.013 * (1 - s) + 0.0025
    across = np.tile(surface.sideways, (len(s), 1))
    sides = 6
    middle = surface.rachis(s)
    vertices, triangles = tube(middle, radii, across, surface.normals(s), sides)
    return Patch(
        vertices=vertices,
        triangles=triangles,
        colors=np.repeat(STALK * (1 - 0.4 * s[:, None]) + 0.4 * s[:, None] * GREEN, sides, axis=0),
        along=np.repeat(s, sides),
        across=(vertices - np.repeat(middle, sides, axis=0)) @ surface.sideways,
        masses=rod_masses(middle, np.pi * radii**2, DENSITY, sides),
    )
