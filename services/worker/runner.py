"""The child process that computes: orders on stdin, progress and results on stdout, one JSON object a line.

It ends itself when its stdin closes, so it never outlives its supervisor. The real stdout is duplicated away before
anything heavy is imported: whatever Blender or a C library prints goes to the log.
"""

import errno
import importlib
import json
import os
import queue
import sys
import threading
import time
import traceback
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, BinaryIO, Final

from nerfmodal.errors import InvalidInput, MissingExtra, NerfmodalError
from nerfmodal.progress import Progress
from nerfmodal.spec import ScanSpec

from services.worker.job import GivenFile, Job, StepStopped, Task, save_nothing
from services.worker.protocol import (
    DISK_FULL,
    TASKS_VARIABLE,
    Failed,
    Line,
    Order,
    encode,
    failed_line,
    produced_line,
    saved_line,
)

REPORT_S: Final = 0.1
DEFAULT_TASKS: Final = "services.worker.tasks"


class Runner:
    """Takes orders one after the other until its stdin closes."""

    def __init__(self, orders: BinaryIO, answers: BinaryIO, load: Callable[[], Mapping[str, Task]]) -> None:
        self._orders = orders
        self._answers = answers
        self._load = load
        self._waiting: queue.SimpleQueue[Order] = queue.SimpleQueue()
        self._stop = threading.Event()
        self._told_at = 0.0

    def work(self) -> None:
        """Never returns: the reading thread ends the process."""
        threading.Thread(target=self._read, daemon=True).start()  # first: loading takes seconds
        tasks = self._load()
        while True:
            order = self._waiting.get()
            self._say(answer(order, tasks, self._report, self._save))

    def _read(self) -> None:
        for text in self._orders:
            line = json.loads(text)
            if "run" in line:
                self._stop.clear()
                self._waiting.put(Order(**line["run"]))
            elif "stop" in line:
                self._stop.set()
        os._exit(0)  # the supervisor is gone: nothing computed from here on would be accepted

    def _report(self, progress: Progress) -> None:
        if self._stop.is_set():
            raise StepStopped
        if progress.done < progress.total and time.monotonic() - self._told_at < REPORT_S:
            return  # a stage may report thousands of times a second
        self._told_at = time.monotonic()
        self._say({"progress": {"done": progress.done, "total": progress.total, "message": progress.message}})

    def _save(self, path: Path) -> None:
        self._say(saved_line(path))

    def _say(self, line: Line) -> None:
        self._answers.write(encode(line))
        self._answers.flush()


def answer(
    order: Order,
    tasks: Mapping[str, Task],
    report: Callable[[Progress], None],
    save: Callable[[Path], None] = save_nothing,
) -> Line:
    """Compute one order; every way it can end is a line."""
    try:
        produced = tasks[order.kind](_job(order, save), report)
        return produced_line(produced.files, produced.facts)
    except StepStopped:
        return failed_line(Failed(code="STOPPED", message="the step was asked to stop."))
    except NerfmodalError as error:
        return failed_line(_of_science(error))
    except MemoryError:
        return failed_line(Failed(code="OUT_OF_MEMORY", message="the step ran out of memory.", hint=_LESS_MEMORY))
    except OSError as error:
        traceback.print_exc()
        return failed_line(_of_system(error))
    except Exception as error:
        traceback.print_exc()
        return failed_line(_unexpected(error))


def main() -> None:
    """Run as `python -m services.worker.runner`, started by a supervisor."""
    orders, answers = _reserve_streams()
    Runner(orders, answers, _tasks).work()


_LESS_MEMORY: Final = "Use fewer points, pixels or slots, or a machine with more memory."


def _tasks() -> Mapping[str, Task]:
    module = importlib.import_module(os.environ.get(TASKS_VARIABLE, DEFAULT_TASKS))
    tasks: Mapping[str, Task] = module.TASKS
    return tasks


def _job(order: Order, save: Callable[[Path], None]) -> Job:
    inputs = (
        GivenFile(kind=one["kind"], frame=one["frame"], role=one["role"], path=Path(one["path"]))
        for one in order.inputs
    )
    spec = ScanSpec.model_validate(order.spec)
    return Job(
        kind=order.kind,
        frame=order.frame,
        spec=spec,
        inputs=tuple(inputs),
        out=Path(order.out),
        resume=None if order.resume is None else Path(order.resume),
        save=save,
        save_every_s=order.save_every_s,
    )


def _of_science(error: NerfmodalError) -> Failed:
    place = f"{error.where}: " if error.where else ""
    permanent = isinstance(error, InvalidInput | MissingExtra)
    return Failed(code=error.code, message=place + error.message, hint=error.hint, retryable=not permanent)


def _of_system(error: OSError) -> Failed:
    if error.errno == errno.ENOSPC:
        return Failed(code=DISK_FULL, message="the disk is full.", hint="Free some space; the scan then goes on.")
    return _unexpected(error)


def _unexpected(error: Exception) -> Failed:
    hint = "The worker's log has the traceback."
    return Failed(code="INTERNAL", message=f"{type(error).__name__}: {error}"[:2000], hint=hint)


def _reserve_streams() -> tuple[Any, Any]:
    """The pipes to the supervisor, under numbers that nothing else prints to or reads from."""
    orders, answers = os.dup(0), os.dup(1)
    os.dup2(2, 1)
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    os.close(nothing)
    sys.stdout = sys.stderr
    return os.fdopen(orders, "rb"), os.fdopen(answers, "wb")


if __name__ == "__main__":
    main()
