"""Procedural plants as numbers: triangles, colours, organs and where each vertex lies on its organ. No Blender here.

The açai palm is that of the paper's simulation: 2.59 m high, 1.61 m wide, five pinnate leaves of 0.98 m.
"""

from dataclasses import dataclass, replace
from functools import cache
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float
from scipy.optimize import brentq

from nerfmodal.geometry.frames import frame_of_box
from nerfmodal.simulate.leaves import LeafForm, LeafSurface, pinnate_leaf
from nerfmodal.simulate.patches import Patch, join
from nerfmodal.simulate.stems import StemForm, palm_stem
from nerfmodal.spec import Box, OrientedBox
from nerfmodal.types import Mesh

OrganKind = Literal["leaf", "stem"]
MOTION_ROOM = 0.08
"""How far (m) an organ may swing and still lie in its region."""
GROUND_ROOM = 0.02
"""The regions begin this high (m), so that the ground is in none of them."""
LEAF_ROOM_FROM = 0.2
"""A leaf's region begins this far (m) from the crown's axis: nearer, neighbours and stem touch."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Organ:
    """A leaf or a stem of a plant, and the box its points stay in."""

    name: str
    kind: OrganKind
    region: OrientedBox


@dataclass(frozen=True, slots=True, kw_only=True)
class Plant:
    """A plant at rest. `along` is s in 0..1 from an organ's fixed end, `across` metres off its axis."""

    mesh: Mesh
    along: Float[np.ndarray, " vertices"]
    across: Float[np.ndarray, " vertices"]
    organs: tuple[Organ, ...]
    region: Box

    @property
    def regions(self) -> dict[str, OrientedBox]:
        """The region of each organ by its name."""
        return {organ.name: organ.region for organ in self.organs}

    def belongs(self, organ: str) -> Bool[np.ndarray, " vertices"]:
        """Which vertices are the organ's."""
        return self.mesh.organ == self.mesh.organs.index(organ)


@cache
def acai(height: float = 2.59, width: float = 1.61, leaf_length: float = 0.98, leaves: int = 5, seed: int = 0) -> Plant:
    """An açai palm of exactly this height and width (the larger of its x and y extents), metres.

    Raises `ValueError` where leaves of this length cannot reach this width.
    """
    end = brentq(lambda angle: _leaf_spread(angle, leaf_length, leaves, seed) - width, -89.0, -30.0, xtol=1e-6)
    crown = _leaf_patches(LeafForm(length=leaf_length, end_deg=float(end)), leaves, seed)
    top = height - max(float(leaf.vertices[:, 2].max()) for leaf in crown)
    raised = [replace(leaf, vertices=leaf.vertices + np.array([0.0, 0.0, top])) for leaf in crown]
    stem = palm_stem(StemForm(height=top), np.random.default_rng([seed, leaves]))
    names = (*(f"leaf_{index}" for index in range(leaves)), "trunk")
    regions = [_leaf_region(leaf, 2 * np.pi * index / leaves) for index, leaf in enumerate(raised)]
    kinds: list[OrganKind] = ["leaf" if index < leaves else "stem" for index in range(leaves + 1)]
    organs = tuple(
        Organ(name=name, kind=kind, region=region)
        for name, kind, region in zip(names, kinds, [*regions, _stem_region(stem, top)], strict=True)
    )
    return _assemble([*raised, stem], organs)


def _leaf_patches(form: LeafForm, leaves: int, seed: int) -> list[Patch]:
    """Leaves at equal angles around a crown at the origin."""
    yaws = 2 * np.pi * np.arange(leaves) / leaves
    surfaces = [LeafSurface(form=form, base=0.02 * np.array([np.cos(yaw), np.sin(yaw), 0]), yaw=yaw) for yaw in yaws]
    return [pinnate_leaf(surface, np.random.default_rng([seed, index])) for index, surface in enumerate(surfaces)]


def _leaf_spread(end_deg: float, length: float, leaves: int, seed: int) -> float:
    crown = join(_leaf_patches(LeafForm(length=length, end_deg=end_deg), leaves, seed))
    return float(np.ptp(crown.vertices[:, :2], axis=0).max())


def _leaf_region(leaf: Patch, yaw: float) -> OrientedBox:
    """A box along the leaf's chord with room for its motion up and down."""
    outer = leaf.vertices[np.hypot(leaf.vertices[:, 0], leaf.vertices[:, 1]) > LEAF_ROOM_FROM]
    outward = np.array([np.cos(yaw), np.sin(yaw), 0.0])
    slope = np.polyfit(outer @ outward, outer[:, 2], 1)[0]
    tilted = OrientedBox(
        center_m=(0.0, 0.0, 0.0),
        size_m=(1.0, 1.0, 1.0),
        yaw_deg=float(np.degrees(yaw)),
        pitch_deg=float(np.degrees(np.arctan(slope))),
    )
    frame = frame_of_box(tilted)
    local = frame.to_local(outer)
    room = np.array([0.04, 0.02, MOTION_ROOM + 0.02])
    low, high = local.min(axis=0) - room * np.array([0, 1, 1]), local.max(axis=0) + room
    center = frame.to_world((low + high)[None] / 2)[0]
    return tilted.model_copy(update={"center_m": _point(center), "size_m": _point(high - low)})


def _stem_region(stem: Patch, height: float) -> OrientedBox:
    """An upright box around the stem, x axis along it, from just above the ground to below the crown."""
    low, high = stem.vertices.min(axis=0) - MOTION_ROOM, stem.vertices.max(axis=0) + MOTION_ROOM
    bottom, top = GROUND_ROOM, height - 0.02
    center = np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, (bottom + top) / 2])
    size = np.array([top - bottom, high[1] - low[1], high[0] - low[0]])
    return OrientedBox(center_m=_point(center), size_m=_point(size), yaw_deg=0.0, pitch_deg=90.0)


def _assemble(patches: list[Patch], organs: tuple[Organ, ...]) -> Plant:
    whole = join(patches)
    mesh = Mesh(
        vertices=whole.vertices,
        triangles=whole.triangles,
        colors=whole.colors,
        organ=np.repeat(np.arange(len(patches)), [len(patch.vertices) for patch in patches]),
        organs=tuple(organ.name for organ in organs),
    )
    low = whole.vertices.min(axis=0) - MOTION_ROOM - 0.02
    high = whole.vertices.max(axis=0) + MOTION_ROOM + 0.02
    low[2] = GROUND_ROOM
    region = Box(min_m=_point(low), max_m=_point(high))
    return Plant(mesh=mesh, along=whole.along, across=whole.across, organs=organs, region=region)


def _point(values: Float[np.ndarray, " 3"]) -> tuple[float, float, float]:
    return (round(float(values[0]), 4), round(float(values[1]), 4), round(float(values[2]), 4))
