"""A single-stem herb of 0.7 m: pairs of ovate leaves, each turned by a right angle against the pair below."""

from functools import cache

import numpy as np

from nerfmodal.simulate.blades import blade
from nerfmodal.simulate.leaves import LeafForm, LeafSurface
from nerfmodal.simulate.patches import Patch, blotches, join, rod_masses, tube
from nerfmodal.simulate.plants import STATIONS, Organ, Plant, along_line, assemble, flat_region, upright_region

HEIGHT = 0.70
FOOT_RADIUS, TOP_RADIUS = 0.011, 0.006
NODES = ((0.34, 0.30), (0.62, 0.27), (0.86, 0.22))
"""Where on the stem pairs of leaves stand (share of its length), and how long they are (m)."""
STEM_GREEN, STEM_RED = np.array([0.13, 0.25, 0.06]), np.array([0.16, 0.07, 0.05])
DENSITY = 950.0
"""kg/m³ of a juicy stem."""
LEAF_ROOM_FROM = 0.05
"""A leaf's region begins this far (m) from the stem."""
ROOM = 0.05
"""How far (m) an organ may swing and still lie in its region."""


@cache
def herb() -> Plant:
    """The herb: organs `leaf_0` … `leaf_5` from below, and `stem`."""
    s = np.linspace(0, 1, STATIONS)
    line = np.stack([0.03 * s**2, 0.02 * np.sin(2.2 * s), HEIGHT * s], axis=1)
    leaves, organs = [], []
    for index in range(2 * len(NODES)):
        at, length = NODES[index // 2]
        yaw = (np.pi / 2 * (index // 2) + np.pi * (index % 2) + 0.3) % (2 * np.pi)
        surface = LeafSurface(form=_form(length, index), base=along_line(line, np.array([at]))[0], yaw=yaw)
        leaf = blade(surface, np.random.default_rng([0, index]))
        outer = leaf.vertices[np.linalg.norm(leaf.vertices[:, :2] - surface.base[:2], axis=1) > LEAF_ROOM_FROM]
        leaves.append(leaf)
        organs.append(
            Organ(
                name=f"leaf_{index}",
                kind="leaf",
                region=flat_region(outer, yaw, ROOM),
                line=surface.rachis(s),
                side=surface.sideways,
                parent="stem",
                at=at,
            )
        )
    stem = _stem(line)
    trunk = Organ(
        name="stem",
        kind="stem",
        region=upright_region(stem, HEIGHT - 0.02, ROOM),
        line=line,
        side=np.array([1.0, 0.0, 0.0]),
        direction=(1.0, 0.0, 0.0),
    )
    return assemble([*leaves, _with_bud(stem, line)], (*organs, trunk))


def _form(length: float, index: int) -> LeafForm:
    """Lower leaves hang, upper ones stand."""
    return LeafForm(
        length=length,
        half_width=0.27 * length,
        start_deg=48.0 + 4 * index,
        end_deg=-42.0 + 7 * index,
        sag=0.22,
    )


def _stem(line: np.ndarray) -> Patch:
    s, sides = np.linspace(0, 1, len(line)), 12
    radii = FOOT_RADIUS + (TOP_RADIUS - FOOT_RADIUS) * s
    for at, _ in NODES:
        radii = radii + 0.003 * np.exp(-(((s - at) / 0.012) ** 2))
    side, front = np.tile([1.0, 0.0, 0.0], (len(s), 1)), np.tile([0.0, 1.0, 0.0], (len(s), 1))
    vertices, triangles = tube(line, radii, side, front, sides)
    red = np.clip(0.7 - np.repeat(s, sides) + 0.3 * blotches(vertices, np.random.default_rng(1), 0.01, 0.06), 0, 1)
    return Patch(
        vertices=vertices,
        triangles=triangles,
        colors=(1 - red[:, None]) * STEM_GREEN + red[:, None] * STEM_RED,
        along=np.repeat(s, sides),
        across=vertices[:, 0] - np.repeat(line[:, 0], sides),
        masses=rod_masses(line, np.pi * radii**2, DENSITY, sides),
    )


def _with_bud(stem: Patch, line: np.ndarray) -> Patch:
    """The stem with young leaves on its tip, which move with it."""
    bud = []
    for index in range(4):
        form = LeafForm(length=0.075, half_width=0.02, start_deg=74.0, end_deg=28.0, sag=0.1)
        surface = LeafSurface(form=form, base=line[-1], yaw=np.pi / 2 * index + 0.75)
        leaf = blade(surface, np.random.default_rng([1, index]), rows=13, columns=7)
        still = np.ones(len(leaf.along))
        bud.append(
            Patch(
                vertices=leaf.vertices,
                triangles=leaf.triangles,
                colors=leaf.colors * 1.25,
                along=still,
                across=leaf.vertices[:, 0] - line[-1, 0],
                masses=leaf.masses,
            )
        )
    return join([stem, *bud])
