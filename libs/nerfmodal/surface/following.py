"""An organ followed frame by frame while the record is still being taken.

The surface is chosen from the first frames and stays: each further frame costs one robust fit, and gives the few
numbers that `identify.GrowingRecord` keeps of it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from nerfmodal.spec import OrganSpec
from nerfmodal.surface.robust import RobustFit
from nerfmodal.surface.sensors import Surface
from nerfmodal.surface.track import _choose, _enough, _points_of, _pool
from nerfmodal.types import PointCloud


@dataclass(frozen=True, slots=True, kw_only=True)
class Follower:
    """An organ and the surface that was chosen for it."""

    organ: OrganSpec
    surface: Surface

    def measure(self, cloud: PointCloud, index: int) -> RobustFit | None:
        """What frame `index` says of the coefficients that displace; None if it has fewer than 300 good points.

        Raises `InvalidClouds` if a point is no number.
        """
        fit = _enough(self.surface.fit(_points_of(self.organ, cloud, index)))
        if fit is None:
            return None
        terms = self.surface.displacement_basis().shape[1]
        return RobustFit(
            coefficients=fit.coefficients[:terms],
            information=_marginal(fit.information, terms),
            scale=fit.scale,
            inliers=fit.inliers,
        )


def follow(organ: OrganSpec, clouds: Sequence[PointCloud | None], rng: np.random.Generator) -> Follower:
    """Choose the organ's surface from the frames that are there: a period of the slowest mode shows its whole swing.

    Raises `InvalidClouds` as `measure_organ` does.
    """
    chosen = [None if cloud is None else _points_of(organ, cloud, index) for index, cloud in enumerate(clouds)]
    return Follower(organ=organ, surface=_choose(organ, _pool(organ, chosen, clouds, rng)))


def _marginal(
    information: Float[np.ndarray, "coefficients coefficients"], terms: int
) -> Float[np.ndarray, "terms terms"]:
    """Information of the leading coefficients, whatever the others are (Schur's complement)."""
    if terms == len(information):
        return information
    cross, rest = information[:terms, terms:], information[terms:, terms:]
    return np.asarray(information[:terms, :terms] - cross @ np.linalg.pinv(rest, hermitian=True) @ cross.T)
