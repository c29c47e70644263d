"""What travels to a service besides specifications: folders with a bar that counts bytes, and changes of a scan."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from nerfmodal.errors import InvalidSpec
from rich.progress import BarColumn, DownloadColumn, Progress, TextColumn, TimeRemainingColumn, TransferSpeedColumn

from services.cli.output import notes
from services.cli.specs import load, read_text


@contextmanager
def byte_bar(total: int, *, quiet: bool) -> Iterator[Callable[[int], None]]:
    """A bar of bytes on a terminal; gives the function that each piece is told to."""
    console = notes()
    columns = (TextColumn("sent"), BarColumn(), DownloadColumn(), TransferSpeedColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, disable=quiet or not console.is_terminal) as progress:
        task = progress.add_task("sent", total=total)
        yield lambda count: progress.advance(task, count)


def read_changes(path: Path) -> dict[str, Any]:
    """A merge patch of a specification from a YAML or JSON file. Raises `InvalidSpec`."""
    document = load(read_text(path), path)
    if not isinstance(document, dict):
        raise InvalidSpec("holds no keys to change.", where=str(path), hint="Write for instance: {seed: 1}")
    return document


@contextmanager
def counting_bar(what: str, total: int, *, quiet: bool) -> Iterator[Callable[[int], None]]:
    """A bar on a terminal; what it gives takes how many are done."""
    console = notes()
    columns = (TextColumn("{task.description}"), BarColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, disable=quiet or not console.is_terminal) as progress:
        task = progress.add_task(what, total=total)
        yield lambda done: progress.update(task, completed=done)
