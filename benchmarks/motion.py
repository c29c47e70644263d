"""Following the motion against finding it again: `python -m benchmarks.motion [--amplitudes M …] [--refit M …]`.

Films of the palm (kept under out/benchmarks/films) at amplitudes of 5 cm, 1 cm and 2 mm, seen by 27 cameras and by
every third of them. Both ways reconstruct, and identify, the same pictures; the truth is only compared with. Prints a
table and writes out/benchmarks/motion.json.
"""

import argparse
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from time import process_time

import numpy as np
from jaxtyping import Float
from nerfmodal import pipeline, simulate
from nerfmodal.geometry.deformation import deformation_of
from nerfmodal.geometry.frames import inside_box
from nerfmodal.identify import modal_motion
from nerfmodal.identify.comparison import ComparisonRow, compare
from nerfmodal.spec import OrientedBox, ScanSpec
from nerfmodal.types import DisplacementMatrix, Frame, PointCloud, Rig, ScanResult

from benchmarks.films import Film, palm
from benchmarks.geometry import silent
from benchmarks.rows import Row, print_and_write
from benchmarks.truth import false_harmonic

OUT = Path("out/benchmarks/motion.json")
AMPLITUDES = (0.05, 0.01, 0.002)
LIMITS = {0.05: (3.0, 1.0), 0.01: (5.0, 2.0), 0.002: (15.0, 6.0)}
"""Normalised error, per cent: at least, and aim."""
FOUND = 0.01
"""A mode whose frequency is within this share of the truth is found."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """What one way made of one film."""

    way: str
    film: Film
    result: ScanResult
    rows: list[ComparisonRow]
    seconds: float
    """Of processor time for a further frame."""


def main() -> None:
    """Film, reconstruct and identify, print and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--amplitudes", type=float, nargs="*", default=list(AMPLITUDES))
    parser.add_argument("--refit", type=float, nargs="*", default=[0.05], help="amplitudes that are also refitted")
    parser.add_argument("--frames", type=int, default=90)
    chosen = parser.parse_args()
    films = {amplitude: Film(spec=palm(amplitude, frames=chosen.frames)) for amplitude in chosen.amplitudes}
    rows = (row for size, film in films.items() for row in film_rows(film, size, size in chosen.refit))
    print_and_write(rows, OUT)


def film_rows(film: Film, amplitude: float, refit: bool) -> Iterator[Row]:
    """Displacement, shapes, harmonic and time of one film."""
    size = f"{1000 * amplitude:g} mm"
    followed = measured(film, "follow", every=1)
    floor, aim = LIMITS.get(amplitude, (100.0, 100.0))
    yield from displacement_rows(followed, f"{size}, follow", floor, aim)
    yield from displacement_rows(second_pass(followed), f"{size}, follow, second pass", floor, aim)
    yield from shape_rows(followed, f"{size}, 27 views, follow", 0.98, 0.995)
    if amplitude == 0.01:
        yield from shape_rows(measured(film, "follow", every=3), f"{size}, 9 views, follow", 0.95, 0.98)
    if refit:
        refitted = measured(film, "refit", every=1)
        yield from displacement_rows(refitted, f"{size}, refit (along normals)", floor, aim)
        yield from shape_rows(refitted, f"{size}, 27 views, refit", 0.98, 0.995)
        share = followed.seconds / refitted.seconds
        yield Row(what=f"time of a frame, follow over refit, {size}", value=share, unit="x", floor=1, aim=0.2)


def measured(film: Film, way: str, every: int) -> Outcome:
    """All frames as every n-th camera saw them, reconstructed one way and identified."""
    spec = spec_of(film, way)
    first = thinned(film.frame(0), every)
    parent = pipeline.fit_first(spec, first, report=silent)
    clouds: list[PointCloud | None] = []
    began, apart = process_time(), 0.0
    for index in range(film.source.frames):
        reading = process_time()
        frame = thinned(film.frame(index), every)
        apart += process_time() - reading
        tuned = pipeline.fine_tune(spec, parent, first, frame, report=silent)
        clouds.append(pipeline.extract(spec, tuned, frame, report=silent))
    seconds = (process_time() - began - apart) / film.source.frames
    result = pipeline.identify(spec, clouds, report=silent)
    rows = compare(result, simulate.true_modes(film.source, film.times))
    return Outcome(way=way, film=film, result=result, rows=rows, seconds=seconds)


