"""Videos: the exact time stamps of their pictures, and the pictures at them (PyAV).

Time stamps are those of the container's packets: nothing is assumed of a frame rate, and a picture that is not there
has no time stamp. Two pictures with one time stamp are one.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np
from jaxtyping import Float, UInt8

from nerfmodal.capture.pictures import VideoPicture
from nerfmodal.errors import InvalidCapture

VIDEO_SUFFIXES = (".mp4", ".mov", ".mkv", ".avi", ".webm", ".m4v")
LOOK_AHEAD = 32
"""Pictures that are rather decoded in passing than sought anew."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Stamps:
    """What a video says without being decoded: `ticks` of its pictures, in the order of time, and its time base (s)."""

    path: Path
    width: int
    height: int
    time_base: Fraction
    ticks: tuple[int, ...]
    sound: bool

    @property
    def times(self) -> np.ndarray:
        """Seconds on the video's own clock."""
        return np.array([float(tick * self.time_base) for tick in self.ticks])


def is_video(path: Path) -> bool:
    """Whether a file is called as videos are."""
    return path.suffix.lower() in VIDEO_SUFFIXES and not path.name.startswith(".")


def read_stamps(path: Path) -> Stamps:
    """Time stamps of all pictures; only the first picture is decoded, to see that it can be.

    Raises
    ------
    InvalidCapture
        When the file is no video or holds no pictures.
    """
    film = _Film(path)
    try:
        height, width = film.first_shape()
        return Stamps(
            path=path,
            width=width,
            height=height,
            time_base=film.time_base,
            ticks=film.all_ticks(),
            sound=film.has_sound,
        )
    finally:
        film.close()


def thumbnails(path: Path, width: int) -> Iterator[tuple[int, Float[np.ndarray, "rows columns"]]]:
    """Ticks and a small grey picture of every picture, in the order of time, so that all of the video is decoded.

    Raises
    ------
    InvalidCapture
        Where decoding fails.
    """
    film = _Film(path)
    try:
        while (one := film.next_thumbnail(width)) is not None:
            yield one
    finally:
        film.close()


def read_sound(path: Path, rate: int) -> tuple[float, Float[np.ndarray, " samples"]]:
    """When a video's sound begins (s on its own clock), and its samples (mono, `rate` Hz, float).

    Raises
    ------
    InvalidCapture
        When it cannot be decoded.
    """
    blocks: list[np.ndarray] = []
    start = 0.0
    try:
        with av.open(str(path)) as container:
            resampler = av.AudioResampler(format="flt", layout="mono", rate=rate)
            for frame in container.decode(audio=0):
                if not blocks:
                    start = float(frame.pts * (frame.time_base or 0)) if frame.pts is not None else 0.0
                blocks += [one.to_ndarray()[0] for one in resampler.resample(frame)]
    except (av.FFmpegError, IndexError, ValueError) as error:
        raise InvalidCapture(
            f"has sound that cannot be decoded ({error}).",
            where=str(path),
            hint="Convert it with ffmpeg, or set source.synchronise to flash or motion.",
        ) from error
    return start, np.concatenate(blocks).astype(float) if blocks else np.zeros(0)


@dataclass(slots=True)
class Films:
    """The videos of a capture, opened when they are first asked for and kept where they were left."""

    _open: dict[Path, "_Film"] = field(default_factory=dict)

    def read(self, picture: VideoPicture) -> UInt8[np.ndarray, "height width 3"]:
        """The picture with these ticks. Raises `InvalidCapture` when it cannot be decoded."""
        if picture.path not in self._open:
            self._open[picture.path] = _Film(picture.path)
        return self._open[picture.path].picture_at(picture.ticks)

    def close(self) -> None:
        """Close all videos; they open again when asked for."""
        for film in self._open.values():
            film.close()
        self._open.clear()


class _Film:
    """One open video that remembers which picture comes next."""

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            self._container = av.open(str(path))
            self._stream = self._container.streams.video[0]
        except (av.FFmpegError, IndexError, OSError, ValueError) as error:
            raise self._undecodable(error) from error
        self._stream.thread_type = "AUTO"
        self.time_base = Fraction(self._stream.time_base or 1)
        self.has_sound = bool(self._container.streams.audio)
        self._frames = self._container.decode(self._stream)
        self._last: int | None = None

    def close(self) -> None:
        self._container.close()

    def first_shape(self) -> tuple[int, int]:
        first = self.next_picture()
        if first is None:
            raise self._undecodable("it holds no pictures")
        return first[1].shape[0], first[1].shape[1]

    def next_picture(self) -> tuple[int, np.ndarray] | None:
        """None at the end; `InvalidCapture` where the video is broken."""
        frame = self._next_frame()
        return None if frame is None else (frame.pts, self._pixels(frame))

    def next_thumbnail(self, width: int) -> tuple[int, np.ndarray] | None:
        """As `next_picture`, grey and `width` wide."""
        frame = self._next_frame()
        if frame is None:
            return None
        height = max(2, round(width * frame.height / frame.width))
        small = frame.reformat(width=width, height=height, format="gray", interpolation="AREA")
        return frame.pts, small.to_ndarray().astype(float)

    def picture_at(self, ticks: int) -> np.ndarray:
        """Decode on where the picture comes soon, else from the key frame before it."""
        if self._last is None or not 0 < ticks - self._last <= LOOK_AHEAD * self._period():
            self._seek(ticks)
        frame = self._next_frame()
        while frame is not None and frame.pts < ticks:
            frame = self._next_frame()
        if frame is None or frame.pts != ticks:
            raise InvalidCapture(
                f"cannot be decoded at {float(ticks * self.time_base):.3f} s.",
                where=str(self.path),
                hint="Copy the video again, or convert it with ffmpeg.",
            )
        return self._pixels(frame)

    def all_ticks(self) -> tuple[int, ...]:
        self._container.seek(0, stream=self._stream, any_frame=False, backward=True)
        packets = self._container.demux(self._stream)
        ticks = sorted({int(one.pts) for one in packets if one.pts is not None and not one.is_discard})
        if not ticks:
            raise self._undecodable("it holds no time stamps")
        return tuple(ticks)

    def _seek(self, ticks: int) -> None:
        self._container.seek(ticks, stream=self._stream, any_frame=False, backward=True)
        self._frames = self._container.decode(self._stream)
        self._last = None

    def _next_frame(self) -> Any:
        """The next picture with a time stamp of its own, None at the end."""
        try:
            frame = next(self._frames, None)
            while frame is not None and frame.pts in (None, self._last):
                frame = next(self._frames, None)
        except (av.FFmpegError, ValueError) as error:
            raise self._undecodable(error) from error
        if frame is not None:
            self._last = frame.pts
        return frame

    def _period(self) -> float:
        rate = self._stream.average_rate or 25
        return float(1 / (rate * self.time_base))

    def _pixels(self, frame: Any) -> np.ndarray:
        """RGB as shown: turned as the container says, which phones write."""
        pixels = frame.to_ndarray(format="rgb24")
        return np.ascontiguousarray(np.rot90(pixels, round(frame.rotation / 90)))

    def _undecodable(self, error: object) -> InvalidCapture:
        return InvalidCapture(
            f"cannot be decoded as a video ({error}).",
            where=str(self.path),
            hint="Copy it again, or convert it with ffmpeg; H.264 in MP4 is a safe choice.",
        )
