"""Captures with a `transforms.json` of nerfstudio or instant-ngp, and D-NeRF's `transforms_train.json`.

A dynamic capture adds `camera_id`, `frame_index` and `time_s` to each entry and `frame_rate_hz` at the top; without
them all pictures are one frame. D-NeRF has `time` from 0 to 1 instead: pictures of one time are one instant, and the
rate of the record must be told. Its `transforms_val.json` and `transforms_test.json` are not read.
"""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from nerfmodal.capture.pictures import PictureFile, picture_size
from nerfmodal.capture.record import Capture
from nerfmodal.errors import InvalidCapture
from nerfmodal.geometry.cameras import focus_of
from nerfmodal.io.transforms import parse_camera
from nerfmodal.spec import CaptureSource
from nerfmodal.types import Camera, Rig

SUFFIXES = ("", ".png", ".jpg", ".jpeg")
MOST_ABSENT = 0.5
"""Share of the pictures that may be missing before the copy is called incomplete."""
STILL_PX = 0.25
"""A camera whose pose or lens shifts its picture by less than this has not moved."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Entry:
    picture: PictureFile
    camera: Camera
    index: int
    time: float
    place: str


def open_transforms(source: CaptureSource) -> Capture:
    """A folder with a transforms.json. Raises `InvalidCapture`, naming the entry and the remedy."""
    return _open(source, Path(source.path) / "transforms.json", dnerf=False)


def open_dnerf(source: CaptureSource) -> Capture:
    """A folder of D-NeRF. Raises `InvalidCapture`, naming the entry and the remedy."""
    return _open(source, Path(source.path) / "transforms_train.json", dnerf=True)


def _open(source: CaptureSource, where: Path, *, dnerf: bool) -> Capture:
    top = read_json(where)
    entries = top.get("frames")
    if not isinstance(entries, list) or not entries:
        raise InvalidCapture("names no frames.", where=f"{where}#/frames", hint="List at least three pictures.")
    rate = _rate(source.frame_rate_hz or top.get("frame_rate_hz"), f"{where}#/frame_rate_hz")
    when = _dnerf_times(entries, rate, where) if dnerf else None
    sizes: dict[str, tuple[int, int]] = {}
    found: list[_Entry] = []
    absent: list[str] = []
    for number, entry in enumerate(entries):
        place = f"{where}#/frames/{number}"
        index, time = when[number] if when else _instant(entry, rate, place)
        path = _picture(where.parent, entry, place)
        if path is None:
            absent.append(str(entry["file_path"]))
            continue
        camera = _camera(path, entry, top, place, sizes)
        picture = PictureFile(path=path, mask=_mask(where.parent, entry, place))
        found.append(_Entry(picture=picture, camera=camera, index=index, time=time, place=place))
    _refuse_absence(len(found), len(entries), where)
    return _sorted_out(found, tuple(absent), where)


def _sorted_out(found: list[_Entry], absent: tuple[str, ...], where: Path) -> Capture:
    """Entries become a table of instants by cameras."""
    _refuse_twins(found)
    rig = _still_rig(found)
    column = {camera.name: k for k, camera in enumerate(rig.cameras)}
    order = {index: k for k, index in enumerate(sorted({one.index for one in found}))}
    table: list[list[PictureFile | None]] = [[None] * len(column) for _ in order]
    times = [0.0] * len(order)
    for one in found:
        row = order[one.index]
        table[row][column[one.camera.name]] = one.picture
        times[row] = one.time
    if len(times) > 1 and min(np.diff(times)) <= 0:
        raise InvalidCapture(
            "the times of its frames do not increase.",
            where=str(where),
            hint="Give time_s in the order of frame_index, or frame_rate_hz.",
        )
    return Capture(
        where=str(where),
        rig=rig,
        times=tuple(times),
        pictures=tuple(tuple(row) for row in table),
        absent=absent,
    )


def _refuse_twins(found: list[_Entry]) -> None:
    taken: set[tuple[str, int]] = set()
    for one in found:
        if (one.camera.name, one.index) in taken:
            raise InvalidCapture(
                f"the camera {one.camera.name!r} took two pictures of frame {one.index}.",
                where=one.place,
                hint="Give each entry its own camera_id or frame_index.",
            )
        taken.add((one.camera.name, one.index))


def _still_rig(found: list[_Entry]) -> Rig:
    """Each camera once, as its first entry has it. Raises `InvalidCapture` where a camera moves."""
    first: dict[str, Camera] = {}
    for one in found:
        first.setdefault(one.camera.name, one.camera)
    rig = Rig(cameras=tuple(first.values()))
    distance = focus_of(rig)[1] if len(first) > 1 else 1.0
    for one in found:
        shift = _shift_px(first[one.camera.name], one.camera, distance)
        if shift > STILL_PX:
            raise InvalidCapture(
                f"the camera {one.camera.name!r} has moved, or its lens has: its picture shifts by {shift:.1f} pixels.",
                where=one.place,
                hint="The rig must stand still: solve its poses once, and give another place another camera_id.",
            )
    return rig


def _shift_px(a: Camera, b: Camera, distance: float) -> float:
    """By how much what `a` sees at `distance` (m) shifts in the picture of `b`, pixels, no less than it is by half."""
    turn = np.linalg.norm(a.camera_to_world[:3, :3] - b.camera_to_world[:3, :3])
    move = np.linalg.norm(a.camera_to_world[:3, 3] - b.camera_to_world[:3, 3]) / max(distance, 1e-9)
    zoom = abs(a.focal_x / b.focal_x - 1) + abs(a.focal_y / b.focal_y - 1)
    center = np.hypot(a.center_x - b.center_x, a.center_y - b.center_y)
    return float(max(a.focal_x, a.focal_y) * (turn + move) + 0.5 * max(a.width, a.height) * zoom + center)


def _instant(entry: Any, rate: float | None, place: str) -> tuple[int, float]:
    if not isinstance(entry, dict):
        raise InvalidCapture("is no JSON object.", where=place, hint="See docs/howto for the format.")
    index = int(number_of(entry.get("frame_index", 0), f"{place}/frame_index"))
    default = index / rate if rate else 0.0
    return index, number_of(entry.get("time_s", default), f"{place}/time_s")


def _dnerf_times(entries: list[Any], rate: float | None, where: Path) -> list[tuple[int, float]]:
    """Index and seconds of each entry. Their spacing is that of the two nearest times."""
    times = [
        number_of(_instant_entry(entry, f"{where}#/frames/{number}").get("time", 0.0), f"{where}#/frames/{number}/time")
        for number, entry in enumerate(entries)
    ]
    different = np.unique(np.round(times, 9))
    if len(different) == 1:
        return [(0, 0.0)] * len(times)
    if rate is None:
        raise InvalidCapture(
            "has times from 0 to 1 and no frame rate: frequencies would have no unit.",
            where=str(where),
            hint="Give source.frame_rate_hz, the pictures per second of the record.",
        )
    spacing = float(np.diff(different).min())
    return [(round((time - different[0]) / spacing), (time - different[0]) / spacing / rate) for time in times]


def _instant_entry(entry: Any, place: str) -> Mapping[str, Any]:
    if not isinstance(entry, dict):
        raise InvalidCapture("is no JSON object.", where=place, hint="See docs/howto for the format.")
    return entry


def _rate(value: Any, where: str) -> float | None:
    if value is None:
        return None
    rate = number_of(value, where)
    if rate <= 0:
        raise InvalidCapture(f"the frame rate is {value!r}.", where=where, hint="Give the frames per second, above 0.")
    return rate


def number_of(value: Any, where: str) -> float:
    """A finite number of a JSON file. Raises `InvalidCapture`."""
    try:
        number = float(value)
    except (TypeError, ValueError) as error:
        raise InvalidCapture(f"is {value!r}, no number.", where=where, hint="Give a number.") from error
    if not math.isfinite(number):
        raise InvalidCapture(f"is {value!r}.", where=where, hint="Give a finite number.")
    return number


def read_json(where: Path) -> dict[str, Any]:
    """A JSON object. Raises `InvalidCapture` when there is none."""
    try:
        top = json.loads(where.read_text())
    except (OSError, ValueError) as error:
        raise InvalidCapture(f"cannot be read ({error}).", where=str(where), hint="It must be JSON.") from error
    if not isinstance(top, dict):
        raise InvalidCapture("is no JSON object.", where=str(where), hint="See docs/howto for the format.")
    return top


def inside(folder: Path, name: str, place: str) -> Path:
    """`folder/name`, links followed. Raises `InvalidCapture` when that leads out of the capture."""
    root = folder.resolve()
    path = (root / name).resolve()
    if not path.is_relative_to(root):
        raise InvalidCapture(
            f"the file {name!r} climbs out of the capture.", where=place, hint="Keep all files in the capture's folder."
        )
    return path


def _picture(folder: Path, entry: Any, place: str) -> Path | None:
    name = _instant_entry(entry, place).get("file_path")
    if not isinstance(name, str) or not name:
        raise InvalidCapture("has no file_path.", where=place, hint="Name the picture, relative to the capture.")
    candidates = [inside(folder, name + suffix, f"{place}/file_path") for suffix in SUFFIXES]
    return next((path for path in candidates if path.is_file()), None)


def _mask(folder: Path, entry: Mapping[str, Any], place: str) -> Path | None:
    name = entry.get("mask_path")
    if not name:
        return None
    path = inside(folder, str(name), f"{place}/mask_path")
    if not path.is_file():
        raise InvalidCapture(
            f"the mask {name!r} is not there.", where=f"{place}/mask_path", hint="Copy it, or remove mask_path."
        )
    return path


def _camera(
    path: Path, entry: Mapping[str, Any], top: Mapping[str, Any], place: str, sizes: dict[str, tuple[int, int]]
) -> Camera:
    """The camera of an entry; one picture of each camera is looked at for its size."""
    name = str(entry.get("camera_id", path))
    if name not in sizes:
        sizes[name] = picture_size(path)
    width, height = sizes[name]
    camera = parse_camera({"w": width, "h": height, **entry}, top, place)
    if (camera.width, camera.height) != (width, height):
        raise InvalidCapture(
            f"has {width} x {height} pixels where transforms.json says {camera.width} x {camera.height}.",
            where=str(path),
            hint="Give the intrinsics of the pictures as they are.",
        )
    return camera


def _refuse_absence(found: int, named: int, where: Path) -> None:
    if found < (1 - MOST_ABSENT) * named:
        said = "none of its pictures exists" if not found else f"only {found} of its {named} pictures exist"
        raise InvalidCapture(
            f"{said}.", where=str(where), hint="Copy the missing ones, or check the file_path of the frames."
        )
