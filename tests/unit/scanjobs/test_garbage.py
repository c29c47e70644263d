"""What is collected, and above all what is not."""

from pathlib import Path

import pytest
from nerfmodal.spec import ScanSpec
from scanjobs import control, dispatch, leases, repository, workers
from scanjobs.artifacts import ArtifactStore, Stored
from scanjobs.errors import IllegalTransition, NotFound
from scanjobs.fanin import Output
from scanjobs.garbage import collect_garbage
from scanjobs.messages import QUEUES
from scanjobs.store import Store
from scanjobs.workers import WorkerIdentity


@pytest.fixture
def files(tmp_path: Path) -> ArtifactStore:
    """An empty artifact store."""
    return ArtifactStore(tmp_path / "artifacts")


def stored(files: ArtifactStore, content: str) -> Stored:
    """A stored file."""
    path = files.folder.parent / "file"
    path.write_text(content)
    return files.put(path)


def finished_scan(store: Store, spec: ScanSpec, made: Stored) -> str:
    """A cancelled scan whose first step had made a file."""
    identity = WorkerIdentity(id="w", host="here", pid=1, queues=QUEUES, slots=100)
    store.write(lambda session: workers.register(session, identity, 600.0))
    scan_id = store.write(lambda session: repository.insert_scan(session, spec)).scan.id
    message = store.write(dispatch.dispatch)[0]
    claim = store.write(lambda session: leases.claim(session, message.step_id, "w", 60.0))
    assert claim is not None
    output = Output(role="frame", name="n", digest=made.digest, size=made.size, media_type="x")
    store.write(lambda session: leases.finish(session, claim, [output], {}))
    store.write(lambda session: control.cancel_scan(session, scan_id))
    return scan_id


def test_only_old_files_without_a_reference_go(store: Store, spec: ScanSpec, files: ArtifactStore) -> None:
    used, unused = stored(files, "used"), stored(files, "unused")
    finished_scan(store, spec, used)
    assert collect_garbage(store, files) == ()
    assert collect_garbage(store, files, older_than_s=-1.0) == (unused.digest,)
    assert set(files.digests()) == {used.digest}
    assert files.path(used.digest).read_text() == "used"


def test_empty_database_is_not_believed(store: Store, files: ArtifactStore) -> None:
    kept = stored(files, "kept")
    assert collect_garbage(store, files, older_than_s=-1.0) == ()
    assert set(files.digests()) == {kept.digest}


def test_files_of_a_deleted_scan_go_unless_a_fork_has_them(store: Store, spec: ScanSpec, files: ArtifactStore) -> None:
    made = stored(files, "made")
    scan_id = finished_scan(store, spec, made)
    fork = store.write(lambda session: control.fork_scan(session, scan_id, spec))
    store.write(lambda session: control.delete_scan(session, scan_id))
    with store.read() as session, pytest.raises(NotFound):
        repository.get_scan(session, scan_id)
    assert collect_garbage(store, files, older_than_s=-1.0) == ()
    store.write(lambda session: control.cancel_scan(session, fork.id))
    store.write(lambda session: control.delete_scan(session, fork.id))
    assert collect_garbage(store, files, older_than_s=-1.0) == (made.digest,)


def test_scan_that_runs_cannot_be_deleted(store: Store, spec: ScanSpec) -> None:
    scan = store.write(lambda session: repository.insert_scan(session, spec)).scan
    with pytest.raises(IllegalTransition):
        store.write(lambda session: control.delete_scan(session, scan.id))
