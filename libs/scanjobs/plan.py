"""A specification becomes steps and their parents. Pure data: no rows, no clock.

::

    make[k] ─────────────┬────────────► train[k] ─► extract[k] ─► identify
    make[0] ─► train_first ─► (every k)               ▲ make[k]     ▲ make[0]

`make` is `frame.render` (simulation) or `frame.read` (capture). Every frame, 0 included, is tuned from the one
shared checkpoint, so a bias common to all frames cancels. Captures and clouds begin with `scan.inspect`, which
looks at the files and tells how many frames there are; the rest of the plan is made when it ends.

A plan is cut into chunks of frames, each planted in a transaction of its own: ten thousand frames hold up nobody.
With `partial_every` = n, a `scan.identify` of frame n, 2n … tells the modes so far, from the frames before that one;
each waits for its own n clouds and for the one before it, so a plan has as many edges as it has frames.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

from nerfmodal.spec import CloudsSource, ScanSpec, SimulationSource

from scanjobs.messages import EXTRACT, IDENTIFY, INSPECT, KINDS, QUEUE_OF, READ, RENDER, TRAIN, TRAIN_GPU

WHOLE_SCAN = -1
"""The frame of a step that belongs to no single frame."""
CHUNK = 250
"""Frames planted in one transaction."""


class StepKey(NamedTuple):
    """What names a step inside one generation of a scan."""

    kind: str
    frame: int


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannedStep:
    """A step before it has a row; `depth` is its longest way from a step without parents."""

    key: StepKey
    parents: tuple[StepKey, ...]
    depth: int
    queue: str


TRAIN_FIRST = StepKey(TRAIN, WHOLE_SCAN)
IDENTIFY_ALL = StepKey(IDENTIFY, WHOLE_SCAN)
INSPECT_SOURCE = StepKey(INSPECT, WHOLE_SCAN)


def first_steps(spec: ScanSpec) -> tuple[PlannedStep, ...]:
    """The plan as far as it is known from the specification alone."""
    if isinstance(spec.source, SimulationSource):
        return frame_steps(spec, spec.source.frames)
    return (_step(INSPECT_SOURCE, (), 0),)


def later_steps(spec: ScanSpec, frames: int) -> tuple[PlannedStep, ...]:
    """The plan of a capture or clouds source, once `scan.inspect` has counted the frames."""
    if isinstance(spec.source, CloudsSource):
        return (_step(IDENTIFY_ALL, (), 1),)
    return frame_steps(spec, frames)


def frame_steps(spec: ScanSpec, frames: int) -> tuple[PlannedStep, ...]:
    """All steps of `frames` frames."""
    return tuple(step for start in range(0, frames, CHUNK) for step in chunk_of_frames(spec, frames, start))


def chunk_of_frames(spec: ScanSpec, frames: int, start: int) -> tuple[PlannedStep, ...]:
    """The steps of at most `CHUNK` frames from `start` on; parents are in this chunk or an earlier one."""
    make = make_of(spec)
    first, stop = StepKey(make, 0), min(start + CHUNK, frames)
    training = TRAIN_GPU if spec.reconstruction.field == "mlp" else QUEUE_OF[TRAIN]
    steps = [_step(StepKey(make, k), (), 0) for k in range(start, stop)]
    if start == 0:
        steps.append(_step(TRAIN_FIRST, (first,), 1, training))
    for k in range(start, stop):
        steps += _steps_of_frame(make, k, training)
    steps += _partials(spec, first, frames, range(start, stop))
    if stop == frames:
        extracted = tuple(StepKey(EXTRACT, k) for k in range(frames))
        steps.append(_step(IDENTIFY_ALL, (first, *extracted), 5))
    return tuple(steps)


def make_of(spec: ScanSpec) -> str:
    """The kind of step that makes a frame."""
    return RENDER if isinstance(spec.source, SimulationSource) else READ


def is_essential(key: StepKey) -> bool:
    """Whether the scan cannot go on without this step; the others are a frame that may be lost."""
    return key.frame == WHOLE_SCAN or key in (StepKey(RENDER, 0), StepKey(READ, 0))


def is_partial(key: StepKey) -> bool:
    """Whether the step tells the modes so far: nothing depends on it."""
    return key.kind == IDENTIFY and key.frame != WHOLE_SCAN


def is_at_or_after(kind: str, start: str) -> bool:
    """Whether steps of `kind` are computed afresh when a scan is retried from `start`."""
    return KINDS.index(kind) >= KINDS.index(start)


def _step(key: StepKey, parents: tuple[StepKey, ...], depth: int, queue: str | None = None) -> PlannedStep:
    return PlannedStep(key=key, parents=parents, depth=depth, queue=queue or QUEUE_OF[key.kind])


def _steps_of_frame(make: str, k: int, training: str) -> tuple[PlannedStep, PlannedStep]:
    made, trained = StepKey(make, k), StepKey(TRAIN, k)
    parents = (TRAIN_FIRST, made) if k == 0 else (TRAIN_FIRST, StepKey(make, 0), made)
    return (
        _step(trained, parents, 2, training),
        _step(StepKey(EXTRACT, k), (trained, made), 3),
    )


def _partials(spec: ScanSpec, first: StepKey, frames: int, chunk: range) -> Iterator[PlannedStep]:
    """The identifications of the first n, 2n … frames whose last frame is in this chunk."""
    every = spec.partial_every
    if every is None:
        return
    for count in range(every, frames, every):
        if count - 1 in chunk:
            own = tuple(StepKey(EXTRACT, k) for k in range(count - every, count))
            before = (StepKey(IDENTIFY, count - every),) if count > every else ()
            yield _step(StepKey(IDENTIFY, count), (first, *own, *before), 4)
