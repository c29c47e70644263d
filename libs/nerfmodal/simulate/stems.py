"""Stems: a tapered cylinder along a slightly curved centreline, with the ring marks that fallen leaves leave."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from nerfmodal.simulate.patches import Patch, blotches, rod_masses, tube

BARK = np.array([0.23, 0.19, 0.15])
SHAFT = np.array([0.16, 0.27, 0.08])
DENSITY = 450.0
"""kg/m³ of a palm's stem."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StemForm:
    """What a stem looks like; metres. It stands on the ground and ends vertically above the origin."""

    height: float
    foot_radius: float = 0.062
    top_radius: float = 0.036
    curve: float = 0.09
    """How far the foot stands beside the top."""
    rings: float = 0.11
    """Distance of the ring marks."""
    shaft: float = 0.30
    """Length of the green crownshaft at the top."""


def palm_stem(form: StemForm, random: np.random.Generator) -> Patch:
    """The stem as a closed tube; `across` is the distance from its centreline along x."""
    s = np.linspace(0, 1, 101)
    sides = 20
    side, upper = np.tile([1.0, 0.0, 0.0], (len(s), 1)), np.tile([0.0, 1.0, 0.0], (len(s), 1))
    middle, radii = centerline(form, s), _radii(form, s)
    vertices, triangles = tube(middle, radii, side, upper, sides)
    cap = np.array([[0.0, 0.0, form.height + 0.01]])
    last = np.arange(len(vertices) - sides, len(vertices))
    lid = np.stack([last, np.roll(last, -1), np.full(sides, len(vertices))], axis=1)
    along = np.append(np.repeat(s, sides), 1.0)
    closed = np.concatenate([vertices, cap])
    return Patch(
        vertices=closed,
        triangles=np.concatenate([triangles, lid]),
        colors=_bark(form, closed, along, random),
        along=along,
        across=closed[:, 0] - np.interp(along, s, middle[:, 0]),
        masses=np.append(rod_masses(middle, np.pi * radii**2, DENSITY, sides), 0.0),
    )


def centerline(form: StemForm, s: Float[np.ndarray, " points"]) -> Float[np.ndarray, "points 3"]:
    """Points of the centreline; s is the share of the height."""
    lean = -form.curve * (1 - s) ** 2
    return np.stack([lean * 0.6, lean * 0.8, s * form.height], axis=1)


def _ring_marks(form: StemForm, s: Float[np.ndarray, " points"]) -> Float[np.ndarray, " points"]:
    """1 on a ring mark, 0 between them and on the smooth crownshaft."""
    height = s * form.height
    mark = np.exp(-((((height / form.rings + 0.5) % 1.0 - 0.5) / 0.17) ** 2))
    return mark * (height < form.height - form.shaft)


def _radii(form: StemForm, s: Float[np.ndarray, " rings"]) -> Float[np.ndarray, " rings"]:
    taper = form.foot_radius + (form.top_radius - form.foot_radius) * s
    flare = 0.025 * np.exp(-s * form.height / 0.06)
    swelling = 0.010 * np.exp(-(((form.height * (1 - s) - form.shaft) / 0.12) ** 2))
    return taper + flare + swelling + 0.002 * _ring_marks(form, s)


def _bark(
    form: StemForm,
    vertices: Float[np.ndarray, "vertices 3"],
    s: Float[np.ndarray, " vertices"],
    random: np.random.Generator,
) -> Float[np.ndarray, "vertices 3"]:
    """Grey-brown with dark rings and lichen blotches; green on the crownshaft."""
    green = np.clip((s * form.height - form.height + form.shaft) / 0.02, 0, 1)[:, None]
    color = (1 - green) * BARK + green * SHAFT
    color = color * (1 - 0.65 * _ring_marks(form, s)[:, None])
    spots = blotches(vertices, random)[:, None]
    return np.clip(color * (1 + 0.45 * spots * (1 - 0.6 * green)), 0, 1)
