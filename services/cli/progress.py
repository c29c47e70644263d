"""Progress: bars with an estimate of the time left on a terminal; elsewhere nothing, or a line now and then."""

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Protocol

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TaskID,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from services.cli.output import notes

LINE_EVERY_S = 10.0


class StageProgress(Protocol):
    """`nerfmodal.pipeline.Progress`, without importing it."""

    @property
    def done(self) -> int: ...
    @property
    def total(self) -> int: ...
    @property
    def message(self) -> str: ...


class StepsOfKind(Protocol):
    """`scanclient.StepProgress`, without importing it."""

    @property
    def step(self) -> str: ...
    @property
    def done(self) -> int: ...
    @property
    def total(self) -> int: ...
    @property
    def fraction(self) -> float: ...


ShowScan = Callable[[Sequence[StepsOfKind], float | None], None]
"""Called with the kinds of steps and the seconds left, None while they are unknown."""


@contextmanager
def stage_bars(*, quiet: bool = False) -> Iterator[Callable[[str, StageProgress], None]]:
    """A bar for every stage of `pipeline.run`; gives the function that it reports to."""
    console = notes()
    with _bars(console, hidden=quiet or not console.is_terminal) as progress:
        tasks: dict[str, TaskID] = {}

        def report(stage: str, now: StageProgress) -> None:
            if stage not in tasks:
                tasks[stage] = progress.add_task(stage, total=now.total, message="")
            progress.update(tasks[stage], completed=now.done, total=now.total, message=now.message)

        yield report


@contextmanager
def scan_bars(*, quiet: bool = False, lines: bool = False) -> Iterator[ShowScan]:
    """A bar for every kind of step of a scan; where there is no terminal, plain lines if they are wanted."""
    console = notes()
    if quiet or (not console.is_terminal and not lines):
        yield lambda _steps, _eta_s: None
    elif console.is_terminal:
        with _bars(console, hidden=False) as progress:
            yield _ScanBars(progress).update
    else:
        yield _ScanLines(console).update


class _ScanBars:
    def __init__(self, progress: Progress) -> None:
        self._progress = progress
        self._tasks: dict[str, TaskID] = {}

    def update(self, steps: Sequence[StepsOfKind], eta_s: float | None) -> None:
        for row in steps:
            if row.step not in self._tasks:
                self._tasks[row.step] = self._progress.add_task(row.step, total=row.total, message="")
            message = f"scan: {duration(eta_s)} left" if eta_s is not None and row is steps[-1] else ""
            self._progress.update(
                self._tasks[row.step], completed=row.fraction * row.total, total=row.total, message=message
            )


class _ScanLines:
    def __init__(self, console: Console) -> None:
        self._console = console
        self._began = time.monotonic()
        self._last = -LINE_EVERY_S
        self._said = ""

    def update(self, steps: Sequence[StepsOfKind], eta_s: float | None) -> None:
        counts = "  ".join(f"{row.step} {row.done}/{row.total}" for row in steps)
        now = time.monotonic() - self._began
        over = all(row.done == row.total for row in steps)
        if counts == self._said or (now - self._last < LINE_EVERY_S and not over):
            return
        left = f"  about {duration(eta_s)} left" if eta_s is not None and not over else ""
        self._console.print(f"{duration(now):>8}  {counts}{left}")
        self._said, self._last = counts, now


def duration(seconds: float) -> str:
    """Seconds as a person says them."""
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60:02d} s"
    return f"{whole // 3600} h {whole % 3600 // 60:02d} min"


def _bars(console: Console, *, hidden: bool) -> Progress:
    return Progress(
        TextColumn("{task.description:<14}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        TextColumn("{task.fields[message]}"),
        console=console,
        disable=hidden,
    )
