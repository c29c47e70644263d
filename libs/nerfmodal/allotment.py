"""Which points are which organ's: in boxes that are given, or found in the clouds themselves."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from jaxtyping import Float, Int

from nerfmodal import cloud, surface
from nerfmodal.geometry.frames import inside_box
from nerfmodal.identify.model import Measure
from nerfmodal.spec import OrganSpec, OrientedBox
from nerfmodal.types import PointCloud

Found = Mapping[str, cloud.FoundOrgan]
"""The space of each organ that was looked for, by its name."""


def find_organs(
    given: tuple[OrganSpec, ...], clouds: Sequence[PointCloud | None], seed: int
) -> tuple[tuple[OrganSpec, ...], Found]:
    """The organs that are measured, and the space of those that were looked for; nothing `given`: all that are found.

    Raises `InvalidClouds` when more organs of a kind are asked for than were found.
    """
    if given and all(organ.region != "auto" for organ in given):
        return given, {}
    found = cloud.find_organs(clouds, np.random.default_rng(seed))
    return (given, cloud.assign(given, found)) if given else cloud.specify(found)


def _selected(organ: cloud.FoundOrgan, clouds: Sequence[PointCloud | None]) -> list[PointCloud | None]:
    """The part of every cloud in an organ's space; of material points those that begin there."""
    if not surface.is_material(clouds):
        return [None if one is None else organ.select(one) for one in clouds]
    mine = organ.contains(next(one for one in clouds if one is not None).points)
    return [None if one is None else one.part(mine) for one in clouds]


def measuring(found: Found) -> Measure:
    """`surface.measure_organ`, which sees of an organ that was found only the points in its space."""

    def measure(
        organ: OrganSpec,
        clouds: Sequence[PointCloud | None],
        *,
        reference: surface.Reference,
        times: np.ndarray,
        frame_rate: float,
        rng: np.random.Generator,
        report: Callable[[int, int, str], None],
    ) -> surface.Track:
        if organ.name in found:
            clouds = _selected(found[organ.name], clouds)
        return surface.measure_organ(
            organ, clouds, reference=reference, times=times, frame_rate=frame_rate, rng=rng, report=report
        )

    return measure


def labelling(
    organs: Sequence[OrganSpec], found: Found
) -> Callable[[Float[np.ndarray, "places 3"]], Int[np.ndarray, " places"]]:
    """A function that gives the number of the organ that a place belongs to; -1 is nobody's. The first one takes it."""

    def whose(places: Float[np.ndarray, "places 3"]) -> Int[np.ndarray, " places"]:
        owner = np.full(len(places), -1)
        for number, organ in enumerate(organs):
            free = owner < 0
            if organ.name in found:
                owner[free & found[organ.name].contains(places)] = number
            elif isinstance(organ.region, OrientedBox):
                owner[free & inside_box(organ.region, places)] = number
            else:
                owner[free] = number
        return owner

    return whose
