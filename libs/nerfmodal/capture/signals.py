"""What a video shows as a few numbers per picture: how bright it is, and how much moved since the picture before.

Computed from small grey pictures while every picture is decoded once, which also finds the place where a video is
broken, and pictures that only repeat the one before: a recorder's filling for a frame that it lost.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from nerfmodal.capture.video import Stamps, thumbnails
from nerfmodal.errors import InvalidCapture

THUMBNAIL = 96
"""Pixels across."""
SAME = 0.02
"""Grey levels (of 255): a mean difference below this, and below a tenth of the usual one, is one picture twice."""
MOVING = 0.1
"""Grey levels: a mean difference above this is motion, or noise; either shows that a camera films on."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Signals:
    """By picture: `times` (s, own clock), mean `brightness`, and mean `change` since the one before (0-255)."""

    times: Float[np.ndarray, " pictures"]
    brightness: Float[np.ndarray, " pictures"]
    change: Float[np.ndarray, " pictures"]


def watch(stamps: Stamps) -> Signals:
    """Decode a whole video. Raises `InvalidCapture` where that fails, or where it holds fewer pictures than it says."""
    brightness: list[float] = []
    change: list[float] = []
    ticks: list[int] = []
    before: np.ndarray | None = None
    for tick, small in thumbnails(stamps.path, THUMBNAIL):
        ticks.append(tick)
        brightness.append(float(small.mean()))
        change.append(float(np.abs(small - before).mean()) if before is not None else 0.0)
        before = small
    if tuple(ticks) != stamps.ticks:
        raise InvalidCapture(
            f"cannot be decoded as a whole: {len(ticks)} of {len(stamps.ticks)} pictures.",
            where=str(stamps.path),
            hint="Copy it again, or convert it with ffmpeg.",
        )
    return Signals(times=stamps.times, brightness=np.array(brightness), change=np.array(change))


def repeats(signals: Sequence[Signals], offsets: Sequence[float]) -> list[Bool[np.ndarray, " pictures"]]:
    """For each camera, which pictures only repeat the one before while most other cameras saw something change."""
    found = []
    for camera, one in enumerate(signals):
        others = [k for k in range(len(signals)) if k != camera]
        moving = [
            np.interp(one.times - offsets[camera], signals[k].times - offsets[k], signals[k].change) > MOVING
            for k in others
        ]
        still = one.change < min(SAME, 0.1 * float(np.median(one.change)))
        still[0] = False
        found.append(still & (np.mean(moving, axis=0) > 0.5 if moving else False))
    return found
