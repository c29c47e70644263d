"""A service of toy steps in a folder of its own: SQLite, the in-memory broker, real runner processes."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from nerfmodal.spec import ScanSpec
from scanjobs import repository
from scanjobs.artifacts import ArtifactStore
from scanjobs.fsck import check
from scanjobs.settings import Settings
from scanjobs.states import TERMINAL_SCAN_STATES
from scanjobs.store import Store, open_store
from scanjobs.tables import Scan

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

    def wait(self, what: Callable[[], bool], seconds: float = 30.0) -> None:
        """Until `what` holds."""
        deadline = time.monotonic() + seconds
        while not what():
            if time.monotonic() > deadline:
                raise TimeoutError("what the test waits for did not happen")
            time.sleep(0.05)

    def end_of(self, scan_id: str, seconds: float = 30.0) -> Scan:
        """Wait for the scan to end."""
        self.wait(lambda: self.scan(scan_id).state in TERMINAL_SCAN_STATES, seconds)
        return self.scan(scan_id)

    def violations(self) -> tuple[str, ...]:
        """What fsck finds."""
        with self.store.read() as session:
            return check(session, ArtifactStore(self.settings.artifacts))


@pytest.fixture
def settings(tmp_path: Path) -> Settings:
    """A short lease, quick ticks, two slots, toys."""
    return Settings(
        data_folder=tmp_path / "data", tasks=TOYS, slots=2, lease_s=4.0, tick_s=0.2, watch_s=0.1, resend_s=3.0
    )


@contextmanager
def serving(settings: Settings) -> Iterator[Service]:
    """The service, running while the block does."""
    with embedded_worker(settings):
        store = open_store(settings.database)
        try:
            yield Service(settings, store)
        finally:
            store.close()


@pytest.fixture
def service(settings: Settings) -> Iterator[Service]:
    """A running toy service; the database is sound when the test ends."""
    with serving(settings) as running:
        yield running
        assert running.violations() == ()
