"""The açai palm of the paper's simulation (its Figure 4): 2.59 m high, 1.61 m wide, five pinnate leaves of 0.98 m."""

from dataclasses import replace
from functools import cache

import numpy as np
from jaxtyping import Float
from scipy.optimize import brentq

from nerfmodal.errors import InvalidSpec
from nerfmodal.simulate.leaves import LeafForm, LeafSurface, pinnate_leaf
from nerfmodal.simulate.patches import Patch, join
from nerfmodal.simulate.plants import STATIONS, Organ, Plant, assemble, flat_region, upright_region
from nerfmodal.simulate.stems import StemForm, centerline, palm_stem
from nerfmodal.spec import PalmSpec

LEAF_ROOM_FROM = 0.2
"""A leaf's region begins this far (m) from the crown's axis: nearer, neighbours and stem touch."""
BENDS_DEG = (-89.0, -30.0)
"""How far down a leaf's tip may point: this decides the palm's width."""
LEAST_STEM = 0.2
"""Metres."""


def acai(sizes: PalmSpec | None = None) -> Plant:
    """An açai palm of exactly this height and width (the larger of its x and y extents); by default the paper's.

    Raises `InvalidSpec` where leaves of this length cannot reach this width, or no stem is left below them.
    """
    return _grown(sizes or PalmSpec())


@cache
def _grown(form: PalmSpec) -> Plant:
    surfaces = _surfaces(form, _bend(form))
    crown = [_leaf(surface, form, index) for index, surface in enumerate(surfaces)]
    top = form.height_m - max(float(leaf.vertices[:, 2].max()) for leaf in crown)
    if top < LEAST_STEM:
        raise InvalidSpec(
            f"a crown of these leaves is {form.height_m - top:.2f} m high and leaves no stem.",
            where="/source/palm/height_m",
            hint=f"Use a height_m of at least {form.height_m - top + LEAST_STEM:.2f}, or shorter leaves.",
        )
    up = np.array([0.0, 0.0, top])
    raised = [replace(leaf, vertices=leaf.vertices + up) for leaf in crown]
    shape = StemForm(height=top)
    stem = palm_stem(shape, np.random.default_rng([form.seed, form.leaves]))
    s = np.linspace(0, 1, STATIONS)
    leaves = [
        Organ(
            name=f"leaf_{index}",
            kind="leaf",
            region=flat_region(_outer(leaf), surface.yaw),
            line=surface.rachis(s) + up,
            side=surface.sideways,
            parent="trunk",
        )
        for index, (leaf, surface) in enumerate(zip(raised, surfaces, strict=True))
    ]
    trunk = Organ(
        name="trunk",
        kind="stem",
        region=upright_region(stem, top - 0.02),
        line=centerline(shape, s),
        side=np.array([1.0, 0.0, 0.0]),
        direction=(1.0, 0.0, 0.0),
    )
    return assemble([*raised, stem], (*leaves, trunk))


def _surfaces(form: PalmSpec, end_deg: float) -> list[LeafSurface]:
    """Leaves at equal angles around a crown at the origin."""
    leaf = LeafForm(
        length=form.leaf_length_m,
        end_deg=end_deg,
        leaflets_per_side=form.leaflets_per_side,
        leaflet_mass=form.leaflet_mass_kg,
    )
    yaws = 2 * np.pi * np.arange(form.leaves) / form.leaves
    return [LeafSurface(form=leaf, base=0.02 * np.array([np.cos(yaw), np.sin(yaw), 0]), yaw=float(yaw)) for yaw in yaws]


def _leaf(surface: LeafSurface, form: PalmSpec, index: int) -> Patch:
    return pinnate_leaf(surface, np.random.default_rng([form.seed, index]))


def _bend(form: PalmSpec) -> float:
    """The angle (degrees) of the leaves' tips that makes the palm as wide as asked."""
    low, high = (_spread(form, angle) for angle in BENDS_DEG)
    if not low <= form.width_m <= high:
        raise InvalidSpec(
            f"leaves of {form.leaf_length_m:g} m make palms {low:.2f} to {high:.2f} m wide, not {form.width_m:g} m.",
            where="/source/palm/width_m",
            hint="Give a width between these, or another leaf_length_m.",
        )
    return float(brentq(lambda angle: _spread(form, angle) - form.width_m, *BENDS_DEG, xtol=1e-6))


def _spread(form: PalmSpec, end_deg: float) -> float:
    crown = join([_leaf(surface, form, index) for index, surface in enumerate(_surfaces(form, end_deg))])
    return float(np.ptp(crown.vertices[:, :2], axis=0).max())


def _outer(leaf: Patch) -> Float[np.ndarray, "points 3"]:
    return leaf.vertices[np.hypot(leaf.vertices[:, 0], leaf.vertices[:, 1]) > LEAF_ROOM_FROM]
