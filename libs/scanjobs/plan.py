"""A specification becomes steps and their parents. Pure data: no rows, no clock.

::

    make[k] ─────────────┬────────────► train[k] ─► extract[k] ─► identify
    make[0] ─► train_first ─► (every k)               ▲ make[k]     ▲ make[0]

`make` is `frame.render` (simulation) or `frame.read` (capture). Every frame, 0 included, is tuned from the one
shared checkpoint, so a bias common to all frames cancels. Captures and clouds begin with `scan.inspect`, which
looks at the files and tells how many frames there are; the rest of the plan is made when it ends.
"""

from dataclasses import dataclass
from typing import NamedTuple

from nerfmodal.spec import CloudsSource, ScanSpec, SimulationSource

from scanjobs.messages import EXTRACT, IDENTIFY, INSPECT, KINDS, QUEUE_OF, READ, RENDER, TRAIN

WHOLE_SCAN = -1
"""The frame of a step that belongs to no single frame."""


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

    @property
    def queue(self) -> str:
        """The queue its message goes to."""
        return QUEUE_OF[self.key.kind]


TRAIN_FIRST = StepKey(TRAIN, WHOLE_SCAN)
IDENTIFY_ALL = StepKey(IDENTIFY, WHOLE_SCAN)
INSPECT_SOURCE = StepKey(INSPECT, WHOLE_SCAN)


def first_steps(spec: ScanSpec) -> tuple[PlannedStep, ...]:
    """The plan as far as it is known from the specification alone."""
    if isinstance(spec.source, SimulationSource):
        return frame_steps(RENDER, spec.source.frames)
    return (PlannedStep(key=INSPECT_SOURCE, parents=(), depth=0),)


def later_steps(spec: ScanSpec, frames: int) -> tuple[PlannedStep, ...]:
    """The plan of a capture or clouds source, once `scan.inspect` has counted the frames."""
    if isinstance(spec.source, CloudsSource):
        return (PlannedStep(key=IDENTIFY_ALL, parents=(), depth=1),)
    return frame_steps(READ, frames)


def frame_steps(make: str, frames: int) -> tuple[PlannedStep, ...]:
    """All steps of `frames` frames, each made by a step of kind `make`."""
    first = StepKey(make, 0)
    steps = [PlannedStep(key=StepKey(make, k), parents=(), depth=0) for k in range(frames)]
    steps.append(PlannedStep(key=TRAIN_FIRST, parents=(first,), depth=1))
    for k in range(frames):
        steps += _steps_of_frame(make, k)
    extracted = tuple(StepKey(EXTRACT, k) for k in range(frames))
    steps.append(PlannedStep(key=IDENTIFY_ALL, parents=(first, *extracted), depth=4))
    return tuple(steps)


def is_essential(key: StepKey) -> bool:
    """Whether the scan cannot go on without this step; the others are a frame that may be lost."""
    return key.frame == WHOLE_SCAN or key in (StepKey(RENDER, 0), StepKey(READ, 0))


def is_at_or_after(kind: str, start: str) -> bool:
    """Whether steps of `kind` are computed afresh when a scan is retried from `start`."""
    return KINDS.index(kind) >= KINDS.index(start)


def _steps_of_frame(make: str, k: int) -> tuple[PlannedStep, PlannedStep]:
    made, trained = StepKey(make, k), StepKey(TRAIN, k)
    parents = (TRAIN_FIRST, made) if k == 0 else (TRAIN_FIRST, StepKey(make, 0), made)
    return (
        PlannedStep(key=trained, parents=parents, depth=2),
        PlannedStep(key=StepKey(EXTRACT, k), parents=(trained, made), depth=3),
    )
