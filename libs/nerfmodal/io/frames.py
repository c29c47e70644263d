"""A frame as one file: a zip that is itself a one-frame capture (transforms.json and a PNG per camera)."""

import io
import json
import zipfile
from pathlib import Path

import numpy as np
from PIL import Image

from nerfmodal.errors import InvalidCapture
from nerfmodal.io.atomic import atomic_write
from nerfmodal.io.transforms import camera_entry, parse_camera
from nerfmodal.types import Frame, Rig


def write_frame(path: Path, frame: Frame) -> None:
    """Write a frame; PNG keeps every pixel exactly."""
    entries = [
        camera_entry(camera)
        | {"file_path": f"images/{camera.name}.png", "frame_index": frame.index, "time_s": frame.time}
        for camera in frame.rig.cameras
    ]
    with atomic_write(path) as temporary, zipfile.ZipFile(temporary, "w", zipfile.ZIP_STORED) as archive:
        archive.writestr(_undated("transforms.json"), json.dumps({"frames": entries}))
        for entry, image in zip(entries, frame.images, strict=True):
            archive.writestr(_undated(str(entry["file_path"])), encode_png(image))


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
            entries = json.loads(archive.read("transforms.json"))["frames"]
            pictures = [decode(archive.read(entry["file_path"]), entry["file_path"]) for entry in entries]
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
    )


def encode_png(image: np.ndarray) -> bytes:
    """A picture (height, width, 3) uint8 as PNG bytes; light compression, because frames are many."""
    buffer = io.BytesIO()
    Image.fromarray(image).save(buffer, format="PNG", compress_level=1)
    return buffer.getvalue()


def decode(content: bytes, where: str) -> np.ndarray:
    """Decode a PNG or JPEG to (height, width, 3) uint8; a broken one raises `InvalidCapture`."""
    try:
        with Image.open(io.BytesIO(content)) as image:
            return np.asarray(image.convert("RGB"))
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
        raise InvalidCapture(
            f"cannot be decoded ({error}).",
            where=where,
            hint="Copy the picture again, or remove it from transforms.json.",
        ) from error
