"""A service of toy steps: what the tests of the queue submit, watch, break and wait for."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from nerfmodal.spec import ScanSpec
from scanjobs import repository
from scanjobs.fsck import check
from scanjobs.object_store import open_artifacts
from scanjobs.settings import Settings
from scanjobs.states import TERMINAL_SCAN_STATES, StepState
from scanjobs.store import Store, open_store
from scanjobs.tables import Attempt, Scan, Step
from sqlalchemy import select
from sqlalchemy.exc import DBAPIError

from services.worker.app import embedded_worker

TOYS = "tests.integration.toy_tasks"
MOTION = {"organ": "trunk", "shape": "bending_1", "frequency_hz": 1.0, "amplitude_m": 0.01}


def toy_spec(*, frames: int = 3, trouble: str = "", seed: int = 0, max_failed_frames: int = 0) -> ScanSpec:
    """A simulation whose plant's treatment tells the toys what goes wrong."""
    return ScanSpec.model_validate(
        {
            "source": {"kind": "simulation", "frames": frames, "frame_rate_hz": 30.0, "motion": [MOTION]},
            "plant": {"id": "toy", "treatment": trouble},
            "seed": seed,
            "max_failed_frames": max_failed_frames,
        }
    )


def toy_settings(folder: Path) -> Settings:
    """A short lease, quick ticks, two slots, toys."""
    return Settings(
        data_folder=folder / "data",
        tasks=TOYS,
        slots=2,
        lease_s=4.0,
        tick_s=0.2,
        watch_s=0.1,
        resend_s=3.0,
        save_every_s=0.5,
        gpus=0,
    )


class Service:
    """The database of a running toy service, and how to wait for it."""

    def __init__(self, settings: Settings, store: Store) -> None:
        self.settings = settings
        self.store = store

    def submit(self, spec: ScanSpec) -> str:
        """Insert a scan; its id."""
        return self.store.write(lambda session: repository.insert_scan(session, spec)).scan.id

    def scan(self, scan_id: str) -> Scan:
        """The scan as it stands."""
        with self.store.read() as session:
            return repository.get_scan(session, scan_id)

    def wait(self, what: Callable[[], bool], seconds: float = 60.0) -> None:
        """Until `what` holds; a database that is away for a moment has not said no."""
        deadline = time.monotonic() + seconds
        while not _holds(what):
            if time.monotonic() > deadline:
                raise TimeoutError("what the test waits for did not happen")
            time.sleep(0.05)

    def end_of(self, scan_id: str, seconds: float = 90.0) -> Scan:
        """Wait for the scan to end."""
        self.wait(lambda: self.scan(scan_id).state in TERMINAL_SCAN_STATES, seconds)
        return self.scan(scan_id)

    def step(self, scan_id: str, kind: str, frame: int) -> Step:
        """A step of the scan's present generation."""
        scan = self.scan(scan_id)
        with self.store.read() as session:
            steps = repository.list_steps(session, scan)
        return next(step for step in steps if (step.kind, step.frame) == (kind, frame))

    def steps(self, scan_id: str) -> tuple[Step, ...]:
        """All steps of the scan's present generation."""
        scan = self.scan(scan_id)
        with self.store.read() as session:
            return repository.list_steps(session, scan)

    def runner_of(self, scan_id: str, kind: str, frame: int, *, seconds: float = 60.0, mark: Path | None = None) -> int:
        """Wait until a process computes the step (and has left its mark, if it does); its id."""
        pids: list[int] = []

        def has_runner() -> bool:
            step = self.step(scan_id, kind, frame)
            with self.store.read() as session:
                attempt = session.get(Attempt, (step.id, step.token))
            if mark is not None and not mark.exists():
                return False
            if step.state == StepState.RUNNING and attempt is not None and attempt.pid is not None:
                pids.append(attempt.pid)
            return bool(pids)

        self.wait(has_runner, seconds)
        return pids[0]

    def runners(self) -> dict[str, int]:
        """Steps that are computed now, and the processes that compute them."""
        query = select(Attempt.step_id, Attempt.pid).join(Step, Step.id == Attempt.step_id)
        query = query.where(Step.state == StepState.RUNNING, Step.token == Attempt.token, Attempt.pid.is_not(None))
        with self.store.read() as session:
            return {step_id: pid for step_id, pid in session.execute(query) if pid is not None}

    def file(self, scan_id: str, kind: str, frame: int, role: str) -> str:
        """Digest of a file that a step of the scan has made."""
        with self.store.read() as session:
            found = repository.find_artifact(session, self.scan(scan_id), role, kind=kind, frame=frame)
        return found.digest

    def violations(self) -> tuple[str, ...]:
        """What fsck finds."""
        with self.store.read() as session:
            return check(session, open_artifacts(self.settings))


def _holds(what: Callable[[], bool]) -> bool:
    try:
        return what()
    except DBAPIError:
        return False


@contextmanager
def serving(settings: Settings) -> Iterator[Service]:
    """The service inside this process, running while the block does."""
    with embedded_worker(settings), looking_at(settings) as service:
        yield service


@contextmanager
def looking_at(settings: Settings) -> Iterator[Service]:
    """The database alone."""
    store = open_store(settings.database)
    try:
        yield Service(settings, store)
    finally:
        store.close()


class WorkerProcess:
    """`python -m services.worker.main` in a session of its own; whatever it leaves behind is killed at the end."""

    def __init__(self, settings: Settings, module: str = "services.worker.main") -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-m", module], env=_environment(settings), start_new_session=True
        )

    @property
    def pid(self) -> int:
        """Its process id."""
        return self._process.pid

    def signal(self, number: signal.Signals) -> None:
        """Send it a signal (the process alone, not its runners)."""
        self._process.send_signal(number)

    def wait(self, seconds: float) -> int:
        """Its exit code."""
        return self._process.wait(seconds)

    def close(self) -> None:
        """Kill it, if it lives."""
        self._process.kill()
        self._process.wait()


@contextmanager
def worker_process(settings: Settings, module: str = "services.worker.main") -> Iterator[WorkerProcess]:
    """A worker in a process of its own, killed when the block ends."""
    process = WorkerProcess(settings, module)
    try:
        yield process
    finally:
        process.close()


def is_alive(pid: int) -> bool:
    """Whether a process computes; a zombie that nobody has waited for does not."""
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except FileNotFoundError:
        return False
    return state != "Z"


def _environment(settings: Settings) -> dict[str, str]:
    values = settings.model_dump(mode="json", exclude={"artifact_folder", "capture_roots"})
    variables = {f"NERFMODAL_{name.upper()}": str(value) for name, value in values.items() if value is not None}
    return {**os.environ, **variables}
