"""A capture folder: a `transforms.json` (nerfstudio / instant-ngp) beside its pictures.

A dynamic capture adds `camera_id`, `frame_index` and `time_s` to each entry and `frame_rate_hz` at the top; without
them all pictures are one frame. Entries whose picture does not exist are left out and counted, as found in the wild.
"""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from nerfmodal.errors import InvalidCapture
from nerfmodal.geometry.cameras import downscale
from nerfmodal.io.frames import decode
from nerfmodal.io.transforms import parse_camera
from nerfmodal.types import Camera, Frame, Rig

FEWEST_CAMERAS = 3
LARGEST_PICTURE = 60_000_000
"""Pixels; a larger one is taken for a decompression bomb."""
SUFFIXES = ("", ".png", ".jpg", ".jpeg")


@dataclass(frozen=True, slots=True, kw_only=True)
class View:
    """One picture of a capture and the camera that took it."""

    path: Path
    camera: Camera


@dataclass(frozen=True, slots=True, kw_only=True)
class Capture:
    """The pictures of a capture, instant by instant; `absent` are entries whose picture does not exist."""

    frames: tuple[tuple[View, ...], ...]
    times: tuple[float, ...]
    absent: tuple[str, ...]


def open_capture(folder: Path) -> Capture:
    """Read and check `folder/transforms.json`; no picture is decoded, but each one's size is looked at.

    Raises
    ------
    InvalidCapture
        Naming the file and the remedy.
    """
    where = folder / "transforms.json"
    top = _read_json(where)
    entries = top.get("frames")
    if not isinstance(entries, list) or not entries:
        raise InvalidCapture("names no frames.", where=f"{where}#/frames", hint="List at least three pictures.")
    instants: dict[int, list[View]] = {}
    times: dict[int, float] = {}
    absent: list[str] = []
    rate = top.get("frame_rate_hz")
    for number, entry in enumerate(entries):
        place = f"{where}#/frames/{number}"
        picture = _picture(folder, entry, place)
        if picture is None:
            absent.append(str(entry["file_path"]))
            continue
        index = int(entry.get("frame_index", 0))
        instants.setdefault(index, []).append(_view(picture, entry, top, place))
        times[index] = float(entry.get("time_s", index / float(rate) if rate else 0.0))
    order = sorted(instants)
    if not order:
        raise InvalidCapture(
            "none of its pictures exists.", where=str(where), hint="Check the file_path of the frames."
        )
    frames = tuple(_checked_instant(instants[index], index, where) for index in order)
    return Capture(frames=frames, times=tuple(times[index] for index in order), absent=tuple(absent))


def read_frame(capture: Capture, index: int, shrink: int = 1) -> Frame:
    """Decode the pictures of one instant, `shrink` times smaller.

    Raises
    ------
    InvalidCapture
        When a picture is truncated or has another size than its header says.
    """
    views = capture.frames[index]
    images = [_shrunk(decode(view.path.read_bytes(), str(view.path)), shrink) for view in views]
    rig = Rig(cameras=tuple(downscale(view.camera, shrink) for view in views))
    return Frame(index=index, time=capture.times[index], images=np.stack(images), rig=rig)


def check_pictures(capture: Capture) -> None:
    """Decode every picture once, so that a broken one is known before hours are spent. Raises `InvalidCapture`."""
    for views in capture.frames:
        for view in views:
            decode(view.path.read_bytes(), str(view.path))


def split_held_out(frame: Frame, every: int | None) -> tuple[Frame, Frame | None]:
    """The frame without every n-th view (the first one included), and the frame of those views alone."""
    if every is None:
        return frame, None
    held = np.arange(len(frame.images)) % every == 0
    return _some_views(frame, ~held), _some_views(frame, held)


def _some_views(frame: Frame, chosen: np.ndarray) -> Frame:
    cameras = tuple(camera for camera, kept in zip(frame.rig.cameras, chosen, strict=True) if kept)
    return replace(frame, images=frame.images[chosen], rig=Rig(cameras=cameras))


