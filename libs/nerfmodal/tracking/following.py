"""One frame followed: every organ from coarse pictures to fine, and frame 0's points where they now are."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np
from jaxtyping import Bool, Float, UInt8

from nerfmodal.geometry.deformation import Deformation, deformation_of
from nerfmodal.tracking.alignment import Alignment, Pixels, align
from nerfmodal.tracking.pyramid import Level, levels_of, splines_of
from nerfmodal.tracking.reference import Reference
from nerfmodal.types import Camera, Frame

DECAYS = (0.35, 0.35, 0.35, 0.3)
"""Prior decay of the terms at each level, finest first: coarse pictures say little of high degrees."""
LEVELS = 4
"""Of pictures in which organs are short; longer ones get as many more as their length doubles `USUAL_LENGTH`."""
USUAL_LENGTH = 100.0
"""Pixels along an organ, up to which its motion is small against the coarsest of four levels."""
SHOWN = 0.05
"""A pixel whose smoothed opacity is less does not show the organ at that level."""
FEWEST_PIXELS = 200
MOST_PIXELS = 15_000
"""Of an organ on a level: more say little that is new."""
FEWEST_CAMERAS = 3
UNSURE_SHARE = 0.02
"""Standard deviation of the displacement, in lengths of the organ, beyond which nothing was seen of it."""
UNEXPLAINED = 0.5
"""What is left of the pictures, against the structure's own part of them, beyond which a frame is not explained."""


class Loss(Enum):
    """Why an organ could not be followed into a frame; the value says it in words."""

    OUT_OF_SIGHT = "Too few cameras see it."
    TEXTURELESS = "Nothing in the pictures says where it is: too little texture or contrast with the background."
    UNEXPLAINED = "No smooth motion explains the pictures: something hides it, or a camera was moved."


@dataclass(frozen=True, slots=True, kw_only=True)
class Followed:
    """Where frame 0's points are in a frame (world, m), how sure (m; infinite where lost), and what was lost why.

    `residual` is the largest misfit of an organ that was not lost, of 1.
    """

    points: Float[np.ndarray, "cloud 3"]
    stds: Float[np.ndarray, " cloud"]
    losses: dict[str, Loss]
    residual: float


def follow(
    reference: Reference,
    backgrounds: UInt8[np.ndarray, "cameras height width 3"],
    first: Frame,
    frame: Frame,
) -> Followed:
    """Move the points of frame 0 to where the pictures of `frame` show them."""
    images, said = _in_order_of(first, frame)
    organs = [_pixels_of(reference, number, said) for number in range(len(reference.organs))]
    count = _levels_for(first, organs)
    template = levels_of(np.concatenate([first.images, reference.opacity[..., None]], axis=-1), count)
    behind = splines_of(levels_of(backgrounds, count))
    pictures = splines_of(levels_of(images, count))
    points, stds = reference.cloud.copy(), np.full(len(reference.cloud), np.inf)
    losses: dict[str, Loss] = {}
    worst = 0.0
    for number, (name, pixels) in enumerate(zip(reference.organs, organs, strict=True)):
        mine = reference.owner == number
        deformation = _deformation(reference, number)
        if deformation is None or len(np.unique(pixels.camera)) < FEWEST_CAMERAS or len(pixels.camera) < FEWEST_PIXELS:
            losses[name] = Loss.OUT_OF_SIGHT
            continue
        found = _coarse_to_fine(pixels, template, behind, pictures, first.rig.cameras, deformation)
        basis = deformation.at(reference.cloud[mine])
        spread = _stds(basis, found)
        if (loss := _lost(found, spread, 2 * float(deformation.half[0]))) is not None:
            losses[name] = loss
            continue
        points[mine] += basis @ found.motion
        stds[mine] = spread
        worst = max(worst, found.residual)
    return Followed(points=points, stds=stds, losses=losses, residual=worst)


