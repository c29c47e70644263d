"""A frame as one file: a zip that is itself a one-frame capture (transforms.json and a PNG per camera)."""

import io
import json
import warnings
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from nerfmodal.errors import InvalidCapture
from nerfmodal.io.atomic import atomic_write
from nerfmodal.io.transforms import camera_entry, parse_camera
from nerfmodal.limits import LARGEST_PICTURE
from nerfmodal.types import Frame, Rig

BROKEN = (OSError, ValueError, SyntaxError, Image.DecompressionBombError, Image.DecompressionBombWarning)
"""What Pillow raises of a file that is no picture."""


def write_frame(path: Path, frame: Frame) -> None:
    """Write a frame; PNG keeps every pixel exactly."""
    entries = [
        camera_entry(camera)
        | {"file_path": f"images/{camera.name}.png", "frame_index": frame.index, "time_s": frame.time}
        for camera in frame.rig.cameras
    ]
    top: dict[str, Any] = {} if frame.region is None else {"region_m": frame.region.tolist()}
    if frame.counts is not None:
        entries = [entry | {"mask_path": f"masks/{entry['camera_id']}.png"} for entry in entries]
    with atomic_write(path) as temporary, zipfile.ZipFile(temporary, "w", zipfile.ZIP_STORED) as archive:
        archive.writestr(_undated("transforms.json"), json.dumps({"frames": entries, **top}))
        for entry, image in zip(entries, frame.images, strict=True):
            archive.writestr(_undated(str(entry["file_path"])), encode_png(image))
        for entry, counts in zip(
            entries, () if frame.counts is None else frame.counts, strict=frame.counts is not None
        ):
            archive.writestr(_undated(str(entry["mask_path"])), encode_png(np.uint8(255) * counts))


def _undated(name: str) -> zipfile.ZipInfo:
    """An entry without the present time in it: equal frames are equal files."""
    return zipfile.ZipInfo(name, date_time=(1980, 1, 1, 0, 0, 0))


def read_frame(path: Path) -> Frame:
    """Read a frame written by `write_frame`.

    Raises
    ------
    InvalidCapture
        When the file is not such a zip or a picture in it is broken.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            top = json.loads(archive.read("transforms.json"))
            entries = top["frames"]
            pictures = [decode(archive.read(entry["file_path"]), entry["file_path"]) for entry in entries]
            masks = [decode(archive.read(one["mask_path"]), one["mask_path"]) for one in entries if "mask_path" in one]
    except (OSError, KeyError, ValueError, zipfile.BadZipFile) as error:
        raise InvalidCapture(
            f"is no readable frame ({error}).", where=str(path), hint="Make the frame again."
        ) from error
    cameras = tuple(parse_camera(entry, {}, str(path)) for entry in entries)
    return Frame(
        index=int(entries[0]["frame_index"]),
        time=float(entries[0]["time_s"]),
        images=np.stack(pictures),
        rig=Rig(cameras=cameras),
        counts=np.stack(masks)[..., 0] > 0 if masks else None,
        region=np.array(top["region_m"]) if "region_m" in top else None,
    )


def encode_png(image: np.ndarray) -> bytes:
    """A picture (height, width, 3) or (height, width) uint8 as PNG bytes; light compression: frames are many."""
    buffer = io.BytesIO()
    Image.fromarray(image).save(buffer, format="PNG", compress_level=1)
    return buffer.getvalue()


def decode(content: bytes, where: str) -> np.ndarray:
    """Decode a picture to (height, width, 3) uint8; what is transparent becomes white.

    Raises
    ------
    InvalidCapture
        When the picture is broken or claims more than `LARGEST_PICTURE` pixels.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", Image.DecompressionBombWarning)
            with Image.open(io.BytesIO(content)) as image:
                if image.width * image.height > LARGEST_PICTURE:
                    raise ValueError(f"it claims {image.width} x {image.height} pixels")
                return _rgb(image)
    except BROKEN as error:
        raise InvalidCapture(
            f"cannot be decoded ({error}).", where=where, hint="Copy the picture again, or take it out."
        ) from error


def _rgb(image: Image.Image) -> np.ndarray:
    if image.mode.startswith("I;16"):  # Pillow would cut it at 255
        return np.asarray(np.repeat((np.asarray(image) >> 8).astype(np.uint8)[:, :, None], 3, axis=2))
    if image.has_transparency_data:
        clear = image.convert("RGBA")
        image = Image.alpha_composite(Image.new("RGBA", clear.size, "white"), clear)
    return np.asarray(image.convert("RGB"))
