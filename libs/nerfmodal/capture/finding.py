"""What a capture does not say and has to be found out: clocks, poses, metres, the part that moves."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from nerfmodal.capture.footage import Footage, open_footage, size_of
from nerfmodal.capture.layout import Layout
from nerfmodal.capture.metric import in_metres
from nerfmodal.capture.moving import moving_box
from nerfmodal.capture.posed import assemble
from nerfmodal.capture.record import Capture
from nerfmodal.capture.rigfile import RigFile
from nerfmodal.capture.signals import repeats, watch
from nerfmodal.capture.solve import solve
from nerfmodal.capture.synchronise import find_offsets
from nerfmodal.capture.video import Stamps, is_video
from nerfmodal.spec import CaptureSource
from nerfmodal.types import Camera, Rig

Told = Callable[[str], None]


def must_find(source: CaptureSource, layout: Layout) -> bool:
    """Whether anything has to be found out of a folder; videos are always decoded once to the end."""
    videos = any(is_video(path) for path in layout.filmed.values())
    return videos or layout.cameras is None or source.scale is not None or source.region == "moving"


def find_out(source: CaptureSource, layout: Layout, told: Told) -> RigFile:
    """Everything that `layout` does not say. Raises `InvalidCapture`, `InvalidSpec` or `MissingExtra`."""
    footage = {name: open_footage(path) for name, path in sorted(layout.filmed.items())}
    known = RigFile(cameras=layout.cameras or _unknown(footage), frame_rate=layout.frame_rate)
    stamps = {name: one for name, one in footage.items() if isinstance(one, Stamps)}
    if stamps:
        known = _clocks(source, layout, known, stamps, told)
    if layout.cameras is None:
        capture = put_together(source, layout, known, footage)
        solution = solve(_first_pictures(capture), one_lens=source.one_lens, where=layout.where, told=told)
        solved = {"error_px": solution.error_px, "points": solution.points, "unsolved": list(solution.unsolved)}
        known = replace(known, cameras=solution.cameras, solved=solved)
    if source.scale is not None:
        capture = put_together(source, layout, known, footage)
        pictures = _first_pictures(capture)
        known = replace(known, cameras=in_metres(capture.rig.cameras, source.scale, pictures, layout.where))
    if source.region == "moving":
        told("finding what moves")
        known = replace(known, region=moving_box(put_together(source, layout, known, footage)))
    return known


def put_together(
    source: CaptureSource, layout: Layout, known: RigFile, footage: Mapping[str, Footage] | None = None
) -> Capture:
    """The capture of what is known. Raises `InvalidCapture`."""
    if footage is None:
        footage = {
            camera.name: known.videos.get(camera.name) or open_footage(layout.filmed[camera.name])
            for camera in known.cameras
        }
    unsolved = known.solved.get("unsolved", [])
    capture = assemble(
        known.cameras,
        footage,
        where=layout.where,
        frame_rate=source.frame_rate_hz or layout.frame_rate,
        offsets=known.offsets,
        found_by=known.synchronised_by or "clocks",
        repeats=known.repeats,
    )
    return replace(capture, absent=(*layout.absent, *unsolved), region=known.region)


def find_out_of_pictures(source: CaptureSource, capture: Capture, told: Told) -> RigFile:
    """The same for a capture whose poses and times are known: metres, and the part that moves."""
    cameras = capture.rig.cameras
    if source.scale is not None:
        cameras = in_metres(cameras, source.scale, _first_pictures(capture), capture.where)
    region = None
    if source.region == "moving":
        told("finding what moves")
        region = moving_box(replace(capture, rig=Rig(cameras=cameras)))
    return RigFile(cameras=cameras, region=region)


def _clocks(source: CaptureSource, layout: Layout, known: RigFile, stamps: Mapping[str, Stamps], told: Told) -> RigFile:
    """Decode every video once; bring the clocks together; see where a recorder filled in."""
    names = list(stamps)
    signals = []
    for number, name in enumerate(names, start=1):
        told(f"looking through {Path(stamps[name].path).name} ({number} of {len(names)})")
        signals.append(watch(stamps[name]))
    asked = source
    if source.offsets_s is None and source.synchronise == "auto":
        if layout.offsets:
            asked = source.model_copy(update={"offsets_s": dict(layout.offsets)})
        elif layout.trusted:
            asked = source.model_copy(update={"synchronise": "clocks"})
    found = find_offsets(asked, names, list(stamps.values()), signals, layout.where)
    filled = repeats(signals, [found.seconds[name] for name in names])
    return replace(
        known,
        offsets=dict(found.seconds),
        synchronised_by=found.found_by,
        videos=dict(stamps),
        repeats={
            name: tuple(int(tick) for tick in np.array(stamps[name].ticks)[which])
            for name, which in zip(names, filled, strict=True)
        },
    )


def _first_pictures(capture: Capture) -> dict[str, np.ndarray]:
    """Pictures by camera of the first instant that as many cameras as possible saw."""
    seen = [sum(one is not None for one in row) for row in capture.pictures]
    frame = capture.read(int(np.argmax(seen)))
    return {camera.name: image for camera, image in zip(frame.rig.cameras, frame.images, strict=True)}


def _unknown(footage: Mapping[str, Footage]) -> tuple[Camera, ...]:
    """Cameras that only have a name and a size, to read pictures with."""
    cameras = []
    for name, one in footage.items():
        width, height = size_of(one)
        focal = 1.2 * max(width, height)
        cameras.append(
            Camera(
                name=name,
                width=width,
                height=height,
                focal_x=focal,
                focal_y=focal,
                center_x=width / 2,
                center_y=height / 2,
                camera_to_world=np.eye(4),
            )
        )
    return tuple(cameras)
