"""Instants out of the time stamps of several cameras: which pictures belong together, and which are missing.

Cameras of equal frame rate whose clocks were brought together. Each keeps its own phase within a period; the phase is
measured (circular mean against the reference) and reported, and stamps are grouped after it was taken away. A group
holds at most one picture of a camera; a camera without one has lost it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from nerfmodal.errors import InvalidCapture

NEAR = 0.4
"""Stamps of one instant lie within this share of a period of its first one, phases taken away."""
UNLIKE = 0.01
"""Frame rates that differ by more than this share cannot be grouped one to one."""
SHORTEST = 0.5
"""The record must be longer than this share of the longest video."""

Times = Float[np.ndarray, " _stamps"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Timeline:
    """Instants (s, from the first) and, by instant and camera, the number of the picture or -1.

    `phases` (s): how late each camera's pictures come within an instant. `dropped` counts instants that too few saw.
    """

    times: Float[np.ndarray, " instants"]
    chosen: Int[np.ndarray, "instants cameras"]
    phases: Float[np.ndarray, " cameras"]
    dropped: int


def group(stamps: Sequence[Times], names: Sequence[str], where: str, fewest: int) -> Timeline:
    """Group the stamps (s, one clock) of all cameras into instants that at least `fewest` cameras saw.

    Raises
    ------
    InvalidCapture
        When the frame rates differ, or the videos hardly overlap.
    """
    period = common_period(stamps, names, where)
    reference = stamps[int(np.argmax([len(one) for one in stamps]))]
    phases = np.array([phase(one, reference, period) for one in stamps])
    level = [one - late for one, late in zip(stamps, phases, strict=True)]
    start, end = max(one[0] for one in level), min(one[-1] for one in level)
    _check_overlap(level, names, float(end - start), period, where)
    events = sorted(
        (float(time), camera, k)
        for camera, one in enumerate(level)
        for k, time in enumerate(one)
        if start - period / 2 <= time <= end + period / 2
    )
    rows: list[np.ndarray] = []
    begun = -np.inf
    for time, camera, k in events:
        if time - begun > NEAR * period:
            rows.append(np.full(len(stamps), -1))
            begun = time
        if rows[-1][camera] < 0:
            rows[-1][camera] = k
    chosen = np.array([row for row in rows if (row >= 0).sum() >= fewest]).reshape(-1, len(stamps))
    if not len(chosen):
        raise InvalidCapture(
            f"no instant is seen by {fewest} cameras.", where=where, hint="Check the offsets, or film together."
        )
    times = np.array([np.median([level[camera][k] for camera, k in enumerate(row) if k >= 0]) for row in chosen])
    return Timeline(times=times - times[0], chosen=chosen, phases=phases, dropped=len(rows) - len(chosen))


def common_period(stamps: Sequence[Times], names: Sequence[str], where: str) -> float:
    """Seconds between two pictures. Raises `InvalidCapture` when a camera has another frame rate than the first."""
    short = next((name for name, one in zip(names, stamps, strict=True) if len(one) < 2), None)
    if short is not None:
        raise InvalidCapture(f"the camera {short!r} has one picture.", where=where, hint="Give a video of the motion.")
    periods = np.array([_period_of(one) for one in stamps])
    middle = float(np.median(periods))
    worst = int(np.argmax(np.abs(periods / middle - 1)))
    if abs(periods[worst] / middle - 1) > UNLIKE:
        raise InvalidCapture(
            f"the camera {names[worst]!r} has {1 / periods[worst]:.3f} pictures a second where others have "
            f"{1 / middle:.3f}.",
            where=where,
            hint="Film with one frame rate, or convert the video with ffmpeg -r.",
        )
    return middle


def _period_of(stamps: Times) -> float:
    """Slope of the stamps over their pictures' numbers, lost ones counted: jitter weighs less than in differences."""
    steps = np.diff(stamps)
    counts = np.maximum(np.round(steps / np.median(steps)), 1)
    return float(np.polyfit(np.concatenate([[0], np.cumsum(counts)]), stamps, 1)[0])


def phase(stamps: Times, reference: Times, period: float) -> float:
    """How late stamps come within a period (s, in half a period either way): circular mean of nearest differences."""
    nearest = reference[np.clip(np.searchsorted(reference, stamps), 1, len(reference) - 1) - 1]
    turns = np.exp(2j * np.pi * (stamps - nearest) / period)
    return float(np.angle(turns.mean()) / (2 * np.pi) * period)


def _check_overlap(stamps: Sequence[Times], names: Sequence[str], overlap: float, period: float, where: str) -> None:
    lengths = np.array([one[-1] - one[0] for one in stamps])
    if overlap + period < SHORTEST * (lengths.max() + period):
        shortest = int(np.argmin(lengths))
        raise InvalidCapture(
            f"all cameras film together for {max(overlap, 0.0):.2f} s of {lengths.max():.2f} s; the shortest is "
            f"{names[shortest]!r} with {len(stamps[shortest])} pictures.",
            where=where,
            hint="Check the offsets of the clocks, take the camera out, or cut the record to what all have filmed.",
        )
