"""Structures whose modes are known in closed form: a tower (Euler and Bernoulli) and a cantilever plate (Kirchhoff).

Both are painted with a speckle, as surfaces are for digital image correlation: a plain one has nothing to see move.
"""

from functools import cache

import numpy as np
from jaxtyping import Float

from nerfmodal.simulate.patches import Patch, blotches, grid_triangles, rod_masses, tube
from nerfmodal.simulate.plants import STATIONS, Organ, Plant, assemble, flat_region, upright_region
from nerfmodal.simulate.plates import cantilever_plate
from nerfmodal.simulate.shapes import beam_frequency

TOWER_HEIGHT = 3.0
TOWER_RADIUS, TOWER_WALL = 0.0315, 0.003
"""A model mast of 63 mm PVC pipe, metres."""
PVC_MODULUS, PVC_DENSITY = 3.0e9, 1400.0
"""N/m², kg/m³."""
PLATE_LENGTH, PLATE_WIDTH, PLATE_THICKNESS = 1.2, 0.7, 0.003
"""An aluminium sheet that stands out from a post, metres."""
PLATE_ABOVE_GROUND = 1.1
ALUMINIUM_MODULUS, ALUMINIUM_DENSITY, POISSON = 70e9, 2700.0, 0.3
RED, WHITE, CONCRETE = np.array([0.45, 0.04, 0.03]), np.array([0.52, 0.51, 0.48]), np.array([0.20, 0.19, 0.18])
YELLOW = np.array([0.62, 0.47, 0.10])
BAND = 0.5
"""Height of a band of paint, metres."""
CELL = 0.012
"""Side of the plate's triangles, metres: as fine as its speckle."""


def tower_frequency(order: int) -> float:
    """Natural frequency (Hz) of the tower's bending 1, 2 or 3."""
    inner = TOWER_RADIUS - TOWER_WALL
    stiffness = PVC_MODULUS * np.pi / 4 * (TOWER_RADIUS**4 - inner**4)
    return beam_frequency(order, TOWER_HEIGHT, float(stiffness), PVC_DENSITY * _tower_area())


def plate_frequency(order: int) -> float:
    """Natural frequency (Hz) of the plate's mode 1 to 6: bending, torsion, bending …"""
    rigidity = ALUMINIUM_MODULUS * PLATE_THICKNESS**3 / (12 * (1 - POISSON**2))
    modes = cantilever_plate(PLATE_WIDTH / PLATE_LENGTH)
    return modes.frequency(order, PLATE_LENGTH, rigidity, ALUMINIUM_DENSITY * PLATE_THICKNESS)


@cache
def tower() -> Plant:
    """A mast of 3 m that is clamped in the ground, its one organ `mast`."""
    s, sides = np.linspace(0, 1, STATIONS), 24
    line = np.outer(s * TOWER_HEIGHT, [0.0, 0.0, 1.0])
    side, front = np.tile([1.0, 0.0, 0.0], (len(s), 1)), np.tile([0.0, 1.0, 0.0], (len(s), 1))
    vertices, triangles = tube(line, np.full(len(s), TOWER_RADIUS), side, front, sides)
    last = np.arange(len(vertices) - sides, len(vertices))
    lid = np.stack([last, np.roll(last, -1), np.full(sides, len(vertices))], axis=1)
    closed = np.concatenate([vertices, line[-1:]])
    areas = np.full(len(s), _tower_area())
    mast = Patch(
        vertices=closed,
        triangles=np.concatenate([triangles, lid]),
        colors=_banded(closed, np.random.default_rng(0)),
        along=np.append(np.repeat(s, sides), 1.0),
        across=closed[:, 0].copy(),
        masses=np.append(rod_masses(line, areas, PVC_DENSITY, sides), 0.0),
    )
    organ = Organ(
        name="mast",
        kind="stem",
        region=upright_region(mast, TOWER_HEIGHT - 0.02),
        line=line,
        side=np.array([1.0, 0.0, 0.0]),
        direction=(1.0, 0.0, 0.0),
    )
    return assemble([mast], (organ,))


