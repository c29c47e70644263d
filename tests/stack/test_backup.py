"""A backup taken while scans run is brought back elsewhere, is sound, and goes on to its end."""

import os
import shutil
import subprocess
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest
from scanjobs.migrate import upgrade
from scanjobs.settings import Settings
from scanjobs.states import StepState

from tests.conftest import new_database
from tests.integration.toy_service import Service, looking_at, toy_spec, worker_process
from tests.stack.servers import Postgres, installed_postgres, postgres_of_wheel

ROOT = Path(__file__).parents[2]


def run(script: str, argument: Path, settings: Settings, programs: Path) -> subprocess.CompletedProcess[str]:
    """A script of deploy/ with a service's environment."""
    environment = {
        **os.environ,
        "PATH": f"{programs}:{os.environ['PATH']}",
        "NERFMODAL_DATABASE_URL": settings.database_url,
        "NERFMODAL_ARTIFACT_FOLDER": str(settings.artifacts),
    }
    command = [str(ROOT / "deploy" / script), str(argument)]
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=False)


@pytest.fixture
def programs() -> Path:
    """Where pg_dump and its siblings are."""
    return installed_postgres() or postgres_of_wheel()


def finished(service: Service, scan_id: str, count: int) -> bool:
    return sum(step.state == StepState.SUCCEEDED for step in service.steps(scan_id)) >= count


def waiting_for(service: Service, scan_id: str, count: int) -> Callable[[], bool]:
    return partial(finished, service, scan_id, count)


def test_running_service_is_backed_up_and_brought_back(
    settings: Settings, postgres: Postgres, programs: Path, tmp_path: Path
) -> None:
    """What was accepted before the backup is not computed again; what was not is; fsck finds nothing in either."""
    upgrade(settings.database)
    with looking_at(settings) as service, worker_process(settings):
        done = service.submit(toy_spec(frames=1))
        service.end_of(done)
        going_on = service.submit(toy_spec(frames=6, seed=1))
        service.wait(waiting_for(service, going_on, 5))
        backed_up = run("backup.sh", tmp_path / "backup", settings, programs)
    assert backed_up.returncode == 0, backed_up.stderr
    dump = Path(backed_up.stdout.strip())
    shutil.rmtree(settings.data_folder)

    again = settings.model_copy(
        update={"database_url": new_database(postgres, "template0"), "data_folder": tmp_path / "elsewhere"}
    )
    restored = run("restore.sh", dump, again, programs)
    assert restored.returncode == 0, restored.stderr
    upgrade(again.database)
    with looking_at(again) as service:
        before = {step.id: step.token for step in service.steps(going_on) if step.state == StepState.SUCCEEDED}
        assert len(before) >= 5
        assert service.scan(done).state == "succeeded"
        with worker_process(again):
            assert service.end_of(going_on).state == "succeeded"
        assert {step.id: step.token for step in service.steps(going_on) if step.id in before} == before
        assert service.violations() == ()


def test_backup_is_not_restored_over_a_service(settings: Settings, programs: Path, tmp_path: Path) -> None:
    upgrade(settings.database)
    backed_up = run("backup.sh", tmp_path / "backup", settings, programs)
    assert backed_up.returncode == 1  # no artifacts yet: nothing to copy is said, not passed over
    settings.artifacts.mkdir(parents=True)
    backed_up = run("backup.sh", tmp_path / "backup", settings, programs)
    restored = run("restore.sh", Path(backed_up.stdout.strip()), settings, programs)
    assert (restored.returncode, "not empty" in restored.stderr) == (2, True)


def test_sqlite_is_told_another_way(tmp_path: Path, programs: Path) -> None:
    refused = run("backup.sh", tmp_path, Settings(database_url="sqlite:///x.db", data_folder=tmp_path), programs)
    assert (refused.returncode, "stopped" in refused.stderr) == (2, True)
