"""A small tree of 2.4 m: a trunk, five branches that rise from it, and leaves on twigs along each branch."""

from functools import cache

import numpy as np
from jaxtyping import Float

from nerfmodal.simulate.blades import blade
from nerfmodal.simulate.leaves import LeafForm, LeafSurface
from nerfmodal.simulate.patches import Patch, blotches, join, rod_masses, tube
from nerfmodal.simulate.plants import STATIONS, Organ, Plant, along_line, assemble, flat_region, upright_region

HEIGHT = 2.0
FOOT_RADIUS, TOP_RADIUS = 0.042, 0.014
BRANCHES = ((0.46, 0.95, 34.0), (0.57, 0.90, 38.0), (0.68, 0.82, 42.0), (0.79, 0.72, 48.0), (0.90, 0.58, 54.0))
"""Where on the trunk (share of its length), how long (m), and how steep (degrees) each branch begins."""
GOLDEN = np.radians(137.5)
"""Turn from a branch to the next, and from a leaf to the next."""
LEAVES, TOP_LEAVES = 85, 70
TWIG = 0.11
"""How far (m) from its branch a leaf stands at most."""
BARK = np.array([0.20, 0.15, 0.11])
DENSITY = 700.0
"""kg/m³ of green wood."""
BOLE_ROOM = 0.05
"""The trunk's region ends this far (m) below the lowest branch: among leaves no cylinder fits."""
BRANCH_ROOM_FROM = 0.15
"""A branch's region begins this far (m) from the trunk."""


@cache
def tree() -> Plant:
    """The tree: organs `branch_0` … `branch_4` from below, with their leaves, and `trunk`."""
    s = np.linspace(0, 1, STATIONS)
    line = np.stack([0.05 * np.sin(3 * s), 0.04 * s * (1 - s), HEIGHT * s], axis=1)
    patches, organs = [], []
    for index, (at, length, rise) in enumerate(BRANCHES):
        yaw = float(index * GOLDEN % (2 * np.pi))
        middle = along_line(line, np.array([at]))[0] + _branch_line(s, length, np.radians(rise), yaw)
        wood = _wood(middle, 0.013, 0.004, np.random.default_rng([2, index]))
        branch = join([wood, *_foliage(middle, np.linspace(0.22, 1.0, LEAVES), np.random.default_rng([3, index]))])
        outer = wood.vertices[np.linalg.norm(wood.vertices[:, :2] - middle[0, :2], axis=1) > BRANCH_ROOM_FROM]
        patches.append(branch)
        organs.append(
            Organ(
                name=f"branch_{index}",
                kind="branch",
                region=flat_region(outer, yaw),
                line=middle,
                side=np.array([-np.sin(yaw), np.cos(yaw), 0.0]),
                parent="trunk",
                at=at,
            )
        )
    wood = _wood(line, FOOT_RADIUS, TOP_RADIUS, np.random.default_rng(4))
    trunk = Organ(
        name="trunk",
        kind="stem",
        region=upright_region(wood, BRANCHES[0][0] * HEIGHT - BOLE_ROOM),
        line=line,
        side=np.array([1.0, 0.0, 0.0]),
        direction=(1.0, 0.0, 0.0),
    )
    top = join([wood, *_foliage(line, np.linspace(0.84, 1.0, TOP_LEAVES), np.random.default_rng(5))])
    return assemble([*patches, top], (*organs, trunk))


def _branch_line(
    s: Float[np.ndarray, " stations"], length: float, rise: float, yaw: float
) -> Float[np.ndarray, "stations 3"]:
    """An arc that begins at `rise` radians and levels out by half of it; its length is exact."""
    end = 0.5 * rise
    angle = rise + (end - rise) * s
    reach = (np.sin(angle) - np.sin(rise)) / (end - rise)
    height = (np.cos(rise) - np.cos(angle)) / (end - rise)
    outward = np.array([np.cos(yaw), np.sin(yaw), 0.0])
    return length * (np.outer(reach, outward) + np.outer(height, [0.0, 0.0, 1.0]))


def _wood(line: Float[np.ndarray, "stations 3"], foot: float, top: float, random: np.random.Generator) -> Patch:
    """A tapered tube with furrowed bark, and its foot a little wider."""
    s, sides = np.linspace(0, 1, len(line)), 12
    radii = foot + (top - foot) * s + 0.3 * foot * np.exp(-s / 0.02)
    tangents = np.gradient(line, axis=0)
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
    aside = np.array([0.0, 1.0, 0.0]) if abs(tangents[0, 1]) < 0.9 else np.array([1.0, 0.0, 0.0])
    front = np.cross(tangents, np.cross(aside, tangents))
    front /= np.linalg.norm(front, axis=1, keepdims=True)
    side = np.cross(front, tangents)
    vertices, triangles = tube(line, radii, side, front, sides)
    bark = BARK * (1 + 0.4 * blotches(vertices * [1, 1, 0.3], random, 0.02, 0.08)[:, None])
    return Patch(
        vertices=vertices,
        triangles=triangles,
        colors=np.clip(bark, 0.02, 1),
        along=np.repeat(s, sides),
        across=np.tile(np.cos(2 * np.pi * np.arange(sides) / sides), len(s)) * np.repeat(radii, sides),
        masses=rod_masses(line, np.pi * radii**2, DENSITY, sides),
    )


def _foliage(
    line: Float[np.ndarray, "stations 3"], stands: Float[np.ndarray, " leaves"], random: np.random.Generator
) -> list[Patch]:
    """Leaves on twigs around a branch; each moves as the place that its twig stands on."""
    leaves = []
    for index, (at, base) in enumerate(zip(stands, along_line(line, stands), strict=True)):
        length = 0.14 * random.uniform(0.7, 1.1)
        start, yaw = random.uniform(-5, 50), index * GOLDEN + random.uniform(-0.4, 0.4)
        twig = TWIG * random.uniform(0, 1) * np.array([np.cos(yaw), np.sin(yaw), random.uniform(-0.2, 0.9)])
        form = LeafForm(
            length=length,
            half_width=0.27 * length,
            start_deg=start,
            end_deg=start - random.uniform(45, 80),
            sag=0.2,
        )
        surface = LeafSurface(form=form, base=base + twig, yaw=float(yaw))
        leaf = blade(surface, random, rows=9, columns=5)
        leaves.append(
            Patch(
                vertices=leaf.vertices,
                triangles=leaf.triangles,
                colors=leaf.colors,
                along=np.full(len(leaf.along), at),
                across=np.zeros(len(leaf.along)),
                masses=leaf.masses,
            )
        )
    return leaves