@cache
def plate() -> Plant:
    """A sheet of 1.2 x 0.7 m that a post holds by one edge, its one organ `sheet`; s runs along +x."""
    rows, columns = round(PLATE_LENGTH / CELL) + 1, round(PLATE_WIDTH / CELL) + 1
    s, y = np.meshgrid(np.linspace(0, 1, rows), np.linspace(-PLATE_WIDTH / 2, PLATE_WIDTH / 2, columns), indexing="ij")
    start = np.array([-PLATE_LENGTH / 2, 0.0, PLATE_ABOVE_GROUND])
    vertices = start + np.stack([PLATE_LENGTH * s.ravel(), y.ravel(), np.zeros(s.size)], axis=1)
    shares = np.outer(_trapezoid(rows), _trapezoid(columns)).ravel()
    sheet = Patch(
        vertices=vertices,
        triangles=grid_triangles(rows, columns)[:, ::-1],  # facing up, where the light comes from
        colors=_speckled(vertices, np.random.default_rng(0)),
        along=s.ravel(),
        across=y.ravel(),
        masses=ALUMINIUM_DENSITY * PLATE_THICKNESS * PLATE_LENGTH * PLATE_WIDTH * shares,
    )
    organ = Organ(
        name="sheet",
        kind="plate",
        region=flat_region(vertices, 0.0),
        line=start + np.outer(np.linspace(0, 1, STATIONS) * PLATE_LENGTH, [1.0, 0.0, 0.0]),
        side=np.array([0.0, 1.0, 0.0]),
    )
    return assemble([sheet], (organ,), stand=_post())


def _post() -> Patch:
    """A concrete pillar behind the sheet's fixed edge."""
    low = np.array([-PLATE_LENGTH / 2 - 0.14, -PLATE_WIDTH / 2 - 0.02, 0.0])
    high = np.array([-PLATE_LENGTH / 2, PLATE_WIDTH / 2 + 0.02, PLATE_ABOVE_GROUND + 0.03])
    corners = np.array([[x, y, z] for z in (0, 1) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))])
    vertices, count = low + corners * (high - low), 8
    quads = np.array([[0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7], [4, 5, 6, 7]])
    # faces of their own, so that edges are not shaded round
    faces = vertices[quads].reshape(-1, 3)
    first = 4 * np.arange(len(quads))[:, None]
    triangles = np.concatenate([first + np.array([0, 1, 2]), first + np.array([0, 2, 3])])
    grey = CONCRETE * (1 + 0.1 * blotches(faces, np.random.default_rng(count), 0.2, 0.6)[:, None])
    still = np.zeros(len(faces))
    return Patch(vertices=faces, triangles=triangles, colors=grey, along=still, across=still, masses=still)


def _tower_area() -> float:
    return float(np.pi * (TOWER_RADIUS**2 - (TOWER_RADIUS - TOWER_WALL) ** 2))


def _banded(points: Float[np.ndarray, "points 3"], random: np.random.Generator) -> Float[np.ndarray, "points 3"]:
    """Red and white bands with dark speckles."""
    red = (points[:, 2] // BAND % 2 == 0)[:, None]
    speckles = (blotches(points, random, 0.03, 0.09) > 0.9)[:, None]
    return np.where(red, RED, WHITE) * np.where(speckles, 0.25, 1.0)


def _speckled(points: Float[np.ndarray, "points 3"], random: np.random.Generator) -> Float[np.ndarray, "points 3"]:
    """Black spots of a few centimetres on yellow, on both sides alike."""
    spots = blotches(points, random, 0.04, 0.12)[:, None] > 0.4
    return np.where(spots, 0.04, YELLOW)


def _trapezoid(count: int) -> Float[np.ndarray, " points"]:
    """Shares of equally spaced points in an integral."""
    weights = np.ones(count)
    weights[[0, -1]] = 0.5
    return weights / (count - 1)
