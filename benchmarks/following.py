"""The whole film reconstructed: does the cloud move as the structure moved?"""

from collections.abc import Iterator

import numpy as np
from nerfmodal import pipeline, simulate, surface
from nerfmodal.spec import OrganSpec
from nerfmodal.types import DisplacementMatrix, PointCloud

from benchmarks.films import Film
from benchmarks.geometry import silent
from benchmarks.pictures import plant_pixels, plant_psnr
from benchmarks.rows import Row
from benchmarks.truth import false_harmonic, true_displacement

LARGE = 0.5
"""The gain is that of frames in which a leaf moves by more than this share of its largest displacement."""


def following_rows(film: Film) -> Iterator[Row]:
    """Displacement error, gain, false harmonic and PSNR drop over the film."""
    clouds, drops = reconstruct(film)
    errors, gains, harmonics = [], [], []
    for organ in simulate.default_organs(film.source):
        if organ.surface != "polynomial":
            continue
        found = measured(film, organ, clouds)
        truth = true_displacement(film, organ.name, found, range(film.source.frames))
        values = found.values[:, :, 0]
        errors.append(np.sqrt(np.mean((values - truth) ** 2) / np.mean(truth**2)))
        sizes = np.sqrt(np.mean(truth**2, axis=1))
        large = sizes > LARGE * sizes.max()
        gains.append(np.sum(values[large] * truth[large]) / np.sum(truth[large] ** 2))
        harmonics.append(false_harmonic(film, organ.name, values))
    named = {"mean": np.mean, "worst": np.max}
    for name, of in named.items():
        yield Row(
            what=f"displacement, normalised RMS, {name} leaf", value=100 * float(of(errors)), unit="%", floor=10, aim=3
        )
    off = np.abs(np.array(gains) - 1)
    for name, of in named.items():
        yield Row(
            what=f"distance of the gain from 1, {name} leaf", value=float(of(off)), unit="", floor=0.03, aim=0.005
        )
    for name, of in named.items():
        yield Row(what=f"false second harmonic, {name} leaf", value=float(of(harmonics)), unit="dB", floor=-30, aim=-45)
    yield Row(what="PSNR drop of a further frame, mean", value=float(np.mean(drops)), unit="dB", floor=0.5, aim=0.1)


def measured(film: Film, organ: OrganSpec, clouds: list[PointCloud]) -> DisplacementMatrix:
    """The organ's displacement as the product measures it."""
    return surface.measure_organ(
        organ,
        clouds,
        reference="mean",
        times=film.times,
        frame_rate=film.source.frame_rate_hz,
        rng=np.random.default_rng(0),
        report=lambda _done, _of, _message: None,
    ).displacement


def reconstruct(film: Film) -> tuple[list[PointCloud], list[float]]:
    """Clouds of all frames, and how much lower than frame 0's each further frame's PSNR is, dB."""
    first = film.frame(0)
    parent = pipeline.fit_first(film.spec, first, report=silent)
    backgrounds = parent.state["backgrounds"]
    best = plant_psnr(parent, first, backgrounds, plant_pixels(film, 0))
    clouds, drops = [], []
    for index in range(film.source.frames):
        frame = film.frame(index)
        tuned = pipeline.fine_tune(film.spec, parent, first, frame, report=silent)
        clouds.append(pipeline.extract(film.spec, tuned, frame, report=silent))
        if index:
            drops.append(best - plant_psnr(tuned, frame, backgrounds, plant_pixels(film, index)))
    return clouds, drops
