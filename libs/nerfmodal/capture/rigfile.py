"""`rig.json`: the cameras of a rig, written by hand or by what was found of a capture.

``{"frame_rate_hz"?, "cameras": [{as an entry of transforms.json, "camera_id", "file"?, "offset_s"?}]}``

`file` is a video or a folder of pictures, by default what is called as the camera; `offset_s` is the time on the
camera's own clock at which the record begins. What was found of a capture adds `synchronised_by`, `repeats`, `videos`
(their time stamps), `region_m`, and `solved`, what is known of the solution.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from nerfmodal.capture.transforms import number_of, read_json
from nerfmodal.capture.video import Stamps
from nerfmodal.errors import InvalidCapture
from nerfmodal.io.atomic import atomic_write
from nerfmodal.io.transforms import camera_entry, parse_camera
from nerfmodal.types import Camera

FILE = "rig.json"


@dataclass(frozen=True, slots=True, kw_only=True)
class RigFile:
    """What a rig.json says. `repeats` are the ticks, by camera, of pictures that only repeat the one before."""

    cameras: tuple[Camera, ...]
    files: Mapping[str, str] = field(default_factory=dict)
    frame_rate: float | None = None
    offsets: Mapping[str, float] = field(default_factory=dict)
    synchronised_by: str | None = None
    repeats: Mapping[str, tuple[int, ...]] = field(default_factory=dict)
    videos: Mapping[str, Stamps] = field(default_factory=dict)
    region: np.ndarray | None = None
    solved: Mapping[str, Any] = field(default_factory=dict)


def read_rig(where: Path) -> RigFile:
    """Read a rig.json. Raises `InvalidCapture`, naming the entry and the remedy."""
    top = read_json(where)
    entries = top.get("cameras")
    if not isinstance(entries, list) or not entries or not all(isinstance(one, dict) for one in entries):
        raise InvalidCapture("names no cameras.", where=f"{where}#/cameras", hint="List every camera with its pose.")
    cameras = []
    for number, entry in enumerate(entries):
        if "camera_id" not in entry:
            raise InvalidCapture("has no camera_id.", where=f"{where}#/cameras/{number}", hint="Name the camera.")
        cameras.append(parse_camera(entry, {}, f"{where}#/cameras/{number}"))
    region = top.get("region_m")
    rate = top.get("frame_rate_hz")
    return RigFile(
        cameras=tuple(cameras),
        files={str(one["camera_id"]): str(one["file"]) for one in entries if "file" in one},
        frame_rate=None if rate is None else number_of(rate, f"{where}#/frame_rate_hz"),
        offsets={
            str(one["camera_id"]): number_of(one["offset_s"], f"{where}#/cameras/{number}/offset_s")
            for number, one in enumerate(entries)
            if "offset_s" in one
        },
        synchronised_by=top.get("synchronised_by"),
        repeats={name: tuple(ticks) for name, ticks in top.get("repeats", {}).items()},
        videos={name: _stamps(one) for name, one in top.get("videos", {}).items()},
        region=None if region is None else np.array(region, dtype=float),
        solved=top.get("solved", {}),
    )


def write_rig(where: Path, rig: RigFile) -> None:
    """Write what `read_rig` reads; whole, or not at all."""
    entries = []
    for camera in rig.cameras:
        entry = camera_entry(camera)
        if camera.name in rig.files:
            entry["file"] = rig.files[camera.name]
        if camera.name in rig.offsets:
            entry["offset_s"] = rig.offsets[camera.name]
        entries.append(entry)
    document: dict[str, Any] = {"cameras": entries}
    optional = {
        "frame_rate_hz": rig.frame_rate,
        "synchronised_by": rig.synchronised_by,
        "repeats": {name: list(ticks) for name, ticks in rig.repeats.items() if ticks} or None,
        "videos": {name: _stamps_entry(one) for name, one in rig.videos.items()} or None,
        "region_m": None if rig.region is None else rig.region.tolist(),
        "solved": dict(rig.solved) or None,
    }
    document |= {key: value for key, value in optional.items() if value is not None}
    with atomic_write(where) as temporary:
        temporary.write_text(json.dumps(document) + "\n")


def _stamps(entry: Mapping[str, Any]) -> Stamps:
    return Stamps(
        path=Path(entry["path"]),
        width=int(entry["w"]),
        height=int(entry["h"]),
        time_base=Fraction(entry["time_base_s"]),
        ticks=tuple(entry["ticks"]),
        sound=bool(entry["sound"]),
    )


def _stamps_entry(stamps: Stamps) -> dict[str, Any]:
    return {
        "path": str(stamps.path),
        "w": stamps.width,
        "h": stamps.height,
        "time_base_s": str(stamps.time_base),
        "ticks": list(stamps.ticks),
        "sound": stamps.sound,
    }
