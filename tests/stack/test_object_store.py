"""Workers that share nothing but PostgreSQL, Redis and an S3: each has a data folder, and so a cache, of its own."""

import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
from scanjobs.garbage import collect_garbage
from scanjobs.messages import IDENTIFY, TRAIN
from scanjobs.migrate import upgrade
from scanjobs.object_store import ObjectArtifacts, open_artifacts
from scanjobs.plan import WHOLE_SCAN
from scanjobs.settings import Settings

from tests.integration.toy_service import looking_at, toy_spec, worker_process
from tests.stack.object_store import BUCKET, ObjectServer


@pytest.fixture
def objects(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[ObjectServer]:
    """An empty bucket that the environment points to."""
    server = ObjectServer(tmp_path)
    for name, value in server.environment.items():
        monkeypatch.setenv(name, value)
    yield server
    server.stop()


def on(settings: Settings, folder: Path) -> Settings:
    """The same service, seen from another machine."""
    return settings.model_copy(update={"data_folder": folder, "artifact_url": f"s3://{BUCKET}/nerfmodal"})


def test_machines_share_their_files_through_s3(settings: Settings, tmp_path: Path, objects: ObjectServer) -> None:
    """The worker that trains dies; the other machine goes on from what it had saved and finds every file it needs."""
    upgrade(settings.database)
    here, first, second = (on(settings, tmp_path / name) for name in ("here", "first", "second"))
    with looking_at(here) as service:
        scan_id = service.submit(toy_spec(frames=3, trouble=f"{TRAIN}:-1:chain=3"))
        with worker_process(first) as dying:
            service.runner_of(scan_id, TRAIN, WHOLE_SCAN)
            service.wait(lambda: service.step(scan_id, TRAIN, WHOLE_SCAN).progress_done >= 150)
            dying.signal(signal.SIGKILL)
            dying.wait(5)
        with worker_process(second):
            assert service.end_of(scan_id).state == "succeeded"
        taken_up = (service.step(scan_id, TRAIN, WHOLE_SCAN).facts or {})["taken_up_at"]
        assert taken_up > 0
        assert service.violations() == ()
        result = service.file(scan_id, IDENTIFY, WHOLE_SCAN, "result.npz")
        assert f"nerfmodal/{result[:2]}/{result}" in objects.stored()
        artifacts = open_artifacts(here)
        assert isinstance(artifacts, ObjectArtifacts)
        removed = collect_garbage(service.store, artifacts, older_than_s=-1.0)
        assert removed, "what the training had saved is needed no more"
        assert service.violations() == ()
