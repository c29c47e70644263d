"""`identify`: displacement in, modes out; and `identify_scan`, the same for every organ of a scan.

PCA (eq 12) → complexity pursuit (eq 13, the paper's chain) and the whitened joint damped-sinusoid fit → one model, in
which every mode carries a verdict, and the other method's opinion beside it. Lost frames are gaps; frames that went
astray are lost.
"""

import zlib
from collections.abc import Callable, Sequence
from typing import Literal, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from nerfmodal.identify.ambient import read_ambient
from nerfmodal.identify.assemble import model_of_fit, read_fit
from nerfmodal.identify.excitation import is_ambient
from nerfmodal.identify.opinions import pursue
from nerfmodal.identify.readings import Record
from nerfmodal.identify.reduction import principal_axes
from nerfmodal.identify.single import model_of_pursuit, model_of_subspace
from nerfmodal.identify.sinusoids import SinusoidFit, fit_sinusoids, useful_channels
from nerfmodal.identify.strays import stray_frames, without
from nerfmodal.identify.subspace import read_subspace
from nerfmodal.spec import IdentificationSpec, OrganSpec
from nerfmodal.types import (
    DisplacementMatrix,
    ModalModel,
    OrganResult,
    Outcome,
    PointCloud,
    Reduction,
    SurfaceKind,
)

FEWEST_FRAMES = 16
PAPERS_COMPONENTS = 3

Report = Callable[[int, int, str], None]
"""Told (done, total, message); whatever it raises stops the work."""


@runtime_checkable
class Track(Protocol):
    """The motion of one organ, as `surface.measure_organ` returns it."""

    @property
    def surface(self) -> SurfaceKind:
        """Which surface was fitted."""

    @property
    def displacement(self) -> DisplacementMatrix:
        """D (eq 11), NaN in lost frames."""


@runtime_checkable
class Measure(Protocol):
    """How an organ's motion is measured: `surface.measure_organ`."""

    def __call__(
        self,
        organ: OrganSpec,
        clouds: Sequence[PointCloud | None],
        *,
        reference: Literal["mean", "first", "previous"],
        times: Float[np.ndarray, " frames"],
        frame_rate: float,
        rng: np.random.Generator,
        report: Report,
    ) -> Track:
        """The organ's track."""


def identify(
    displacement: DisplacementMatrix,
    settings: IdentificationSpec,
    *,
    seed: int,
    surface: SurfaceKind = "polynomial",
    known: Float[np.ndarray, "modes 2"] | None = None,
) -> OrganResult:
    """Modes of one organ.

    Parameters
    ----------
    displacement
        D (eq 11), metres.
    settings
        Method, reference, number of components.
    seed
        Of the shuffle test; the organ's name goes in too, so that the organs' order does not matter.
    surface
        Copied to the result.
    known
        Lines (Hz, damping ratio) of an earlier, shorter look at the same record, to start from.

    Returns
    -------
    OrganResult
        Without modes and with the outcome saying why if the record is too short or nothing moves. `reduction` holds the
        components that complexity pursuit worked on. Frames that went astray are lost in its displacement.
    """
    valid = displacement.valid
    if int(valid.sum()) < FEWEST_FRAMES:
        return _without_modes(displacement, surface, None, Outcome.TOO_FEW_FRAMES)
    record = Record(displacement=displacement, axes=principal_axes(displacement.coefficients, displacement.basis))
    scores = record.axes.scores[valid]
    channels = useful_channels(scores)
    if record.axes.singular_values[0] <= 0:
        return _without_modes(displacement, surface, record.axes.reduction(channels), Outcome.NO_MOTION)
    fit = fit_sinusoids(
        displacement.times[valid],
        scores[:, :channels],
        frame_rate=displacement.frame_rate,
        max_modes=settings.max_modes,
        rng=organ_generator(seed, displacement.sensors.organ),
        known=known,
    )
    astray = stray_frames(fit.residuals, valid)
    if astray.any():
        return identify(without(displacement, astray), settings, seed=seed, surface=surface, known=known)
    count = _components(settings, len(fit.frequencies), channels)
    fitted, pursued = read_fit(record, fit), pursue(record, count)
    if settings.excitation == "ambient" or (settings.excitation == "auto" and _looks_ambient(record, fit)):
        others = read_ambient(record, count, max_modes=settings.max_modes)
        model = model_of_subspace(record, others[0], (fitted, pursued, *others[1:]))
    else:
        others = (read_subspace(record, count, max_modes=settings.max_modes),)
        model = model_of_fit(record, fit, fitted, (pursued, *others))
    if settings.method == "complexity_pursuit":
        model = model_of_pursuit(record, pursued, (fitted, *others))
    return OrganResult(
        organ=displacement.sensors.organ,
        surface=surface,
        displacement=displacement,
        reduction=record.axes.reduction(count),
        model=model,
        opinions=tuple(reading.opinion(displacement) for reading in (fitted, pursued, *others)),
    )


