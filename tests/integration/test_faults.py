"""What happens to a scan when something is killed, cancelled, repeated or broken while it runs."""

from pathlib import Path

import pytest
from nerfmodal.spec import ReconstructionSpec
from scanjobs import control, repository
from scanjobs.artifacts import ArtifactStore
from scanjobs.errors import DataFolderInUse, IllegalTransition
from scanjobs.messages import EXTRACT, IDENTIFY, TRAIN
from scanjobs.plan import WHOLE_SCAN

from services.worker.app import embedded_worker
from tests.integration.toy_service import Service, is_alive, toy_spec


def test_runner_that_always_dies_fails_the_scan_with_a_hint(service: Service) -> None:
    scan = service.end_of(service.submit(toy_spec(trouble=f"{TRAIN}:-1:die")))
    assert scan.state == "failed"
    assert scan.error is not None
    assert (scan.error["step"], scan.error["code"]) == (TRAIN, "RUNNER_DIED")
    assert "memory" in scan.error["hint"]
    assert service.step(scan.id, TRAIN, WHOLE_SCAN).attempt == 3


def test_ended_scan_cannot_be_cancelled(service: Service) -> None:
    scan = service.end_of(service.submit(toy_spec(frames=1)))
    with pytest.raises(IllegalTransition):
        service.store.write(lambda session: control.cancel_scan(session, scan.id))


def test_permanent_error_fails_at_once_with_its_remedy(service: Service) -> None:
    scan = service.end_of(service.submit(toy_spec(trouble=f"{TRAIN}:1:invalid")))
    assert scan.state == "failed"
    assert scan.error == {
        "step": TRAIN,
        "frame": 1,
        "code": "INVALID_INPUT",
        "message": "/source: the toy is broken.",
        "hint": "Mend the toy.",
        "retryable": False,
    }
    assert service.step(scan.id, TRAIN, 1).attempt == 1


def test_second_server_on_one_data_folder_is_refused(service: Service) -> None:
    with pytest.raises(DataFolderInUse), embedded_worker(service.settings):
        pass


def test_retry_of_one_frame_computes_that_frame_and_the_identification(service: Service) -> None:
    scan = service.end_of(service.submit(toy_spec(frames=3)))
    service.store.write(lambda session: control.retry_scan(session, scan.id, from_kind=TRAIN, frames=[2]))
    assert service.end_of(scan.id).state == "succeeded"
    computed = {(step.kind, step.frame) for step in service.steps(scan.id) if step.token}
    assert computed == {(TRAIN, 2), (EXTRACT, 2), (IDENTIFY, -1)}


def test_retry_after_a_failure_keeps_what_succeeded(service: Service, tmp_path: Path) -> None:
    scan = service.end_of(service.submit(toy_spec(frames=2, trouble=f"{IDENTIFY}:-1:invalid_until={tmp_path}/mended")))
    assert scan.state == "failed"
    (tmp_path / "mended").touch()
    service.store.write(lambda session: control.retry_scan(session, scan.id))
    again = service.end_of(scan.id)
    assert (again.state, again.error) == ("succeeded", None)
    assert [step.kind for step in service.steps(scan.id) if step.token] == [IDENTIFY]


def test_fork_with_another_training_renders_nothing_and_trains_all(service: Service) -> None:
    spec = toy_spec(frames=2, seed=6)
    scan = service.end_of(service.submit(spec))
    other = spec.model_copy(update={"reconstruction": ReconstructionSpec(iterations=7)})
    fork = service.store.write(lambda session: control.fork_scan(session, scan.id, other))
    assert service.end_of(fork.id).state == "succeeded"
    computed = [step.kind for step in service.steps(fork.id) if step.token]
    assert computed == [TRAIN] * 3 + [EXTRACT] * 2 + [IDENTIFY]


def test_fork_that_changes_nothing_has_succeeded_already(service: Service) -> None:
    spec = toy_spec(frames=2, seed=7)
    scan = service.end_of(service.submit(spec))
    fork = service.store.write(lambda session: control.fork_scan(session, scan.id, spec))
    assert fork.state == "succeeded"


def test_same_specification_submitted_anew_is_computed(service: Service) -> None:
    first = service.end_of(service.submit(toy_spec(frames=1, seed=8)))
    second = service.end_of(service.submit(toy_spec(frames=1, seed=8)))
    assert first.id != second.id
    assert all(step.token == 1 for step in service.steps(second.id))


def test_rotten_checkpoint_is_trained_again_by_a_plain_retry(service: Service, tmp_path: Path) -> None:
    """One file under all children: none of them can use it, and the retry heals it without being told where."""
    scan = service.end_of(service.submit(toy_spec(seed=9, trouble=f"{IDENTIFY}:-1:invalid_until={tmp_path}/mended")))
    (tmp_path / "mended").touch()
    artifacts = ArtifactStore(service.settings.artifacts)
    with service.store.read() as session:
        clouds = repository.list_artifacts(session, scan, kind=EXTRACT)
    rotten = artifacts.place(clouds[0].digest)
    rotten.chmod(0o644)
    rotten.write_text("rot")
    service.store.write(lambda session: control.retry_scan(session, scan.id))
    failed = service.end_of(scan.id)
    assert failed.error is not None
    assert failed.error["code"] == "ARTIFACT_DAMAGED"
    service.store.write(lambda session: control.retry_scan(session, scan.id))
    assert service.end_of(scan.id).state == "succeeded"
    assert [step.kind for step in service.steps(scan.id) if step.token] == [EXTRACT, IDENTIFY]


def test_deadline_ends_the_scan_and_what_it_computes(service: Service) -> None:
    spec = toy_spec(trouble=f"{TRAIN}:-1:slow")
    scan_id = service.store.write(lambda session: repository.insert_scan(session, spec, deadline_s=3.0)).scan.id
    runner = service.runner_of(scan_id, TRAIN, WHOLE_SCAN)
    scan = service.end_of(scan_id, 10)
    assert (scan.state, (scan.error or {})["code"]) == ("failed", "DEADLINE_PASSED")
    service.wait(lambda: not is_alive(runner), 3)