def _read_json(where: Path) -> dict[str, Any]:
    try:
        top = json.loads(where.read_text())
    except FileNotFoundError as error:
        raise InvalidCapture(
            "does not exist: the capture has no poses.",
            where=str(where),
            hint="Solve the cameras (COLMAP, or nerfstudio's ns-process-data) and put transforms.json there.",
        ) from error
    except (OSError, ValueError) as error:
        raise InvalidCapture(f"cannot be read ({error}).", where=str(where), hint="It must be JSON.") from error
    if not isinstance(top, dict):
        raise InvalidCapture("is no JSON object.", where=str(where), hint="See docs/howto for the format.")
    return top


def _picture(folder: Path, entry: Any, place: str) -> Path | None:
    if not isinstance(entry, dict) or not isinstance(entry.get("file_path"), str):
        raise InvalidCapture("has no file_path.", where=place, hint="Name the picture, relative to the capture.")
    root = folder.resolve()
    for suffix in SUFFIXES:
        path = (root / (entry["file_path"] + suffix)).resolve()
        if not path.is_relative_to(root):
            raise InvalidCapture(
                f"the file_path {entry['file_path']!r} climbs out of the capture.",
                where=f"{place}/file_path",
                hint="Keep the pictures in the capture's folder.",
            )
        if path.is_file():
            return path
    return None


def _view(path: Path, entry: Mapping[str, Any], top: Mapping[str, Any], place: str) -> View:
    try:
        with Image.open(path) as image:
            width, height = image.size
    except (OSError, Image.DecompressionBombError, SyntaxError) as error:
        raise InvalidCapture(
            f"is no picture ({error}).", where=str(path), hint="Copy it again, or remove it from transforms.json."
        ) from error
    if width * height > LARGEST_PICTURE:
        raise InvalidCapture(
            f"claims {width} x {height} pixels.", where=str(path), hint=f"At most {LARGEST_PICTURE:,} are read."
        )
    camera = parse_camera({"w": width, "h": height, **entry}, top, place)
    if (camera.width, camera.height) != (width, height):
        raise InvalidCapture(
            f"has {width} x {height} pixels where transforms.json says {camera.width} x {camera.height}.",
            where=str(path),
            hint="Give the intrinsics of the pictures as they are.",
        )
    return View(path=path, camera=camera)


def _checked_instant(views: Sequence[View], index: int, where: Path) -> tuple[View, ...]:
    place = f"{where}, frame {index}"
    if len(views) < FEWEST_CAMERAS:
        raise InvalidCapture(
            f"only {len(views)} pictures.",
            where=place,
            hint=f"At least {FEWEST_CAMERAS} cameras must see each instant.",
        )
    sizes = {(view.camera.width, view.camera.height) for view in views}
    if len(sizes) > 1:
        raise InvalidCapture(
            f"pictures of different sizes {sorted(sizes)}.", where=place, hint="Bring all to one size."
        )
    names = [view.camera.name for view in views]
    if len(set(names)) < len(names):
        raise InvalidCapture(
            "one camera took two pictures.", where=place, hint="Give each entry its own camera_id or frame_index."
        )
    if not math.isfinite(sum(float(view.camera.camera_to_world.sum()) for view in views)):
        raise InvalidCapture("a pose is not finite.", where=place, hint="Solve the cameras again.")
    return tuple(sorted(views, key=lambda view: view.camera.name))


def _shrunk(image: np.ndarray, factor: int) -> np.ndarray:
    if factor == 1:
        return image
    height, width = image.shape[0] // factor, image.shape[1] // factor
    cut = image[: height * factor, : width * factor].astype(np.float32)
    mean = cut.reshape(height, factor, width, factor, 3).mean(axis=(1, 3))
    return np.round(mean).astype(np.uint8)