def _looks_ambient(record: Record, fit: SinusoidFit) -> bool:
    return is_ambient(fit.residuals, float((record.axes.scores[record.displacement.valid] ** 2).sum()))


def identify_scan(
    organs: Sequence[OrganSpec],
    settings: IdentificationSpec,
    clouds: Sequence[PointCloud | None],
    *,
    measure: Measure,
    frame_rate: float,
    times: Sequence[float] | Float[np.ndarray, " frames"],
    seed: int,
    report: Report,
) -> tuple[OrganResult, ...]:
    """Modes of every organ of a scan, in the order of `organs`; without any, the whole cloud is one leaf.

    Parameters
    ----------
    clouds
        One per frame in time order; None is a lost frame.
    measure
        `surface.measure_organ` (the layers keep surface and identify blind to one another).
    frame_rate, times
        Nominal rate in Hz and the instants of all frames in seconds.
    report
        Told (done, total, message) for every frame of every organ; whatever it raises stops the work.

    Raises
    ------
    InvalidClouds
        An organ's region holds no points.
    """
    chosen = tuple(organs) or (OrganSpec(name="whole"),)
    instants = np.asarray(times, dtype=float)
    results = []
    for place, organ in enumerate(chosen):
        track = measure(
            organ,
            clouds,
            reference=settings.reference,
            times=instants,
            frame_rate=frame_rate,
            rng=organ_generator(seed, organ.name),
            report=_share_of(report, place, len(chosen)),
        )
        results.append(identify(track.displacement, settings, seed=seed, surface=track.surface))
    report(len(chosen) * 1000, len(chosen) * 1000, "identified")
    return tuple(results)


def organ_generator(seed: int, organ: str) -> np.random.Generator:
    """Random numbers of one organ, independent of the others'."""
    return np.random.default_rng([seed, zlib.crc32(organ.encode())])


def _components(settings: IdentificationSpec, found: int, channels: int) -> int:
    """As many as asked; by default as many as modes were found, the paper's three at least."""
    return min(settings.components or max(PAPERS_COMPONENTS, found), channels)


def _share_of(report: Report, place: int, count: int) -> Report:
    """Progress of one organ as thousandths of the whole scan."""

    def tell(done: int, total: int, message: str) -> None:
        report(place * 1000 + (1000 * done) // max(total, 1), count * 1000, message)

    return tell


def _without_modes(
    displacement: DisplacementMatrix, surface: SurfaceKind, reduction: Reduction | None, outcome: Outcome
) -> OrganResult:
    frames, sensors, axes = len(displacement.times), len(displacement.sensors.positions), len(displacement.directions)
    nothing = np.zeros(0)
    model = ModalModel(
        frequencies=nothing,
        frequency_stds=nothing,
        damping_ratios=nothing,
        damping_stds=nothing,
        mode_shapes=np.zeros((sensors, axes, 0)),
        coordinates=np.zeros((frames, 0)),
        quality=(),
        outcome=outcome,
    )
    return OrganResult(
        organ=displacement.sensors.organ, surface=surface, displacement=displacement, reduction=reduction, model=model
    )
