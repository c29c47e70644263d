"""Simple leaves: a stalk and one blade on the smooth surface P(s, y) of `leaves`, with a midrib and side veins."""

import numpy as np
from jaxtyping import Float

from nerfmodal.simulate.leaves import LeafSurface
from nerfmodal.simulate.patches import Patch, grid_triangles

GREEN, VEIN = np.array([0.055, 0.20, 0.035]), np.array([0.16, 0.34, 0.09])
MASS_PER_AREA = 0.22
"""kg/m² of a fresh leaf."""
STALK_SHARE = 0.16
"""Share of the length that is a bare stalk."""


def blade(surface: LeafSurface, random: np.random.Generator, *, rows: int = 29, columns: int = 11) -> Patch:
    """An ovate leaf; `random` varies its green."""
    form = surface.form
    s, edge = np.meshgrid(np.linspace(0, 1, rows), np.linspace(-1, 1, columns), indexing="ij")
    half = form.half_width * _ovate(s[:, 0])
    y = edge * half[:, None]
    flat_s, flat_y = s.ravel(), y.ravel()
    fold = 0.10 * np.abs(flat_y)  # the halves rise from the midrib
    wave = 0.04 * form.half_width * np.sin(16 * flat_s + 2 * np.sign(flat_y)) * np.abs(edge.ravel()) ** 2
    lift = (fold + wave)[:, None] * surface.normals(flat_s)
    area = form.length / (rows - 1) * 2 * half / columns
    return Patch(
        vertices=surface.points(flat_s, flat_y) + lift,
        triangles=grid_triangles(rows, columns)[:, ::-1],  # facing up, where the light comes from
        colors=_veined(flat_s, edge.ravel(), random),
        along=flat_s,
        across=flat_y,
        masses=MASS_PER_AREA * np.repeat(area, columns),
    )


def _ovate(s: Float[np.ndarray, " points"]) -> Float[np.ndarray, " points"]:
    """Half width along a leaf as a share of the largest: a thin stalk, widest at a third of the blade, a point."""
    t = np.clip((s - STALK_SHARE) / (1 - STALK_SHARE), 0, 1)
    lobe = np.sin(np.pi * t**0.62) * (1 - 0.25 * t)
    return np.maximum(lobe / 0.93, 0.035 * (1 - s))


def _veined(
    s: Float[np.ndarray, " points"], edge: Float[np.ndarray, " points"], random: np.random.Generator
) -> Float[np.ndarray, "points 3"]:
    """Green with a pale midrib and side veins that run forward; one shade a leaf."""
    shade = GREEN * random.uniform(0.8, 1.35)
    midrib = np.exp(-((edge / 0.12) ** 2)) + (s < STALK_SHARE)
    sides = 0.35 * np.clip(np.cos(2 * np.pi * 8 * (s - 0.12 * np.abs(edge))), 0, 1) ** 4 * (np.abs(edge) < 0.95)
    pale = np.clip(midrib + sides, 0, 1)[:, None]
    return np.clip((1 - pale) * shade + pale * VEIN, 0, 1)
