"""Open a capture of any format: look at what is in the folder, read it, and find out what it does not say itself.

What has to be found (poses, clocks, metres, the part that moves) costs minutes. It is found once and kept in `cache` as
`rig_DIGEST.json`; the digest is of the files and of what was asked. All who work on one scan must share that file: two
solutions of one rig are two worlds.
"""

import hashlib
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from nerfmodal.capture.colmap import model_folder
from nerfmodal.capture.dynerf import FILE as DYNERF_FILE
from nerfmodal.capture.dynerf import dynerf_layout
from nerfmodal.capture.finding import Told, find_out, find_out_of_pictures, must_find, put_together
from nerfmodal.capture.layout import Layout, colmap_layout, unsolved_layout, videos_layout
from nerfmodal.capture.posed import check_looks_at_something
from nerfmodal.capture.record import Capture, checked_record
from nerfmodal.capture.rigfile import FILE as RIG_FILE
from nerfmodal.capture.rigfile import RigFile, read_rig, write_rig
from nerfmodal.capture.transforms import open_dnerf, open_transforms
from nerfmodal.errors import InvalidCapture
from nerfmodal.spec import CaptureSource
from nerfmodal.types import Rig

CACHE = ".nerfmodal"
"""Folder in the capture for what was found, where no other is given."""
ASKED = ("format", "frame_rate_hz", "synchronise", "offsets_s", "scale", "one_lens", "region")
LAYOUTS: dict[str, Callable[[CaptureSource], Layout]] = {
    "dynerf": dynerf_layout,
    "colmap": colmap_layout,
    "videos": videos_layout,
    "unsolved": unsolved_layout,
}
PICTURES: dict[str, Callable[[CaptureSource], Capture]] = {"transforms": open_transforms, "dnerf": open_dnerf}


def open_capture(source: CaptureSource, cache: Path | None = None, told: Told = lambda _: None) -> Capture:
    """Open a capture; what it does not say is taken from `cache`, or found out and written there.

    Parameters
    ----------
    cache
        Folder for what was found; by default `.nerfmodal` in the capture.
    told
        Called with what is being found out.

    Raises
    ------
    InvalidCapture, InvalidSpec
        Naming the file or the key, and the remedy.
    MissingExtra
        When a wheel for videos or for solving is not installed.
    """
    folder = Path(source.path)
    if not folder.is_dir():
        raise InvalidCapture("is no folder.", where=str(folder), hint="Give the folder that the capture lies in.")
    kind = format_of(source)
    kept = (cache or folder / CACHE) / f"rig_{digest_of(source)}.json"
    capture = _of_pictures(kind, source, kept, told) if kind in PICTURES else _of_layout(kind, source, kept, told)
    check_looks_at_something(capture)
    return checked_record(capture)


def format_of(source: CaptureSource) -> str:
    """The format asked for, or the first whose files are there."""
    if source.format != "auto":
        return source.format
    folder = Path(source.path)
    signs = {
        "transforms": (folder / "transforms.json").exists(),
        "videos": (folder / RIG_FILE).exists(),
        "dnerf": (folder / "transforms_train.json").exists(),
        "dynerf": (folder / DYNERF_FILE).exists(),
        "colmap": model_folder(folder) is not None,
    }
    return next((kind for kind, there in signs.items() if there), "unsolved")


def digest_of(source: CaptureSource) -> str:
    """Of what was asked, and of the names, sizes and dates of all files: another capture has another digest."""
    asked = source.model_dump(mode="json", include=set(ASKED))
    folder = Path(source.path)
    files = sorted(one for one in folder.rglob("*") if one.is_file() and CACHE not in one.relative_to(folder).parts)
    listed = [(one.relative_to(folder).as_posix(), one.stat().st_size, one.stat().st_mtime_ns) for one in files]
    return hashlib.sha256(json.dumps([asked, listed], sort_keys=True).encode()).hexdigest()[:16]


def _of_pictures(kind: str, source: CaptureSource, kept: Path, told: Told) -> Capture:
    capture = PICTURES[kind](source)
    if source.scale is None and source.region == "seen":
        return capture
    known = _kept(kept, lambda: find_out_of_pictures(source, capture, told))
    return replace(capture, rig=Rig(cameras=known.cameras), region=known.region)


def _of_layout(kind: str, source: CaptureSource, kept: Path, told: Told) -> Capture:
    layout = LAYOUTS[kind](source)
    if not must_find(source, layout):
        return put_together(source, layout, RigFile(cameras=layout.cameras or ()))
    return put_together(source, layout, _kept(kept, lambda: find_out(source, layout, told)))


def _kept(kept: Path, find: Callable[[], RigFile]) -> RigFile:
    """What is written at `kept`; found out and written where nothing is."""
    if not kept.is_file():
        found = find()
        try:
            write_rig(kept, found)
        except OSError as error:
            raise InvalidCapture(
                f"what was found of the capture cannot be written ({error}).",
                where=str(kept),
                hint="Make the folder writable and see that the disk is not full: every step reads this file.",
            ) from error
    return read_rig(kept)
