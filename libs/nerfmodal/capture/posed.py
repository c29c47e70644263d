"""A rig and what its cameras filmed become a capture: the common end of every format but transforms.json."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from nerfmodal.capture.footage import Footage, Stills, instants_of, path_of, size_of
from nerfmodal.capture.pictures import VideoPicture
from nerfmodal.capture.record import FEWEST_CAMERAS, Capture, Clock
from nerfmodal.capture.timeline import group
from nerfmodal.capture.video import Stamps
from nerfmodal.errors import InvalidCapture
from nerfmodal.geometry.cameras import focus_of
from nerfmodal.types import Camera, Rig

NEARLY_PARALLEL = np.radians(20.0)
"""Axes within this cone (rad) meet too far away, or nowhere, to say what they look at."""
SHAPE = 0.01
"""By this share two pictures' proportions may differ, for rounded sizes."""


def assemble(
    cameras: Sequence[Camera],
    footage: Mapping[str, Footage],
    *,
    where: str,
    frame_rate: float | None,
    offsets: Mapping[str, float],
    found_by: str,
    repeats: Mapping[str, Sequence[int]],
) -> Capture:
    """The capture of `cameras`, each with the `footage` under its name.

    Parameters
    ----------
    frame_rate
        Hz, of pictures in folders; a video tells its own times.
    offsets, found_by
        By camera: the time (s) on its own clock at which the record begins, and how that is known.
    repeats
        By camera: ticks of pictures that only repeat the one before; the camera is missing there.

    Raises
    ------
    InvalidCapture
        Naming the file and the remedy.
    """
    fitted = tuple(_fitted(camera, footage[camera.name]) for camera in cameras)
    chosen = [footage[camera.name] for camera in cameras]
    stamps = [_without(one, repeats.get(camera.name, ())) for camera, one in zip(cameras, chosen, strict=True)]
    films = [one for one in stamps if one is not None]
    if len(films) == len(cameras):
        return _of_videos(fitted, films, where, offsets, found_by)
    if films:
        raise InvalidCapture(
            "some cameras have videos and some have pictures.", where=where, hint="Bring all to one of the two."
        )
    stills = [one for one in chosen if isinstance(one, Stills)]
    numbers, table = instants_of(stills, [camera.name for camera in cameras], where)
    if len(numbers) > 1 and frame_rate is None:
        raise InvalidCapture(
            "its pictures tell no times.",
            where=where,
            hint="Give source.frame_rate_hz, the pictures per second of the record.",
        )
    times = tuple((number - numbers[0]) / (frame_rate or 1.0) for number in numbers)
    return Capture(where=where, rig=Rig(cameras=fitted), times=times, pictures=table)


def _without(footage: Footage, repeated: Sequence[int]) -> Stamps | None:
    if not isinstance(footage, Stamps):
        return None
    gone = set(repeated)
    return replace(footage, ticks=tuple(tick for tick in footage.ticks if tick not in gone))


def _of_videos(
    cameras: tuple[Camera, ...], stamps: Sequence[Stamps], where: str, offsets: Mapping[str, float], found_by: str
) -> Capture:
    names = [camera.name for camera in cameras]
    aligned = [one.times - offsets.get(name, 0.0) for one, name in zip(stamps, names, strict=True)]
    line = group(aligned, names, where, FEWEST_CAMERAS)
    pictures = tuple(
        tuple(
            VideoPicture(path=one.path, ticks=one.ticks[k]) if k >= 0 else None
            for one, k in zip(stamps, row, strict=True)
        )
        for row in line.chosen.tolist()
    )
    clocks = tuple(
        Clock(camera=name, offset=offsets.get(name, 0.0), residual=float(late), found_by=found_by)
        for name, late in zip(names, line.phases, strict=True)
    )
    return Capture(
        where=where,
        rig=Rig(cameras=cameras),
        times=tuple(float(time) for time in line.times),
        pictures=pictures,
        clocks=clocks,
    )


def _fitted(camera: Camera, footage: Footage) -> Camera:
    """The camera for the pictures as they are: intrinsics of the same pictures in another size are scaled.

    Raises
    ------
    InvalidCapture
        When the pictures have another shape than the camera.
    """
    width, height = size_of(footage)
    if (width, height) == (camera.width, camera.height):
        return camera
    across, down = width / camera.width, height / camera.height
    if abs(across / down - 1) > SHAPE:
        raise InvalidCapture(
            f"has {width} x {height} pixels where its camera {camera.name!r} has {camera.width} x {camera.height}.",
            where=str(path_of(footage)),
            hint="The intrinsics belong to pictures of another shape: cut or solve them again.",
        )
    return replace(
        camera,
        width=width,
        height=height,
        focal_x=camera.focal_x * across,
        focal_y=camera.focal_y * down,
        center_x=camera.center_x * across,
        center_y=camera.center_y * down,
    )


def check_looks_at_something(capture: Capture) -> None:
    """Refuse a rig that has what its axes meet in behind it: poses of another convention.

    Raises
    ------
    InvalidCapture
        Naming the cameras.
    """
    poses = np.stack([camera.camera_to_world for camera in capture.rig.cameras])
    axes = -poses[:, :3, 2]
    if np.min(axes @ axes.mean(axis=0)) / np.linalg.norm(axes.mean(axis=0)) > np.cos(NEARLY_PARALLEL):
        return
    center, _ = focus_of(capture.rig)
    ahead = np.einsum("ci,ci->c", center - poses[:, :3, 3], axes) > 0
    if ahead.mean() < 0.5:
        raise InvalidCapture(
            "all cameras look away from what stands between them.",
            where=capture.where,
            hint="Poses must be OpenGL's, camera to world: of OpenCV's, negate the second and third column.",
        )
