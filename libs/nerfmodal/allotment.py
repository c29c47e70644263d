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


def _followed_as(
    organs: Sequence[OrganSpec], found: Found, organ: OrganSpec, clouds: Sequence[PointCloud | None]
) -> Sequence[PointCloud | None]:
    """The material points that were followed as this organ's, and not as those of another whose box they are in too.

    An organ to which others leave too few was given on top of them, and shares theirs.
    """
    points = next(one for one in clouds if one is not None).points
    inside = labelling([organ], found)(points) == 0
    mine = labelling(organs, found)(points) == list(organs).index(organ)
    kept = mine if mine.sum() >= surface.FEWEST_INLIERS else inside
    return [None if one is None else one.part(kept) for one in clouds]


def measuring(organs: Sequence[OrganSpec], found: Found) -> Measure:
    """`surface.measure_organ`, which sees of an organ that was found, or followed, only the points that are its own."""

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
        if surface.is_material(clouds):
            clouds = _followed_as(organs, found, organ, clouds)
        elif organ.name in found:
            clouds = [None if one is None else found[organ.name].select(one) for one in clouds]
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
