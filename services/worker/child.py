"""The supervisor's end of a runner: start it, order, listen, stop, kill; and the idle ones kept for the next step."""

import contextlib
import json
import logging
import os
import queue
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Final

from scanjobs.settings import Settings

from services.worker.protocol import TASKS_VARIABLE, Line, Order, encode, run_line

log = logging.getLogger(__name__)

ON_THE_WAY: Final = frozenset({"progress", "saved"})
"""Lines of a step that goes on."""
THREAD_VARIABLES: Final = (
    "OMP_NUM_THREADS",
    "NUMBA_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "NERFMODAL_THREADS",
)


class Child:
    """One runner process, in a session of its own so that a terminal's Ctrl-C reaches its supervisor alone."""

    def __init__(self, kind: str, device: str | None, settings: Settings, log_path: Path) -> None:
        self.kind = kind
        self.device = device
        self.log_path = log_path
        self.steps = 0
        self.is_busy = False
        self.idle_since = time.monotonic()
        self._lines: queue.SimpleQueue[Line | None] = queue.SimpleQueue()
        log_path.parent.mkdir(parents=True, exist_ok=True)
        with log_path.open("ab") as output:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "services.worker.runner"],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=output,
                env=runner_environment(settings, device),
                start_new_session=True,
            )
        threading.Thread(target=self._listen, name=f"listen-{self.pid}", daemon=True).start()

    @property
    def pid(self) -> int:
        """The runner's process id."""
        return self._process.pid

    @property
    def exit_code(self) -> int | None:
        """How it ended; negative for a signal, None while it lives."""
        return self._process.poll()

    def order(self, order: Order) -> None:
        """Give it a step to compute."""
        self.steps += 1
        self.is_busy = True
        self._send(run_line(order))

    def receive(self, timeout_s: float) -> Line | None:
        """Its next line. Raises `queue.Empty` when it says nothing in time; None when it has died."""
        line = self._lines.get(timeout=timeout_s)
        self.is_busy = line is not None and not line.keys().isdisjoint(ON_THE_WAY)
        return line

    def stop(self, grace_s: float) -> Path | None:
        """Ask it to stop its step, and kill it if it has not in `grace_s` seconds; the last file that it saved."""
        self._send({"stop": True})
        saved: Path | None = None
        deadline = time.monotonic() + grace_s
        while (left := deadline - time.monotonic()) > 0:
            try:
                line = self.receive(left)
            except queue.Empty:
                break
            if line is not None and "saved" in line:
                saved = Path(line["saved"])
            if not self.is_busy:
                break
        self.kill()
        return saved

    def kill(self) -> None:
        """End it now, with everything it has started."""
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self.pid, signal.SIGKILL)
        self._process.wait()
        self._close_pipes()

    def _send(self, line: Line) -> None:
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(encode(line))
            self._process.stdin.flush()
        except (BrokenPipeError, ValueError):
            log.info("runner %s is gone", self.pid)  # `receive` will say so

    def _listen(self) -> None:
        assert self._process.stdout is not None
        with self._process.stdout as answers:
            try:
                for text in answers:
                    self._lines.put(json.loads(text))
            except ValueError:
                log.warning("runner %s said what is no JSON", self.pid)
        self._lines.put(None)

    def _close_pipes(self) -> None:
        if self._process.stdin is not None:
            with contextlib.suppress(BrokenPipeError):
                self._process.stdin.close()


class Children:
    """Idle runners by kind. A step takes one or starts one, and gives it back; one that has been killed is dropped."""

    def __init__(self, settings: Settings, log_folder: Path) -> None:
        self._settings = settings
        self._log_folder = log_folder
        self._idle: list[Child] = []
        self._started = 0
        self._lock = threading.Lock()

    def take(self, kind: str, device: str | None = None) -> Child:
        """A runner that has loaded what steps of this kind need (and holds the device), or a new one."""
        with self._lock:
            self._started += 1
            number = self._started
            fit = (one for one in reversed(self._idle) if (one.kind, one.device) == (kind, device))
            child = next((one for one in fit if one.exit_code is None), None)
            if child is not None:
                self._idle.remove(child)
                return child
        return Child(kind, device, self._settings, self._log_folder / f"{kind}-{number}.log")

    def give_back(self, child: Child) -> None:
        """Keep a runner for the next step of its kind, unless it has done its share."""
        if child.exit_code is not None:
            return
        if child.is_busy or child.steps >= self._settings.runner_steps:
            child.kill()
            return
        child.idle_since = time.monotonic()
        with self._lock:
            self._idle.append(child)

    def end_idle(self, older_than_s: float) -> None:
        """End the runners that have waited long; they hold memory."""
        limit = time.monotonic() - older_than_s
        with self._lock:
            old = [child for child in self._idle if child.idle_since <= limit]
            self._idle = [child for child in self._idle if child.idle_since > limit]
        for child in old:
            child.kill()


def runner_environment(settings: Settings, device: str | None = None) -> dict[str, str]:
    """The environment of a runner: this one, its number of threads, its GPU, its tasks, and where to import from."""
    threads = dict.fromkeys(THREAD_VARIABLES, str(settings.threads_per_runner))
    path = os.pathsep.join(part for part in sys.path if part)
    gpu = {} if device is None else {"CUDA_VISIBLE_DEVICES": device.removeprefix("gpu:")}
    return {**os.environ, **threads, **gpu, TASKS_VARIABLE: settings.tasks, "PYTHONPATH": path, "PYTHONUNBUFFERED": "1"}
