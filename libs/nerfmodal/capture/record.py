"""A capture that was opened: one rig that stands still, instants, and where each camera's picture of each lies.

Opening decodes nothing. A camera that has no picture of an instant is missing there; it is never shown by another
instant's picture. The frame that is read has the cameras that saw it, and no others.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Bool, UInt8

from nerfmodal.capture.pictures import Picture, PictureFile, read_mask, read_picture
from nerfmodal.capture.video import Films
from nerfmodal.errors import InvalidCapture
from nerfmodal.geometry.cameras import downscale
from nerfmodal.types import Camera, Frame, Rig

FEWEST_CAMERAS = 3
Told = Callable[[int, int], None]
"""Called with (done, of)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Clock:
    """How a video's clock was brought to the record's.

    `offset` (s) is the time on its own clock at which the record begins; `residual` (s) is how late its pictures
    still come after that, by the median: cameras without a common trigger keep up to half a period.
    """

    camera: str
    offset: float
    residual: float
    found_by: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Capture:
    """The pictures of a capture by instant and camera; None where the camera has none.

    `absent` are pictures that the capture names and that belong to no camera of the rig or do not exist. `region` is
    the box (m) of what moves, where it was looked for.
    """

    where: str
    rig: Rig
    times: tuple[float, ...]
    pictures: tuple[tuple[Picture | None, ...], ...]
    absent: tuple[str, ...] = ()
    clocks: tuple[Clock, ...] = ()
    region: np.ndarray | None = None
    films: Films = field(default_factory=Films, repr=False, compare=False)

    def __len__(self) -> int:
        """How many instants there are."""
        return len(self.times)

    @property
    def missing(self) -> tuple[tuple[str, int], ...]:
        """Camera and instant of every picture that a camera of the rig has lost."""
        names = [camera.name for camera in self.rig.cameras]
        return tuple(
            (name, index)
            for index, row in enumerate(self.pictures)
            for name, one in zip(names, row, strict=True)
            if one is None
        )

    def read(self, index: int, shrink: int = 1) -> Frame:
        """Decode the pictures of one instant, `shrink` times smaller.

        Raises
        ------
        InvalidCapture
            When a picture is broken, or has another size than its camera.
        """
        seen = [(camera, one) for camera, one in zip(self.rig.cameras, self.pictures[index], strict=True) if one]
        return Frame(
            index=index,
            time=self.times[index],
            images=np.stack([_shrunk(self._pixels(camera, one), shrink) for camera, one in seen]),
            rig=Rig(cameras=tuple(downscale(camera, shrink) for camera, _ in seen)),
            counts=_masks(seen, shrink),
            region=self.region,
        )

    def check(self, told: Told) -> None:
        """Decode every picture file once, so that a broken one is known before hours are spent.

        Videos were decoded to their end when the capture was first opened. Raises `InvalidCapture`.
        """
        files = [
            (camera, one)
            for row in self.pictures
            for camera, one in zip(self.rig.cameras, row, strict=True)
            if isinstance(one, PictureFile)
        ]
        for done, (camera, one) in enumerate(files, start=1):
            self._pixels(camera, one)
            told(done, len(files))

    def _pixels(self, camera: Camera, one: Picture) -> UInt8[np.ndarray, "height width 3"]:
        pixels = read_picture(one) if isinstance(one, PictureFile) else self.films.read(one)
        height, width = pixels.shape[:2]
        if (width, height) != (camera.width, camera.height):
            raise InvalidCapture(
                f"has {width} x {height} pixels where its camera {camera.name!r} has {camera.width} x {camera.height}.",
                where=str(one.path),
                hint="All pictures of a camera must have one size, that of its intrinsics.",
            )
        return pixels


def checked_record(capture: Capture) -> Capture:
    """The capture, its cameras sorted by name, if what can be known without decoding is sound.

    Raises
    ------
    InvalidCapture
        Naming the instant, the camera or the file, and the remedy.
    """
    _check_rig(capture)
    order = sorted(range(len(capture.rig.cameras)), key=lambda k: capture.rig.cameras[k].name)
    for index, row in enumerate(capture.pictures):
        present = sum(one is not None for one in row)
        if present < FEWEST_CAMERAS:
            raise InvalidCapture(
                f"only {present} pictures.",
                where=f"{capture.where}, frame {index}",
                hint=f"At least {FEWEST_CAMERAS} cameras must see each instant: add theirs, or leave the instant out.",
            )
    return replace(
        capture,
        rig=Rig(cameras=tuple(capture.rig.cameras[k] for k in order)),
        pictures=tuple(tuple(row[k] for k in order) for row in capture.pictures),
    )


def split_held_out(frame: Frame, every: int | None, rig: Rig | None = None) -> tuple[Frame, Frame | None]:
    """The frame without every n-th camera (the first one included), and the frame of those alone.

    Cameras are counted in `rig`, by default the frame's own: an instant that lost one keeps the others' parts.
    """
    if every is None:
        return frame, None
    counted = frame.rig if rig is None else rig
    held_names = {camera.name for camera in counted.cameras[::every]}
    held = np.array([camera.name in held_names for camera in frame.rig.cameras])
    return some_views(frame, ~held), some_views(frame, held)


def some_views(frame: Frame, chosen: Bool[np.ndarray, " cameras"]) -> Frame:
    """The frame of the chosen cameras alone."""
    cameras = tuple(camera for camera, kept in zip(frame.rig.cameras, chosen, strict=True) if kept)
    counts = None if frame.counts is None else frame.counts[chosen]
    return replace(frame, images=frame.images[chosen], rig=Rig(cameras=cameras), counts=counts)


def _check_rig(capture: Capture) -> None:
    cameras = capture.rig.cameras
    if len(cameras) < FEWEST_CAMERAS:
        raise InvalidCapture(
            f"only {len(cameras)} cameras.",
            where=capture.where,
            hint=f"At least {FEWEST_CAMERAS} cameras must see each instant.",
        )
    names = [camera.name for camera in cameras]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise InvalidCapture(
            f"two cameras are called {twice}.", where=capture.where, hint="Give each camera a name of its own."
        )
    sizes = {(camera.width, camera.height): camera.name for camera in cameras}
    if len(sizes) > 1:
        told = ", ".join(f"{name} {width} x {height}" for (width, height), name in sizes.items())
        raise InvalidCapture(
            f"pictures of different sizes: {told}.", where=capture.where, hint="Bring all cameras to one size."
        )


def _masks(seen: list[tuple[Camera, Picture]], shrink: int) -> Bool[np.ndarray, "cameras height width"] | None:
    if not any(isinstance(one, PictureFile) and one.mask for _, one in seen):
        return None
    return np.stack([_mask(camera, one, shrink) for camera, one in seen])


def _mask(camera: Camera, one: Picture, shrink: int) -> Bool[np.ndarray, "height width"]:
    height, width = camera.height // shrink, camera.width // shrink
    if not isinstance(one, PictureFile) or one.mask is None:
        return np.ones((height, width), dtype=bool)
    full = read_mask(one.mask, camera.width, camera.height)[: height * shrink, : width * shrink]
    return np.asarray(full.reshape(height, shrink, width, shrink).all(axis=(1, 3)))


def _shrunk(image: UInt8[np.ndarray, "rows columns 3"], factor: int) -> UInt8[np.ndarray, "height width 3"]:
    if factor == 1:
        return image
    height, width = image.shape[0] // factor, image.shape[1] // factor
    cut = image[: height * factor, : width * factor].astype(np.float32)
    mean = cut.reshape(height, factor, width, factor, 3).mean(axis=(1, 3))
    return np.round(mean).astype(np.uint8)
