"""`identify`: displacement in, modes out; and `identify_scan`, the same for every organ of a scan.

PCA (eq 12) → complexity pursuit (eq 13, the paper's chain) and the whitened joint damped-sinusoid fit → one model, in
which every mode carries a verdict, and the other method's opinion beside it. Lost frames are gaps.
"""

import zlib
from collections.abc import Callable, Sequence
from typing import Literal, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from nerfmodal.identify.assemble import Evidence, model_of_fit
from nerfmodal.identify.excitation import is_ambient
from nerfmodal.identify.opinions import pursue
from nerfmodal.identify.reduction import reduce_coefficients
from nerfmodal.identify.single import model_of_pursuit, model_of_subspace
from nerfmodal.identify.sinusoids import fit_sinusoids, useful_channels
from nerfmodal.identify.subspace import identify_subspace
from nerfmodal.spec import IdentificationSpec, OrganSpec
from nerfmodal.types import (
    DisplacementMatrix,
    ModalModel,
    Opinion,
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

    Returns
    -------
    OrganResult
        Without modes and with the outcome saying why if the record is too short or nothing moves. `reduction` holds the
        components that complexity pursuit worked on.
    """
    valid = displacement.valid
    if int(valid.sum()) < FEWEST_FRAMES:
        return _without_modes(displacement, surface, None, Outcome.TOO_FEW_FRAMES)
    full = reduce_coefficients(displacement.coefficients, displacement.basis)
    channels = useful_channels(full.scores[valid])
    if full.singular_values[0] <= 0:
        return _without_modes(displacement, surface, full, Outcome.NO_MOTION)
    fit = fit_sinusoids(
        displacement.times[valid],
        full.scores[valid][:, :channels],
        frame_rate=displacement.frame_rate,
        max_modes=settings.max_modes,
        rng=organ_generator(seed, displacement.sensors.organ),
    )
    reduction = first_components(full, _components(settings, len(fit.frequencies), channels))
    pursued = pursue(displacement, reduction)
    evidence = Evidence(
        displacement=displacement, components=full.components[:, :channels], scores=full.scores, fit=fit
    )
    subspace = identify_subspace(displacement, reduction, max_modes=settings.max_modes)
    return OrganResult(
        organ=displacement.sensors.organ,
        surface=surface,
        displacement=displacement,
        reduction=reduction,
        model=_choose(settings, evidence, pursued, subspace),
        opinions=(pursued, subspace),
    )


def _choose(settings: IdentificationSpec, evidence: Evidence, pursued: Opinion, subspace: Opinion) -> ModalModel:
    """The estimator that suits the settings and the record; the others are heard as opinions."""
    if settings.method == "complexity_pursuit":
        return model_of_pursuit(pursued, evidence)
    fitted = model_of_fit(evidence, pursued)
    energy = float((evidence.scores[evidence.displacement.valid] ** 2).sum())
    ambient = settings.excitation == "ambient"
    ambient |= settings.excitation == "auto" and is_ambient(evidence.fit.residuals, energy)
    return model_of_subspace(subspace, evidence, pursued) if ambient else fitted


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


def first_components(full: Reduction, count: int) -> Reduction:
    """The leading `count` components (U_r of eq 12); all singular values are kept."""
    return Reduction(
        components=full.components[:, :count],
        scores=full.scores[:, :count],
        singular_values=full.singular_values,
        mean=full.mean,
    )


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
