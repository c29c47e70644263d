"""What each camera of a rig has filmed: a video, a folder of pictures, or one picture.

Pictures of a folder are numbered by the last digits of their names, so that a lost one leaves a gap; without digits,
all cameras must have equally many, in the order of their names.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from nerfmodal.capture.pictures import PictureFile, is_picture, picture_size
from nerfmodal.capture.video import Stamps, is_video, read_stamps
from nerfmodal.errors import InvalidCapture

PLACES = ("images", "videos", "input", "")
"""Folders of a capture in which pictures and videos are looked for."""
BESIDE = re.compile(r"\.|(images|masks?|depths?)(_\d+)?$")
"""Folders beside the pictures that are no camera."""
NUMBER = re.compile(r"(\d+)\D*$")


@dataclass(frozen=True, slots=True, kw_only=True)
class Stills:
    """The pictures of a camera by their numbers (None: without numbers, in the order of names)."""

    files: Mapping[int, Path]
    numbered: bool


Footage = Stamps | Stills


def find_footage(folder: Path) -> dict[str, Path]:
    """Cameras by name, and the file or folder of each.

    Videos are taken first, wherever they lie; then the first place that has folders of pictures, or pictures (each a
    camera of its own). Copies in other sizes (images_4) and masks are no cameras.
    """
    listed = [sorted((folder / place).iterdir()) for place in PLACES if (folder / place).is_dir()]
    for entries in listed:
        if videos := {one.stem: one for one in entries if one.is_file() and is_video(one)}:
            return videos
    for entries in listed:
        folders = {one.name: one for one in entries if _is_camera(one)}
        pictures = {one.stem: one for one in entries if one.is_file() and is_picture(one)}
        if found := folders or pictures:
            return found
    return {}


def _is_camera(folder: Path) -> bool:
    if not folder.is_dir() or folder.name in PLACES or BESIDE.match(folder.name):
        return False
    return any(map(is_picture, folder.iterdir()))


def open_footage(path: Path) -> Footage:
    """Look at what a camera has filmed. Raises `InvalidCapture` for what cannot be used."""
    if is_video(path):
        return read_stamps(path)
    files = [path] if path.is_file() else sorted(one for one in path.iterdir() if is_picture(one))
    numbers = [NUMBER.search(one.stem) for one in files]
    if path.is_file() or not all(numbers):
        return Stills(files=dict(enumerate(files)), numbered=False)
    return Stills(files={int(match[1]): one for match, one in zip(numbers, files, strict=True) if match}, numbered=True)


def size_of(footage: Footage) -> tuple[int, int]:
    """Width and height of the pictures (of the first one). Raises `InvalidCapture` when it is no picture."""
    if isinstance(footage, Stamps):
        return footage.width, footage.height
    return picture_size(next(iter(footage.files.values())))


def path_of(footage: Footage) -> Path:
    """The file that errors name: the video, or the first picture."""
    return footage.path if isinstance(footage, Stamps) else next(iter(footage.files.values()))


def instants_of(
    sequences: Sequence[Stills], names: Sequence[str], where: str
) -> tuple[list[int], tuple[tuple[PictureFile | None, ...], ...]]:
    """Numbers of the instants, and each camera's picture of each.

    Raises
    ------
    InvalidCapture
        When pictures without numbers are not equally many: nobody can tell which is missing.
    """
    counts = [len(one.files) for one in sequences]
    if not all(one.numbered for one in sequences) and len(set(counts)) > 1:
        fewest, most = counts.index(min(counts)), counts.index(max(counts))
        raise InvalidCapture(
            f"the camera {names[fewest]!r} has {min(counts)} pictures and {names[most]!r} has {max(counts)}.",
            where=where,
            hint="End the files' names with the number of their frame, so that a lost one leaves a gap.",
        )
    numbers = sorted({number for one in sequences for number in one.files})
    return numbers, tuple(tuple(_picture(one, number) for one in sequences) for number in numbers)


def _picture(sequence: Stills, number: int) -> PictureFile | None:
    path = sequence.files.get(number)
    return None if path is None else PictureFile(path=path)
