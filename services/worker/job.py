"""What a task is given and what it gives back. A task is a function `(Job, Report) -> Produced`."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from nerfmodal.progress import Report
from nerfmodal.spec import ScanSpec

from services.worker.protocol import Made


@dataclass(frozen=True, slots=True, kw_only=True)
class GivenFile:
    """A file that a parent step made."""

    kind: str
    frame: int
    role: str
    path: Path


class StepStopped(Exception):
    """The supervisor asked to stop; raised out of the next progress report. What is saved before it ends is kept."""


def save_nothing(path: Path) -> None:
    """Of a job that nobody would go on with."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Job:
    """One step, as a task sees it.

    A long task calls `save` with a new file every `save_every_s`, and once more when it is stopped; the next attempt
    finds the last one in `resume`. The file is taken away when it has been stored.
    """

    kind: str
    frame: int
    spec: ScanSpec
    inputs: tuple[GivenFile, ...]
    out: Path
    resume: Path | None = None
    save: Callable[[Path], None] = save_nothing
    save_every_s: float = 30.0

    def files(self, role: str) -> tuple[GivenFile, ...]:
        """The given files of a role, by frame."""
        return tuple(sorted((one for one in self.inputs if one.role == role), key=lambda one: one.frame))

    def file(self, role: str, frame: int) -> Path | None:
        """The given file of a role and frame, or None where that frame was lost."""
        return next((one.path for one in self.inputs if (one.role, one.frame) == (role, frame)), None)

    def needed(self, role: str, frame: int) -> Path:
        """The given file of a role and frame, without which the step makes no sense."""
        path = self.file(role, frame)
        if path is None:
            raise LookupError(f"{self.kind} of frame {self.frame} was given no {role} of frame {frame}")
        return path


@dataclass(frozen=True, slots=True, kw_only=True)
class Produced:
    """The files that a task wrote under `Job.out`, and what it would say of them."""

    files: tuple[Made, ...]
    facts: dict[str, Any] = field(default_factory=dict)


Task = Callable[[Job, Report], Produced]
