"""Frame 0 against the truth: where its cloud lies and what it covers; and what a further frame costs."""

from collections.abc import Iterator
from time import perf_counter

import numpy as np
from nerfmodal import pipeline
from nerfmodal.types import Checkpoint, Frame

from benchmarks.films import Film
from benchmarks.pictures import plant_pixels, plant_psnr
from benchmarks.rows import Row
from benchmarks.truth import TrueSurface, share_covered

ALONE = (50, 100, 200, 400, 800)
"""Iterations tried when a frame is trained alone."""


def geometry_rows(film: Film) -> Iterator[Row]:
    """Distance to the surface, completeness, and the price of a further frame."""
    first = film.frame(0)
    checkpoint = pipeline.fit_first(film.spec, first, report=silent)
    tuned = pipeline.fine_tune(film.spec, checkpoint, first, first, report=silent)
    cloud = pipeline.extract(film.spec, tuned, first, report=silent)
    surface = TrueSurface(film.plant, film.vertices(0))
    distances = surface.distances(cloud.points) / film.footprint
    seen, _ = surface.seen_by(first.rig)
    covered = share_covered(seen, cloud.points, film.footprint)
    yield Row(what="cloud to surface, median", value=float(np.median(distances)), unit="px", floor=0.35, aim=0.15)
    yield Row(what="cloud to surface, 95 %", value=float(np.quantile(distances, 0.95)), unit="px", floor=1.5, aim=0.6)
    yield Row(what="visible surface within a footprint of the cloud", value=covered, unit="", floor=0.9, aim=0.98)
    yield _price(film, checkpoint, first)


def _price(film: Film, parent: Checkpoint, first: Frame) -> Row:
    """Time to train a moved frame alone to the PSNR that it has when tuned, against tuning it."""
    index = min(7, film.source.frames - 1)
    frame = film.frame(index)
    backgrounds = parent.state["backgrounds"]
    began = perf_counter()
    tuned = pipeline.fine_tune(film.spec, parent, first, frame, report=silent)
    price = perf_counter() - began
    mask = plant_pixels(film, index)
    target = plant_psnr(tuned, frame, backgrounds, mask)
    alone = float("nan")
    for iterations in ALONE:
        reconstruction = film.spec.reconstruction.model_copy(update={"iterations": iterations})
        began = perf_counter()
        trained = pipeline.fit_first(
            film.spec.model_copy(update={"reconstruction": reconstruction}), frame, report=silent
        )
        alone = perf_counter() - began
        if plant_psnr(trained, frame, trained.state["backgrounds"], mask) >= target:
            break
    return Row(
        what=f"a frame alone against a further one, both {target:.1f} dB",
        value=alone / price,
        unit="x",
        floor=5,
        aim=20,
    )


def silent(progress: pipeline.Progress) -> None:
    """Say nothing."""
    del progress
