"""Where one picture of a capture lies, and its pixels: a file, or an instant of a video."""

import io
import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, UInt8
from PIL import Image

from nerfmodal.errors import InvalidCapture
from nerfmodal.io.frames import BROKEN, decode
from nerfmodal.limits import LARGEST_PICTURE

PICTURE_SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".webp")


@dataclass(frozen=True, slots=True, kw_only=True)
class PictureFile:
    """A picture in a file; where `mask` is 0 it does not count."""

    path: Path
    mask: Path | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class VideoPicture:
    """The picture of a video whose time stamp is `ticks` of the video's time base."""

    path: Path
    ticks: int


Picture = PictureFile | VideoPicture


def picture_size(path: Path) -> tuple[int, int]:
    """Width and height that a file's header claims; nothing is decoded.

    Raises
    ------
    InvalidCapture
        When the file is no picture, or claims more pixels than are read.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", Image.DecompressionBombWarning)
            with Image.open(path) as image:
                width, height = image.size
    except BROKEN as error:
        raise InvalidCapture(
            f"is no picture ({_said(error, path)}).", where=str(path), hint="Copy it again, or take it out."
        ) from error
    if width * height > LARGEST_PICTURE:
        raise InvalidCapture(
            f"claims {width} x {height} pixels.", where=str(path), hint=f"At most {LARGEST_PICTURE:,} are read."
        )
    return width, height


def read_picture(picture: PictureFile) -> UInt8[np.ndarray, "height width 3"]:
    """The pixels of a file. Raises `InvalidCapture`, naming it, when it is broken."""
    picture_size(picture.path)
    return decode(picture.path.read_bytes(), str(picture.path))


def read_mask(path: Path, width: int, height: int) -> Bool[np.ndarray, "height width"]:
    """Which pixels count. Raises `InvalidCapture` when it is no picture of that size."""
    size = picture_size(path)
    if size != (width, height):
        raise InvalidCapture(
            f"is a mask of {size[0]} x {size[1]} pixels for a picture of {width} x {height}.",
            where=str(path),
            hint="Make masks from the pictures as they are.",
        )
    try:
        with Image.open(io.BytesIO(path.read_bytes())) as image:
            return np.asarray(image.convert("L")) > 0
    except BROKEN as error:
        raise InvalidCapture(f"cannot be decoded ({error}).", where=str(path), hint="Copy it again.") from error


def is_picture(path: Path) -> bool:
    """Whether a file is called as pictures are."""
    return path.suffix.lower() in PICTURE_SUFFIXES and not path.name.startswith(".")


def _said(error: BaseException, path: Path) -> str:
    return "it is empty" if path.is_file() and path.stat().st_size == 0 else str(error)