def _in_order_of(
    first: Frame, frame: Frame
) -> tuple[UInt8[np.ndarray, "cameras height width 3"], Bool[np.ndarray, "cameras height width"]]:
    """The frame's pictures in the order of frame 0's cameras, and which pixels say something in both."""
    number = {camera.name: index for index, camera in enumerate(frame.rig.cameras)}
    images, said = np.zeros_like(first.images), np.zeros(first.images.shape[:3], dtype=bool)
    for index, camera in enumerate(first.rig.cameras):
        if camera.name not in number:
            continue
        images[index], said[index] = frame.images[number[camera.name]], True
        if frame.counts is not None:
            said[index] &= frame.counts[number[camera.name]]
    return images, said if first.counts is None else said & first.counts


def _pixels_of(reference: Reference, number: int, said: Bool[np.ndarray, "cameras height width"]) -> Pixels:
    mine = (reference.organ == number) & said.reshape(-1)[reference.flat]
    camera, row, column = np.unravel_index(reference.flat[mine], said.shape)
    return Pixels(
        camera=camera,
        points=reference.points[mine].astype(float),
        centers=np.stack([column, row], axis=1) + 0.5,
        trust=reference.trust[mine],
        unrest=reference.unrest[mine],
    )


def _deformation(reference: Reference, number: int) -> Deformation | None:
    mine = reference.cloud[reference.owner == number]
    return deformation_of(mine) if len(mine) >= FEWEST_PIXELS else None


def _levels_for(first: Frame, organs: Sequence[Pixels]) -> int:
    lengths = [
        float(np.hypot(*np.ptp(one.centers[one.camera == camera], axis=0)))
        for one in organs
        for camera in np.unique(one.camera)
    ]
    typical = float(np.median(lengths)) if lengths else USUAL_LENGTH
    most = int(np.log2(min(first.images.shape[1:3]))) - 3
    return int(np.clip(LEVELS + round(np.log2(typical / USUAL_LENGTH)), min(LEVELS, most), max(most, 1)))


def _coarse_to_fine(
    pixels: Pixels,
    template: Sequence[Level],
    behind: Sequence[Level],
    pictures: Sequence[Level],
    cameras: tuple[Camera, ...],
    deformation: Deformation,
) -> Alignment:
    found: Alignment | None = None
    for level in reversed(range(len(template))):
        chosen = _at_level(pixels, template[level])
        if len(chosen.camera) < 3 * deformation.orders.size and level > 0:
            continue
        decay = DECAYS[min(level, len(DECAYS) - 1)]
        found = align(
            chosen, template[level], behind[level], pictures[level], cameras, deformation, start=found, decay=decay
        )
    assert found is not None
    return found


def _at_level(pixels: Pixels, template: Level) -> Pixels:
    """The pixels that exist at a level and show the organ there."""
    places = (pixels.centers - 0.5).astype(int)
    kept = np.flatnonzero((places % template.factor == 0).all(axis=1))
    columns, rows = (places[kept] // template.factor).T
    kept = kept[template.images[pixels.camera[kept], rows, columns, 3] > SHOWN]
    kept = kept[:: -(-len(kept) // MOST_PIXELS)] if len(kept) else kept
    return Pixels(
        camera=pixels.camera[kept],
        points=pixels.points[kept],
        centers=pixels.centers[kept],
        trust=pixels.trust[kept],
        unrest=pixels.unrest[kept],
    )


def _stds(basis: Float[np.ndarray, "points terms"], found: Alignment) -> Float[np.ndarray, " points"]:
    """Standard deviation of each point's displacement, root mean square over the three axes."""
    terms = basis.shape[1]
    covariance = found.covariance.reshape(3, terms, 3, terms)
    each = np.einsum("aiaj->ij", covariance) / 3
    return np.sqrt(np.maximum(np.einsum("pi,ij,pj->p", basis, each, basis), 0.0))


def _lost(found: Alignment, spread: Float[np.ndarray, " points"], length: float) -> Loss | None:
    if found.residual > UNEXPLAINED * found.contrast:
        return Loss.UNEXPLAINED
    if not np.isfinite(found.motion).all() or float(np.median(spread)) > UNSURE_SHARE * length:
        return Loss.TEXTURELESS
    return None
