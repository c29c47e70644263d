"""Captures on disk: written from a simulation, and reconstructed frame by frame into point clouds.

A capture is images/frame_0000/CAMERA.png … and a transforms.json (OpenGL cameras, `camera_id`, `frame_index`,
`time_s` per picture, `frame_rate_hz` at the top); a simulation's has truth.npz and its summary truth.json beside it.
"""

import json
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from nerfmodal import io, pipeline
from nerfmodal.capture import Capture
from nerfmodal.errors import InvalidSpec
from nerfmodal.io.frames import encode_png
from nerfmodal.io.transforms import camera_entry
from nerfmodal.progress import Progress
from nerfmodal.spec import ScanSpec, SimulationSource
from nerfmodal.types import Checkpoint, Frame, Outcome, PointCloud, TrueMode

StageReport = Callable[[str, Progress], None]
Entry = dict[str, Any]


def write_capture(spec: ScanSpec, folder: Path, *, report: StageReport) -> int:
    """Film a simulation into a folder; returns how many frames were written.

    Raises
    ------
    InvalidSpec
        The source is no simulation, or a mode moves an organ that is not there.
    """
    source = spec.source
    if not isinstance(source, SimulationSource):
        raise InvalidSpec(
            f"is '{source.kind}': only a simulation can be simulated.",
            where="/source/kind",
            hint="Give a specification whose source is a simulation, as examples/acai.yaml.",
        )
    pipeline.check_source(spec)
    folder.mkdir(parents=True, exist_ok=True)
    entries: list[Entry] = []
    for index in range(source.frames):
        entries += _write_frame(pipeline.make_frame(spec, index, report=_nothing), folder)
        pipeline.write_depths(spec, index, folder / "depths" / f"depth_{index:04d}.npz")
        report("render", Progress(done=index + 1, total=source.frames))
    _write_json(folder / "transforms.json", {"frame_rate_hz": source.frame_rate_hz, "frames": entries})
    pipeline.write_truth(spec, folder / "truth.npz")
    _write_json(folder / "truth.json", [truth_summary(mode) for mode in io.read_truth(folder / "truth.npz")])
    return source.frames


def reconstruct_capture(spec: ScanSpec, folder: Path, *, report: StageReport) -> list[Entry]:
    """Every frame of a capture as a cloud under `folder`, with clouds.json and metrics.json; returns the metrics."""
    opened = pipeline.open_source(spec, folder, report=lambda now: report(now.message or "open", now))
    pipeline.check_source(spec, opened, report=lambda now: report("check pictures", now))
    times = pipeline.frame_times(spec, opened)
    folder.mkdir(parents=True, exist_ok=True)
    if opened is not None:
        _write_json(folder / "capture.json", capture_summary(opened))
    first = pipeline.make_frame(spec, 0, opened, report=_nothing)
    shared = pipeline.fit_first(spec, first, report=lambda now: report("train first", now), alone=len(times) == 1)
    metrics: list[Entry] = []
    for index in range(len(times)):
        began = time.monotonic()
        frame = first if index == 0 else pipeline.make_frame(spec, index, opened, report=_nothing)
        checkpoint = pipeline.fine_tune(spec, shared, first, frame, report=_nothing)
        cloud = pipeline.extract(spec, checkpoint, frame, report=_nothing)
        io.write_cloud(folder / f"frame_{index:04d}.ply", cloud)
        metrics.append(frame_metrics(index, checkpoint, cloud, time.monotonic() - began))
        report("reconstruct", Progress(done=index + 1, total=len(times)))
    _write_json(folder / "clouds.json", clouds_header(times))
    _write_json(folder / "metrics.json", metrics)
    return metrics


def clouds_header(times: tuple[float, ...]) -> Entry:
    """`clouds.json`: what a sequence of clouds does not say by itself. A single frame has no rate: 1 Hz stands in."""
    span = times[-1] - times[0]
    rate = (len(times) - 1) / span if span > 0 else 1.0
    return {"frame_rate_hz": rate, "times_s": list(times), "unit": "m"}


def capture_summary(opened: Capture) -> Entry:
    """`capture.json`: what was found of a capture, and what it lacks."""
    return {
        "cameras": [camera_entry(camera) for camera in opened.rig.cameras],
        "frames": len(opened),
        "missing": [{"camera": name, "frame": index} for name, index in opened.missing],
        "absent": list(opened.absent),
        "clocks": [
            {"camera": one.camera, "offset_s": one.offset, "residual_s": one.residual, "found_by": one.found_by}
            for one in opened.clocks
        ],
        "region_m": None if opened.region is None else opened.region.tolist(),
    }


def frame_metrics(index: int, checkpoint: Checkpoint, cloud: PointCloud, seconds: float) -> Entry:
    """What is known of one reconstructed frame; PSNR in dB."""
    return {
        "frame": index,
        "psnr_db": checkpoint.psnr,
        "held_out_psnr_db": checkpoint.held_out_psnr,
        "points": len(cloud.points),
        "outcome": cloud.outcome.name,
        "message": None if cloud.outcome is Outcome.OK else cloud.outcome.value,
        "seconds": round(seconds, 3),
    }


def truth_summary(mode: TrueMode) -> Entry:
    """A mode of the truth in numbers, without its arrays."""
    return {
        "organ": mode.organ,
        "name": mode.name,
        "frequency_hz": mode.frequency,
        "damped_frequency_hz": mode.damped_frequency,
        "damping_ratio": mode.damping_ratio,
        "amplitude_m": float(abs(mode.coordinates).max()),
    }


def _write_frame(frame: Frame, folder: Path) -> list[Entry]:
    below = f"images/frame_{frame.index:04d}"
    (folder / below).mkdir(parents=True, exist_ok=True)
    entries = []
    for camera, image in zip(frame.rig.cameras, frame.images, strict=True):
        name = f"{below}/{camera.name}.png"
        with io.atomic_write(folder / name) as temporary:
            temporary.write_bytes(encode_png(image))
        times = {"file_path": name, "frame_index": frame.index, "time_s": frame.time}
        entries.append(camera_entry(camera) | times)
    return entries


def _write_json(path: Path, document: Mapping[str, Any] | list[Entry]) -> None:
    with io.atomic_write(path) as temporary:
        temporary.write_text(json.dumps(document, indent=1, allow_nan=False) + "\n")


def _nothing(_: Progress) -> None:
    """Progress inside a frame is not shown."""
