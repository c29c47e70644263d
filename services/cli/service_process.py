"""A service in a child process: started, waited for, stopped with everything it has started, and checked to be gone."""

import os
import signal
import subprocess
import sys
import time
import uuid
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from nerfmodal.errors import NerfmodalError

from services.cli.address import announced

START_S = 90.0
DRAIN_S = 20.0
MARK = "NERFMODAL_STARTED_BY"
"""A variable that everything the service starts inherits, in whatever session it lives."""


class ServiceDidNotStart(NerfmodalError):
    """The embedded service ended or stayed silent; its log says why."""

    code = "SERVICE_DID_NOT_START"


class ServiceLeftProcesses(NerfmodalError):
    """Processes of the service outlived it and were killed."""

    code = "SERVICE_LEFT_PROCESSES"


@dataclass(frozen=True, slots=True)
class RunningService:
    """A service that answers at `address`."""

    address: str
    pid: int


@contextmanager
def running_service(data_folder: Path, log: Path, captures: Sequence[Path] = ()) -> Iterator[RunningService]:
    """A service on `data_folder` while the block runs.

    Raises
    ------
    ServiceDidNotStart
        It did not answer in time; the last lines of its log are in the message.
    ServiceLeftProcesses
        After the block: something it had started was still there (and has been killed).
    """
    mark = uuid.uuid4().hex
    log.parent.mkdir(parents=True, exist_ok=True)
    process = _start(data_folder, log, captures, mark)
    try:
        yield RunningService(_wait_for_address(process, data_folder, log), process.pid)
    finally:
        _stop(process)
        left = _kill_rest(mark)
    if left:
        raise ServiceLeftProcesses(f"{len(left)} processes had to be killed: {left}.", hint=f"See {log}.")


def processes_with(variable: str, value: str) -> list[int]:
    """Every process started with this in its environment, but this one. Looks into /proc; elsewhere finds none."""
    wanted = f"{variable}={value}".encode()
    return [pid for pid in _pids() if pid != os.getpid() and wanted in _environment(pid).split(b"\0")]


def _start(data_folder: Path, log: Path, captures: Sequence[Path], mark: str) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "services.cli.main", "up", "--port", "0", "--data", str(data_folder)]
    for folder in captures:
        command += ["--captures", str(folder)]
    path = os.pathsep.join(part for part in sys.path if part)
    with log.open("wb") as output:
        return subprocess.Popen(
            [*command, "--until-stdin-closes"],
            stdin=subprocess.PIPE,
            stdout=output,
            stderr=subprocess.STDOUT,
            env={**os.environ, MARK: mark, "PYTHONPATH": path},
            start_new_session=True,
        )


def _wait_for_address(process: subprocess.Popen[bytes], data_folder: Path, log: Path) -> str:
    deadline = time.monotonic() + START_S
    while process.poll() is None and time.monotonic() < deadline:
        address = announced(data_folder)
        if address is not None:
            return address
        time.sleep(0.05)
    ending = "gave no address in time" if process.poll() is None else f"ended with code {process.returncode}"
    raise ServiceDidNotStart(f"the service {ending}:\n{tail(log)}", hint="Try: nerfmodal doctor")


def _stop(process: subprocess.Popen[bytes]) -> None:
    """Ask it to end; kill its group where it does not."""
    assert process.stdin is not None
    process.terminate()
    try:
        process.wait(DRAIN_S)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    process.stdin.close()


def _kill_rest(mark: str) -> list[int]:
    """Kill what still carries the mark after a moment; returns what had to be killed."""
    for _ in range(20):
        if not processes_with(MARK, mark):
            return []
        time.sleep(0.1)
    left = processes_with(MARK, mark)
    for pid in left:
        _kill(pid)
    return left


def _kill(pid: int) -> None:
    try:
        os.kill(pid, signal.SIGKILL)
    except ProcessLookupError:
        return


def _pids() -> list[int]:
    proc = Path("/proc")
    return [int(entry.name) for entry in proc.iterdir() if entry.name.isdigit()] if proc.is_dir() else []


def _environment(pid: int) -> bytes:
    """What a process was started with; nothing of one that has just ended or is somebody else's."""
    try:
        return Path(f"/proc/{pid}/environ").read_bytes()
    except OSError:
        return b""


def tail(log: Path, lines: int = 15) -> str:
    """The last lines of a log."""
    text = log.read_text(errors="replace") if log.exists() else ""
    return "\n".join(text.splitlines()[-lines:])