def second_pass(outcome: Outcome) -> Outcome:
    """The same with every organ's displacement as the sum of its modes."""
    organs = tuple(
        replace(one, displacement=modal_motion(one.displacement, one.model)) for one in outcome.result.organs
    )
    return replace(outcome, result=replace(outcome.result, organs=organs))


def thinned(frame: Frame, every: int) -> Frame:
    """The frame as every n-th camera saw it."""
    return replace(frame, images=frame.images[::every], rig=Rig(cameras=frame.rig.cameras[::every]))


def displacement_rows(outcome: Outcome, what: str, floor: float, aim: float) -> Iterator[Row]:
    """Error of the leaves' sensors, all axes that are measured; and, at 5 cm, the false harmonic."""
    errors, sizes, harmonics = [], [], []
    for organ in outcome.result.organs:
        if organ.surface == "cylinder" or not organ.displacement.valid.any():
            continue
        truth = true_motion(outcome.film, organ.organ, organ.displacement)
        valid = organ.displacement.valid
        errors.append(np.mean((organ.displacement.values[valid] - truth[valid]) ** 2))
        sizes.append(np.mean(truth[valid] ** 2))
        if valid.all():
            values = organ.displacement.values.reshape(len(valid), -1)
            harmonics.append(false_harmonic(outcome.film, organ.organ, values))
    yield Row(
        what=f"displacement, normalised RMS, {what}",
        value=100 * float(np.sqrt(np.sum(errors) / np.sum(sizes))),
        unit="%",
        floor=floor,
        aim=aim,
    )
    if harmonics and floor == LIMITS[AMPLITUDES[0]][0]:
        yield Row(
            what=f"false second harmonic, mean leaf, {what}",
            value=float(np.mean(harmonics)),
            unit="dB",
            floor=-45,
            aim=-60,
        )


def shape_rows(outcome: Outcome, what: str, floor: float, aim: float) -> Iterator[Row]:
    """The worst MAC of the true modes, how many frequencies were found, and modes that are not there."""
    true = [row for row in outcome.rows if row.truth_hz is not None]
    macs = [row.mac or 0.0 for row in true]
    found = [row.found_hz is not None and abs(row.found_hz / (row.truth_hz or 1.0) - 1) < FOUND for row in true]
    false = sum(
        row.truth_hz is None and row.verdict is not None and row.verdict.value == "accepted" for row in outcome.rows
    )
    print(
        f"  {what}: MAC " + " ".join(f"{value:.3f}" for value in macs) + f"; {false} accepted modes that are not there"
    )
    yield Row(
        what=f"MAC, worst of {len(true)} modes, {what}", value=min(macs, default=0.0), unit="", floor=floor, aim=aim
    )
    yield Row(what=f"MAC, mean, {what}", value=float(np.mean(macs)), unit="", floor=floor, aim=aim)
    yield Row(what=f"frequencies within 1 %, {what}", value=float(np.mean(found)), unit="", floor=1, aim=1)


def true_motion(film: Film, organ: str, displacement: DisplacementMatrix) -> Float[np.ndarray, "frames sensors axes"]:
    """What the sensors should have seen along their directions (eq 11, from the mean over time), metres.

    A smooth displacement through the true vertices, read where the sensors are.
    """
    region = {one.name: one.region for one in simulate.default_organs(film.source)}[organ]
    assert isinstance(region, OrientedBox)
    start = film.vertices(0)
    mine = film.plant.belongs(organ) & inside_box(region, start)
    deformation = deformation_of(start[mine], (7, 6, 4))
    fit = np.linalg.pinv(deformation.at(start[mine]))
    here = deformation.at(displacement.sensors.positions) @ fit
    moved = np.stack([here @ (film.vertices(index)[mine] - start[mine]) for index in range(len(film.times))])
    along = moved @ displacement.directions.T
    return np.asarray(along - along.mean(axis=0))


def spec_of(film: Film, way: str) -> ScanSpec:
    """The film's specification, reconstructed one way."""
    reconstruction = film.spec.reconstruction.model_copy(update={"motion": way})
    return film.spec.model_copy(update={"reconstruction": reconstruction})


if __name__ == "__main__":
    main()
