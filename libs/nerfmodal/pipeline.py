"""One function per stage, and `run`: the whole scan in one process, with no service.

Each stage takes values and returns values; the worker's tasks load, call one of these, and save.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import assert_never

import numpy as np

from nerfmodal import __version__, capture, cloud, export, field, figures, io, simulate, tracking
from nerfmodal.allotment import find_organs, labelling, measuring
from nerfmodal.errors import InvalidClouds, InvalidSpec
from nerfmodal.export.modes import write_json
from nerfmodal.identify import identify_scan
from nerfmodal.identify.excitation import excitation_of
from nerfmodal.identify.model import FEWEST_FRAMES
from nerfmodal.identify.structure import structure_modes
from nerfmodal.progress import Progress, Report
from nerfmodal.scene import grounded, scene_of
from nerfmodal.spec import (
    CaptureSource,
    CloudsSource,
    OrganSpec,
    ReconstructionSpec,
    ScanSpec,
    SimulationSource,
)
from nerfmodal.types import Checkpoint, Frame, Look, Outcome, PointCloud, Provenance, ScanResult

SPREAD_VOXELS = 3.0
"""A ray whose weights lie further apart than this (quartiles, voxels) ends in fog, not on a surface."""


def open_source(spec: ScanSpec, cache: Path | None = None, *, report: Report) -> capture.Capture | None:
    """The capture of a scan, looked at once and passed on; None of a scan of another kind.

    What a capture does not say itself (poses, clocks …) is found out here, once, and kept in `cache`, by default in
    the capture's folder. Raises `InvalidCapture`, `InvalidSpec` or `MissingExtra`.
    """
    if not isinstance(spec.source, CaptureSource):
        return None
    return capture.open_capture(spec.source, cache, lambda what: report(Progress(done=0, total=1, message=what)))


def frame_times(spec: ScanSpec, opened: capture.Capture | None = None) -> tuple[float, ...]:
    """Instants in seconds of the frames. No picture is decoded. Raises `InvalidCapture` or `InvalidClouds`."""
    match spec.source:
        case SimulationSource():
            return tuple(float(time) for time in simulate.frame_times(spec.source))
        case CaptureSource():
            return (opened or capture.open_capture(spec.source)).times
        case CloudsSource():
            return tuple(float(time) for time in open_clouds(spec).times)
        case _:
            assert_never(spec.source)


def check_source(spec: ScanSpec, opened: capture.Capture | None = None, *, report: Report = lambda _: None) -> None:
    """Refuse, before anything runs, a source that cannot be used. Of a capture every picture is decoded.

    Raises `InvalidSpec`, `InvalidCapture` or `InvalidClouds`, naming the key or the file.
    """
    match spec.source:
        case SimulationSource():
            simulate.check_source(spec.source)
        case CaptureSource():
            one = opened or capture.open_capture(spec.source)
            one.check(lambda done, total: report(Progress(done=done, total=total, message="looking at the pictures")))
        case CloudsSource():
            for _ in read_clouds(spec):
                pass
        case _:
            assert_never(spec.source)


def make_frame(spec: ScanSpec, index: int, opened: capture.Capture | None = None, *, report: Report) -> Frame:
    """Frame `index`: rendered (simulation) or read (capture). Of a capture all views are read, held-out ones too.

    A capture that was `opened` is not opened again.
    """
    match spec.source:
        case SimulationSource():
            return simulate.render_frame(spec.source, index, spec.seed, report=lambda d, n: report(_step(d, n)))
        case CaptureSource():
            frame = (opened or capture.open_capture(spec.source)).read(index, spec.source.downscale)
            report(_step(1, 1))
            return frame
        case CloudsSource():
            raise InvalidSpec("clouds have no frames to make.", where="/source/kind", hint="Identify them.")
        case _:
            assert_never(spec.source)


def fit_first(
    spec: ScanSpec, first: Frame, *, report: Report, resume: io.ResumeFile | None = None, alone: bool = False
) -> Checkpoint:
    """Train frame 0 from nothing to the checkpoint that every frame starts from.

    `resume` keeps the state now and then, from which a training that was stopped goes on. A frame that is `alone` is
    spared what only further frames need.
    """
    trained, held_out = capture.split_held_out(first, _held_out(spec))
    keeping = _named_resume(resume, f"{spec.digest()} first")
    scene = scene_of(spec, first)
    if spec.reconstruction.field == "grid":
        scene = grounded(scene, spec, trained, report=report)
    checkpoint = field.fit(
        scene, _settings_of_first(spec), trained, held_out, spec.seed, _telling(report), keeping, alone
    )
    keeping.forget()
    if spec.reconstruction.follows and not alone:
        return _with_reference(spec, checkpoint, trained, scene)
    return checkpoint


def _settings_of_first(spec: ScanSpec) -> ReconstructionSpec:
    """A reference that is followed is trained at once for as long as frame 0 is else in two parts."""
    settings = spec.reconstruction
    if not settings.follows:
        return settings
    return settings.model_copy(update={"iterations": settings.iterations + settings.fine_tune_iterations})


def _with_reference(spec: ScanSpec, checkpoint: Checkpoint, first: Frame, scene: field.Scene) -> Checkpoint:
    """The checkpoint with what frames need to be followed: the points of frame 0, and who sees which.

    Where frame 0 shows nothing there is nothing to follow, and frames are refitted.
    """
    spread = SPREAD_VOXELS * field.voxel_of(scene, spec.reconstruction)
    look = field.looker(checkpoint, first)
    points = _points(spec, look, first, scene, report=lambda _: None)
    if not len(points.points):
        return checkpoint
    organs, found = find_organs(_organs(spec), [points], spec.seed)
    reference = tracking.prepare(
        look,
        first,
        checkpoint.state["backgrounds"],
        checkpoint.state["backgrounds_known"],
        organs=tuple(organ.name for organ in organs),
        labels=labelling(organs, found),
        flat_organs=tuple(organ.surface != "cylinder" for organ in organs),
        spread=spread,
        cloud=points.points,
        colors=points.colors,
    )
    return replace(checkpoint, state=checkpoint.state | tracking.reference_arrays(reference))


def fine_tune(
    spec: ScanSpec,
    parent: Checkpoint,
    first: Frame,
    frame: Frame,
    *,
    report: Report,
    resume: io.ResumeFile | None = None,
) -> Checkpoint:
    """Train `frame` from the frame-0 checkpoint; independent of all other frames (frame 0 included).

    Cameras that lost their picture, of this frame or of frame 0, say nothing. `resume` is as in `fit_first`.
    """
    start, now = (capture.split_held_out(one, _held_out(spec), first.rig)[0] for one in (first, frame))
    if tracking.has_reference(parent.state):
        followed, losses = tracking.followed(parent, start, now)
        lost = "; ".join(f"{organ}: {loss.value}" for organ, loss in losses.items())
        report(Progress(done=1, total=1, message=lost))
        return followed
    parent, start, now = field.of_common_cameras(parent, start, now)
    keeping = _named_resume(resume, f"{spec.digest()} frame {frame.index}")
    checkpoint = field.fine_tune(spec.reconstruction, parent, start, now, spec.seed, _telling(report), keeping)
    keeping.forget()
    return checkpoint


def extract(spec: ScanSpec, checkpoint: Checkpoint, frame: Frame, *, report: Report) -> PointCloud:
    """The point cloud of a trained frame (eq 10). Always ends; see its `outcome`."""
    if checkpoint.field == "moved":
        report(_step(1, 1))
        return tracking.cloud_of(checkpoint, frame.time)
    points = _points(spec, field.looker(checkpoint, frame), frame, scene_of(spec, frame), report=report)
    return replace(points, device=checkpoint.device)


def _points(spec: ScanSpec, look: Look, frame: Frame, scene: field.Scene, *, report: Report) -> PointCloud:
    return cloud.extract(
        look,
        frame,
        scene.low,
        scene.high,
        threshold=spec.reconstruction.opacity_threshold,
        spread=SPREAD_VOXELS * field.voxel_of(scene, spec.reconstruction),
        count=spec.reconstruction.points,
        rng=np.random.default_rng([spec.seed, frame.index]),
        report=lambda done, total: report(_step(done, total)),
    )


def read_clouds(spec: ScanSpec) -> Iterator[PointCloud]:
    """The clouds of a `clouds` source, in time order. Raises `InvalidClouds`."""
    return iter(open_clouds(spec))


def open_clouds(spec: ScanSpec) -> io.CloudSequence:
    """A `clouds` source, looked at but for its points. Raises `InvalidClouds`."""
    if not isinstance(spec.source, CloudsSource):
        raise InvalidSpec("is no source of clouds.", where="/source/kind", hint="Use kind: clouds.")
    path = Path(spec.source.path)
    sequence = io.open_clouds(path, frame_rate=spec.source.frame_rate_hz, unit=spec.source.unit)
    if len(sequence) < FEWEST_FRAMES:
        raise InvalidClouds(
            f"holds {len(sequence)} clouds; modes need {FEWEST_FRAMES} at the least.",
            where=str(path),
            hint="Record for longer: two periods of the slowest mode and 90 frames are a good start.",
        )
    return sequence


def read_all(record: io.CloudSequence, *, report: Report) -> list[PointCloud]:
    """All clouds of a record that was opened. Raises `InvalidClouds`."""
    clouds = []
    for index in range(len(record)):
        report(Progress(done=index, total=len(record), message=f"reading {record.names[index]}"))
        clouds.append(record.read(index))
    if not any(len(one.points) for one in clouds):
        raise InvalidClouds(
            f"holds no points: all {len(clouds)} clouds are empty.",
            where=str(record.path),
            hint="Check what wrote the clouds.",
        )
    return clouds


def identify(
    spec: ScanSpec, clouds: Sequence[PointCloud | None], opened: capture.Capture | None = None, *, report: Report
) -> ScanResult:
    """Modes of every organ from the clouds; None is a frame that was lost. Never reads the truth."""
    started = _now()
    times = np.array(frame_times(spec, opened))
    rate = _frame_rate(spec, times)
    given, found = find_organs(_organs(spec), clouds, spec.seed)
    organs = identify_scan(
        given,
        spec.identification,
        clouds,
        measure=measuring(given, found),
        frame_rate=rate,
        times=times,
        seed=spec.seed,
        report=lambda done, total, message: report(Progress(done=done, total=total, message=message)),
    )
    outcomes = {organ.model.outcome for organ in organs}
    return ScanResult(
        organs=organs,
        times=times,
        frame_rate=rate,
        excitation=excitation_of(organs, spec.identification.excitation),
        provenance=Provenance(
            package_version=__version__,
            spec_digest=spec.digest(),
            seed=spec.seed,
            device=" + ".join(sorted({one.device for one in clouds if one is not None and one.device})) or "cpu",
            started=started,
            finished=_now(),
            rig_certificate=spec.rig_certificate,
        ),
        outcome=outcomes.pop() if len(outcomes) == 1 else Outcome.OK,
        structure=structure_modes(organs, times),
    )


def write_truth(spec: ScanSpec, path: Path) -> None:
    """What a simulation knows, as `truth.npz` (`io.read_truth`, `io.read_scene`); only comparison code opens it."""
    if isinstance(spec.source, SimulationSource):
        modes = simulate.true_modes(spec.source, simulate.frame_times(spec.source))
        io.write_truth(path, modes, simulate.true_scene(spec.source), simulate.true_positions(spec.source))


def write_depths(spec: ScanSpec, index: int, path: Path) -> bool:
    """The true depth maps of frame `index`, where a simulation is asked for them; says whether it is."""
    source = spec.source
    if not isinstance(source, SimulationSource) or not source.depth_maps:
        return False
    io.write_depths(path, *simulate.true_depths(source, index))
    return True


def publish(
    spec: ScanSpec, result: ScanResult, frame: Frame | None, cloud: PointCloud | None, out: Path
) -> tuple[Path, ...]:
    """Write everything a user downloads under `out` (result.npz, modes.json, report.html, pictures …).

    `frame` and `cloud` are the first ones, for the report's pictures. Returns the files written.
    """
    pictures = figures.draw(result, frame, cloud, out / "figures")
    return export.publish(spec, result, frame, cloud, out, pictures=pictures)


def publish_so_far(spec: ScanSpec, result: ScanResult, frames: int, out: Path) -> Path:
    """Write the `modes.json` of the first `frames` frames, whose key `partial` says that it is not the result."""
    document = export.modes_document(result, spec)
    document["partial"] = {"frames": frames, "of": len(result.times)}
    return write_json(document, out / "modes.json")


def run(spec: ScanSpec, out: Path, *, report: Callable[[str, Progress], None]) -> ScanResult:
    """The whole scan in this process; writes the results under `out`."""
    opened = open_source(spec, out, report=_named(report, "scan.inspect"))
    check_source(spec, opened, report=_named(report, "scan.inspect"))
    first: Frame | None = None
    if isinstance(spec.source, CloudsSource):
        clouds: list[PointCloud] = list(read_clouds(spec))
    else:
        first = make_frame(spec, 0, opened, report=_named(report, "frame.render"))
        clouds = list(reconstruct(spec, first, out, opened, report=report))
    result = identify(spec, clouds, opened, report=_named(report, "scan.identify"))
    publish(spec, result, first, clouds[0], out)
    if isinstance(spec.source, SimulationSource):
        write_truth(spec, out / "truth.npz")
    return result


def reconstruct(
    spec: ScanSpec,
    first: Frame,
    out: Path,
    opened: capture.Capture | None = None,
    *,
    report: Callable[[str, Progress], None],
) -> Iterator[PointCloud]:
    """The clouds of all frames, one after the other, each also written under `out/clouds`."""
    count = len(frame_times(spec, opened))
    parent = fit_first(spec, first, report=_named(report, "frame.train"), alone=count == 1)
    for index in range(count):
        frame = first if index == 0 else make_frame(spec, index, opened, report=_named(report, "frame.render"))
        tuned = fine_tune(spec, parent, first, frame, report=_named(report, "frame.train"))
        points = extract(spec, tuned, frame, report=_named(report, "frame.extract"))
        path = out / "clouds" / f"frame_{index:04d}.ply"
        io.write_cloud(path, points)
        yield io.read_cloud(path)


def _named_resume(resume: io.ResumeFile | None, training: str) -> io.ResumeFile:
    named = resume or io.ResumeFile(None)
    named.training = training
    return named


def _step(done: int, total: int) -> Progress:
    return Progress(done=done, total=total)


def _telling(report: Report) -> Callable[[int, int, str], None]:
    return lambda done, total, message: report(Progress(done=done, total=total, message=message))


def _named(report: Callable[[str, Progress], None], step: str) -> Report:
    return lambda progress: report(step, progress)


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")


def _held_out(spec: ScanSpec) -> int | None:
    return spec.source.hold_out_every if isinstance(spec.source, CaptureSource) else None


def _frame_rate(spec: ScanSpec, times: np.ndarray) -> float:
    if isinstance(spec.source, SimulationSource):
        return spec.source.frame_rate_hz
    if isinstance(spec.source, CloudsSource):
        return open_clouds(spec).frame_rate
    return float(1.0 / np.median(np.diff(times))) if len(times) > 1 else 1.0


def _organs(spec: ScanSpec) -> tuple[OrganSpec, ...]:
    if spec.organs == "auto":
        return ()
    if not spec.organs and isinstance(spec.source, SimulationSource):
        return simulate.default_organs(spec.source)
    if not spec.organs and isinstance(spec.source, CloudsSource):
        return open_clouds(spec).organs
    return spec.organs
