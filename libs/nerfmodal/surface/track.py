"""From the clouds of a record to the track of one organ."""

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float

from nerfmodal.errors import InvalidClouds
from nerfmodal.geometry.frames import inside_box
from nerfmodal.spec import OrganSpec, OrientedBox
from nerfmodal.surface.cylinder import choose_cylinder
from nerfmodal.surface.material import is_material, measure_material
from nerfmodal.surface.polynomial import choose_sheet
from nerfmodal.surface.pooled import refit_pooled
from nerfmodal.surface.robust import Prior, RobustFit
from nerfmodal.surface.sensors import Reference, Surface, Track, track_of
from nerfmodal.types import PointCloud

FEWEST_INLIERS = 300
"""A frame with fewer is lost: it is a gap in the record, never interpolated."""
POOLED_POINTS = 60_000
"""Points of the whole record that choose the frame, the outline and the start."""
LARGEST_M = 300.0
"""An organ larger than this was most likely given in millimetres."""

Ticker = Callable[[int, int, str], None]
"""Told (done, total, message); whatever it raises stops the work."""


def measure_organ(
    organ: OrganSpec,
    clouds: Sequence[PointCloud | None],
    *,
    reference: Reference,
    times: Float[np.ndarray, " frames"],
    frame_rate: float,
    rng: np.random.Generator,
    report: Ticker,
) -> Track:
    """Follow the virtual sensors of one organ through the record.

    Parameters
    ----------
    organ
        Which points, which surface, how many sensors.
    clouds
        One per frame in time order, metres; None is a lost frame.
    reference
        What displacement is measured from (eq 11).
    times, frame_rate
        Instants of the frames in seconds, and the nominal rate in Hz.
    rng
        Draws the pooled sample.
    report
        Called for every frame.

    Raises
    ------
    InvalidClouds
        The organ's region holds no points in any frame, or they are NaN, collinear or seemingly in millimetres.
    """
    if is_material(clouds):
        return _measure_material(
            organ, clouds, reference=reference, times=times, frame_rate=frame_rate, rng=rng, report=report
        )
    chosen = [None if cloud is None else _points_of(organ, cloud, index) for index, cloud in enumerate(clouds)]
    surface = _choose(organ, _pool(organ, chosen, clouds, rng))
    fits: list[RobustFit | None] = []
    for index, points in enumerate(chosen):
        report(index, 2 * len(chosen), f"{organ.name}: fitting the {organ.surface} of frame {index}")
        fits.append(None if points is None else _enough(surface.fit(points)))
    return track_of(
        surface,
        _refit(surface, chosen, fits, organ.name, report),
        organ=organ.name,
        kind=organ.surface,
        reference=reference,
        times=times,
        frame_rate=frame_rate,
    )


def _measure_material(
    organ: OrganSpec,
    clouds: Sequence[PointCloud | None],
    *,
    reference: Reference,
    times: Float[np.ndarray, " frames"],
    frame_rate: float,
    rng: np.random.Generator,
    report: Ticker,
) -> Track:
    """Points that are in the organ's region in the first cloud are the organ's for good, wherever they go."""
    start = next(cloud for cloud in clouds if cloud is not None)
    points = np.asarray(start.points, dtype=np.float64)
    mine = inside_box(organ.region, points) if isinstance(organ.region, OrientedBox) else np.ones(len(points), bool)
    surface = _choose(organ, _pool(organ, [points[mine]], clouds, rng))
    return measure_material(
        organ, clouds, mine, surface, reference=reference, times=times, frame_rate=frame_rate, report=report
    )


def _points_of(organ: OrganSpec, cloud: PointCloud, index: int) -> np.ndarray:
    points = np.asarray(cloud.points, dtype=np.float64)
    if not np.isfinite(points).all():
        raise InvalidClouds(
            "a point has a coordinate that is no number.",
            where=f"frame {index}",
            hint="Remove NaN and infinite points before writing the cloud.",
        )
    return points[inside_box(organ.region, points)] if isinstance(organ.region, OrientedBox) else points


def _pool(
    organ: OrganSpec,
    chosen: Sequence[np.ndarray | None],
    clouds: Sequence[PointCloud | None],
    rng: np.random.Generator,
) -> np.ndarray:
    present = [points for points in chosen if points is not None and len(points)]
    most = max(map(len, present), default=0)
    if most < FEWEST_INLIERS:
        raise InvalidClouds(
            f"the region of organ '{organ.name}' contains no points."
            if most == 0 and isinstance(organ.region, OrientedBox)
            else f"organ '{organ.name}' has at most {most} points in a frame; {FEWEST_INLIERS} are needed.",
            where=f"/organs/{organ.name}/region",
            hint="Give a region that holds the organ, in metres and in the clouds' own axes, or denser clouds; "
            f"the clouds span {_span(clouds)}.",
        )
    share = max(1, POOLED_POINTS // len(present))
    pooled = np.concatenate([points[rng.permutation(len(points))[:share]] for points in present])
    extent = float(np.ptp(np.quantile(pooled, [0.01, 0.99], axis=0), axis=0).max())
    if extent > LARGEST_M:
        raise InvalidClouds(
            f"organ '{organ.name}' is {extent:.0f} m long: the cloud seems to be in millimetres.",
            where=f"/organs/{organ.name}",
            hint='Say so in clouds.json ("unit": "mm") or scale the points to metres.',
        )
    return pooled


def _span(clouds: Sequence[PointCloud | None]) -> str:
    present = [cloud.points for cloud in clouds if cloud is not None and len(cloud.points)]
    if not present:
        return "nothing: they are all empty"
    low, high = (np.median([end(points, axis=0) for points in present], axis=0) for end in (np.min, np.max))
    return ", ".join(f"{axis} {a:.3g} to {b:.3g} m" for axis, a, b in zip("xyz", low, high, strict=True))


def _choose(organ: OrganSpec, pooled: np.ndarray) -> Surface:
    try:
        if organ.surface == "cylinder":
            return choose_cylinder(pooled, degree=organ.degree, sensors=organ.sensors)
        return choose_sheet(pooled, kind=organ.surface, degree=organ.degree, sensors=organ.sensors)
    except InvalidClouds as error:
        raise InvalidClouds(error.message, where=f"/organs/{organ.name}", hint=error.hint) from error


def _enough(fit: RobustFit | None) -> RobustFit | None:
    return fit if fit is not None and fit.inliers >= FEWEST_INLIERS else None


def _refit(
    surface: Surface,
    chosen: Sequence[np.ndarray | None],
    fits: list[RobustFit | None],
    name: str,
    report: Ticker,
) -> list[RobustFit | None]:
    """Every valid frame again, given what the others say of it."""
    places = [index for index, fit in enumerate(fits) if fit is not None]

    def again(place: int, start: np.ndarray, prior: Prior) -> RobustFit:
        index = places[place]
        report(len(chosen) + index, 2 * len(chosen), f"{name}: pooled refit of frame {index}")
        points, before = chosen[index], fits[index]
        assert points is not None
        assert before is not None
        return surface.fit(points, start=start, prior=prior) or before

    refitted = refit_pooled([fit for fit in fits if fit is not None], again)
    result = list(fits)
    for index, fit in zip(places, refitted, strict=True):
        result[index] = fit
    return result
