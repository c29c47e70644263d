"""Fault 15: a disk that runs full under a running scan, and is freed again. Needs the right to mount a tmpfs."""

import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from scanjobs.messages import TRAIN
from scanjobs.settings import Settings

from tests.integration.toy_service import Service, serving, toy_settings, toy_spec


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of 8 MB."""
    folder = tmp_path / "small"
    folder.mkdir()
    mount = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=8m", "tmpfs", str(folder)], check=False)
    if mount.returncode:
        pytest.skip("a tmpfs cannot be mounted here: run the tests as root")
    yield folder
    subprocess.run(["umount", "--lazy", str(folder)], check=True)


def fill(folder: Path) -> Path:
    """Write until nothing more fits."""
    ballast = folder / "ballast"
    with ballast.open("wb", buffering=0) as file:
        for size in (1 << 16, 1 << 12, 1):
            try:
                while True:
                    file.write(b"x" * size)
            except OSError:
                continue
    return ballast


@pytest.mark.parametrize("full_s", [1.0, 6.0], ids=["shorter than the lease", "longer than the lease"])
def test_full_disk_corrupts_nothing_and_the_scan_goes_on_when_it_is_freed(small_disk: Path, full_s: float) -> None:
    """Promise (i). Database, files and artifacts on one full disk: nothing can be written down, and all is well
    afterwards.

    Guard: a tick that fails is tried again (`Ticker._run`). Seen to fail: with `_run` letting errors out, it dies
    with the first beat that cannot be written, and the scan never ends.
    """
    fill_in_mid_scan(toy_settings(small_disk), small_disk, full_s)


def test_full_artifact_store_costs_no_attempt(small_disk: Path, tmp_path: Path) -> None:
    """Full for longer than three attempts take. Guard: `counted` in `of_system`.

    Seen to fail: with True the scan has failed before the disk is freed.
    """
    fill_in_mid_scan(toy_settings(tmp_path).model_copy(update={"artifact_folder": small_disk}), small_disk, 8.0)


def fill_in_mid_scan(settings: Settings, disk: Path, seconds: float) -> None:
    """Run a scan, fill the disk after the first training has begun, and free it again."""
    with serving(settings.model_copy(update={"disk_low_mb": 0})) as service:
        scan_id = service.submit(toy_spec(frames=4))
        service.wait(lambda: any(step.kind == TRAIN and step.token for step in service.steps(scan_id)))
        ballast = fill(disk)
        time.sleep(seconds)
        assert service.scan(scan_id).state == "running", "a database on a full disk can still be read"
        ballast.unlink()
        assert service.end_of(scan_id).state == "succeeded"
        assert_each_accepted_once(service, scan_id)


def assert_each_accepted_once(service: Service, scan_id: str) -> None:
    """Fsck finds nothing; that includes one accepted attempt for every step."""
    assert service.violations() == ()
    assert {step.state for step in service.steps(scan_id)} == {"succeeded"}
