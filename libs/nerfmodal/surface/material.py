"""Sensors among points that are material: each is followed by the points around it, along x, y and z.

Nothing is fitted anew: the surface of the first cloud only says where sensors are. The displacement of an organ's
points is smooth, so a few polynomials carry it to the sensors (least squares), whatever number these have.
"""

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Bool, Float

from nerfmodal.geometry.deformation import deformation_of
from nerfmodal.spec import OrganSpec
from nerfmodal.surface.sensors import Reference, Surface, Track, displace
from nerfmodal.types import DisplacementMatrix, PointCloud, SensorGrid

FEWEST_SHARE = 0.5
"""A frame in which less of the organ's points were followed is lost."""


def is_material(clouds: Sequence[PointCloud | None]) -> bool:
    """Whether point i is the same place of the structure in all clouds."""
    present = [cloud for cloud in clouds if cloud is not None]
    return bool(present) and all(
        cloud.stds is not None and len(cloud.points) == len(present[0].points) for cloud in present
    )


def measure_material(
    organ: OrganSpec,
    clouds: Sequence[PointCloud | None],
    mine: Bool[np.ndarray, " points"],
    surface: Surface,
    *,
    reference: Reference,
    times: Float[np.ndarray, " frames"],
    frame_rate: float,
    report: Callable[[int, int, str], None],
) -> Track:
    """The track of the points `mine`, of which `surface` is the sheet or rod at rest.

    A frame in which half of them were lost is a gap in the record.
    """
    start = next(cloud for cloud in clouds if cloud is not None)
    rest = start.points[mine]
    deformation = deformation_of(rest)
    carry = np.linalg.pinv(deformation.at(rest))
    terms = carry.shape[0]
    coefficients = np.full((len(clouds), 3 * terms), np.nan)
    for index, cloud in enumerate(clouds):
        report(index, len(clouds), f"{organ.name}: reading the displacement of frame {index}")
        if cloud is None or cloud.stds is None or np.isfinite(cloud.stds[mine]).mean() < FEWEST_SHARE:
            continue
        coefficients[index] = (carry @ (cloud.points[mine] - rest)).ravel()
    valid = np.isfinite(coefficients).all(axis=1)
    moved, valid = displace(coefficients, valid, reference)
    found = surface.fit(rest)
    sensors = rest if found is None else surface.positions(found.coefficients)
    return Track(
        organ=organ.name,
        surface=organ.surface,
        displacement=DisplacementMatrix(
            coefficients=moved,
            basis=np.kron(deformation.at(sensors), np.eye(3)),  # D = C Bᵀ
            directions=np.eye(3),
            times=times,
            frame_rate=frame_rate,
            sensors=SensorGrid(organ=organ.name, positions=sensors),
            valid=valid,
        ),
    )
