"""What is collected, and above all what is not."""

import os
from pathlib import Path

import pytest
from nerfmodal.spec import IdentificationSpec, ScanSpec
from scanjobs import control, dispatch, leases, repository, workers
from scanjobs.artifacts import ArtifactStore, Stored
from scanjobs.chores import is_mine
from scanjobs.claims import Claim
from scanjobs.errors import IllegalTransition, NotFound
from scanjobs.fanin import Output
from scanjobs.fsck import check
from scanjobs.garbage import collect_garbage, drop_checkpoints, sweep_staging
from scanjobs.leases import Failure
from scanjobs.messages import EXTRACT, IDENTIFY, QUEUES, TRAIN
from scanjobs.settings import Settings
from scanjobs.store import Store
from scanjobs.workers import WorkerIdentity

BROKEN = Failure(code="X", message="x.", retryable=False)


@pytest.fixture
def files(tmp_path: Path) -> ArtifactStore:
    """An empty artifact store."""
    return ArtifactStore(tmp_path / "artifacts")


def stored(files: ArtifactStore, content: str) -> Stored:
    """A stored file."""
    path = files.folder.parent / "file"
    path.write_text(content)
    return files.put(path)


def begun_scan(store: Store, spec: ScanSpec) -> tuple[str, Claim]:
    """A scan whose first step is under way."""
    identity = WorkerIdentity(id="w", host="here", pid=1, queues=QUEUES, slots=100)
    store.write(lambda session: workers.register(session, identity, 600.0))
    scan_id = store.write(lambda session: repository.insert_scan(session, spec)).scan.id
    message = store.write(dispatch.dispatch)[0]
    claim = store.write(lambda session: leases.claim(session, message.step_id, "w", 60.0))
    assert claim is not None
    return scan_id, claim


def half_done(store: Store, files: ArtifactStore, claim: Claim) -> Output:
    """What a step that is under way has saved of itself."""
    saved = stored(files, "half a training")
    output = Output(role="resume", name="n", digest=saved.digest, size=saved.size, media_type="x")
    assert store.write(lambda session: leases.save(session, claim, output))
    return output


def finished_scan(store: Store, spec: ScanSpec, made: Stored) -> str:
    """A cancelled scan whose first step had made a file."""
    scan_id, claim = begun_scan(store, spec)
    output = Output(role="frame", name="n", digest=made.digest, size=made.size, media_type="x")
    store.write(lambda session: leases.finish(session, claim, [output], {}))
    store.write(lambda session: control.cancel_scan(session, scan_id))
    return scan_id


def test_only_old_files_without_a_reference_go(store: Store, spec: ScanSpec, files: ArtifactStore) -> None:
    """Guards: age and reference.

    Seen to fail: at any age the file of a moment ago goes; with `needed` not asked, the used one.
    """
    used, unused = stored(files, "used"), stored(files, "unused")
    finished_scan(store, spec, used)
    assert collect_garbage(store, files) == ()
    assert collect_garbage(store, files, older_than_s=-1.0) == (unused.digest,)
    assert set(files.digests()) == {used.digest}
    assert files.path(used.digest).read_text() == "used"


def test_empty_database_is_not_believed(store: Store, files: ArtifactStore) -> None:
    """Guard: the count of scans in `collect_garbage`. Seen to fail: without it the file goes."""
    kept = stored(files, "kept")
    assert collect_garbage(store, files, older_than_s=-1.0) == ()
    assert set(files.digests()) == {kept.digest}


def test_files_of_a_deleted_scan_go_unless_a_fork_has_them(store: Store, spec: ScanSpec, files: ArtifactStore) -> None:
    """Guards: `delete_scan` drops its own references alone; what anybody refers to is needed.

    Seen to fail: with the references left the file stays for ever; with `needed` not asked the fork loses it.
    """
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
    """Guard: `SCAN_MOVES`. Seen to fail: with `deleting` among the moves of a queued scan."""
    scan = store.write(lambda session: repository.insert_scan(session, spec)).scan
    with pytest.raises(IllegalTransition):
        store.write(lambda session: control.delete_scan(session, scan.id))


def trained_scan(store: Store, spec: ScanSpec, files: ArtifactStore) -> tuple[str, dict[str, str]]:
    """A scan that has succeeded, and the digest of each step's file."""
    identity = WorkerIdentity(id="w", host="here", pid=1, queues=QUEUES, slots=100)
    store.write(lambda session: workers.register(session, identity, 600.0))
    scan_id = store.write(lambda session: repository.insert_scan(session, spec)).scan.id
    return scan_id, compute_all(store, files)


def compute_all(store: Store, files: ArtifactStore) -> dict[str, str]:
    """Compute what is there to be computed; a digest by kind and frame."""
    made: dict[str, str] = {}
    while messages := store.write(dispatch.dispatch):
        for message in messages:
            claim = store.write(lambda session, one=message.step_id: leases.claim(session, one, "w", 60.0))
            assert claim is not None
            name = f"{claim.kind}:{claim.frame}"
            one = stored(files, name)
            role = "checkpoint" if claim.kind == TRAIN else "frame"
            output = Output(role=role, name="n", digest=one.digest, size=one.size, media_type="x")
            store.write(lambda session, held=claim, out=output: leases.finish(session, held, [out], {}))
            made[name] = one.digest
    return made


def test_checkpoints_go_and_results_stay(store: Store, spec: ScanSpec, files: ArtifactStore) -> None:
    """Guards: age, role, and `_needed`, which leaves the dropped out.

    Seen to fail: without the age all four go at once; without the roles in `_drop` and `_is_of_use` eleven files are
    dropped instead of four.
    """
    _, made = trained_scan(store, spec, files)
    assert drop_checkpoints(store, 60.0) == 0
    assert drop_checkpoints(store, -1.0) == 4
    removed = collect_garbage(store, files, older_than_s=-1.0)
    assert set(removed) == {digest for name, digest in made.items() if name.startswith(TRAIN)}
    with store.read() as session:
        assert check(session, files) == ()


def test_fork_after_retention_still_trains_nothing(store: Store, spec: ScanSpec, files: ArtifactStore) -> None:
    """Guard: a dropped file keeps its row and its references (`_forget`).

    Seen to fail: with them deleted all is trained.
    """
    scan_id, _ = trained_scan(store, spec, files)
    drop_checkpoints(store, -1.0)
    collect_garbage(store, files, older_than_s=-1.0)
    other = spec.model_copy(update={"identification": IdentificationSpec(max_modes=3)})
    store.write(lambda session: control.fork_scan(session, scan_id, other))
    assert set(compute_all(store, files)) == {f"{IDENTIFY}:-1"}


def test_retry_that_needs_dropped_checkpoints_makes_them_and_no_others(
    store: Store, spec: ScanSpec, files: ArtifactStore
) -> None:
    """Guard: `control._missing`. Seen to fail: with nothing missing the frame is extracted from a file that is gone."""
    scan_id, _ = trained_scan(store, spec, files)
    drop_checkpoints(store, -1.0)
    store.write(lambda session: control.retry_scan(session, scan_id, from_kind=IDENTIFY))
    assert set(compute_all(store, files)) == {f"{IDENTIFY}:-1"}
    store.write(lambda session: control.retry_scan(session, scan_id, from_kind=EXTRACT, frames=[1]))
    assert set(compute_all(store, files)) == {f"{TRAIN}:-1", f"{TRAIN}:1", f"{EXTRACT}:1", f"{IDENTIFY}:-1"}


def test_checkpoint_of_a_lost_frame_is_kept_for_its_retry(store: Store, spec: ScanSpec, files: ArtifactStore) -> None:
    """The shared checkpoint too: the lost frame's training starts from it.

    Guard: `unfinished` in `_is_of_use`. Seen to fail: without it the shared checkpoint is dropped as well.
    """
    identity = WorkerIdentity(id="w", host="here", pid=1, queues=QUEUES, slots=100)
    store.write(lambda session: workers.register(session, identity, 600.0))
    losing = spec.model_copy(update={"max_failed_frames": 1})
    store.write(lambda session: repository.insert_scan(session, losing))
    for message in store.write(dispatch.dispatch):
        claim = store.write(lambda session, one=message.step_id: leases.claim(session, one, "w", 60.0))
        assert claim is not None
        if claim.frame == 1:
            store.write(lambda session, held=claim: leases.fail(session, held, BROKEN, 3))
        else:
            store.write(lambda session, held=claim: leases.finish(session, held, [], {}))
    compute_all(store, files)
    assert drop_checkpoints(store, -1.0) == 2  # of frames 0 and 2


def test_what_a_live_step_has_saved_is_no_garbage(store: Store, spec: ScanSpec, files: ArtifactStore) -> None:
    """Guards: `saved` in `_needed`, and that only a claim that is held saves (`leases.save`).

    Seen to fail: without the first half a training goes; without the second a step that has ended saves.
    """
    _, claim = begun_scan(store, spec)
    output = half_done(store, files, claim)
    assert collect_garbage(store, files, older_than_s=-1.0) == ()
    store.write(lambda session: leases.finish(session, claim, (), {}))
    assert not store.write(lambda session: leases.save(session, claim, output))
    assert collect_garbage(store, files, older_than_s=-1.0) == (output.digest,)


def test_what_a_cancelled_step_has_saved_is_garbage(store: Store, spec: ScanSpec, files: ArtifactStore) -> None:
    """Guard: the states in `saved` of `_needed`. Seen to fail: without them it is kept for ever."""
    scan_id, claim = begun_scan(store, spec)
    output = half_done(store, files, claim)
    store.write(lambda session: control.cancel_scan(session, scan_id))
    assert store.write(lambda session: leases.stopped(session, claim))
    assert collect_garbage(store, files, older_than_s=-1.0) == (output.digest,)


def test_chore_is_done_by_one_of_many_once_in_its_interval(store: Store) -> None:
    """Guard: `begun_at` in `is_mine`. Seen to fail: without it everybody does it."""
    assert [store.write(lambda session: is_mine(session, "collect", 60.0)) for _ in range(3)] == [True, False, False]
    assert store.write(lambda session: is_mine(session, "collect", 0.0))
    assert store.write(lambda session: is_mine(session, "other", 60.0))


def test_what_dead_processes_left_is_swept_when_it_is_old(tmp_path: Path) -> None:
    """Guard: the age. Seen to fail: without it a capture is swept while it is put together."""
    settings = Settings(data_folder=tmp_path / "data")
    kept, old = (settings.captures / ".staging" / name for name in ("kept", "old"))
    stale = settings.artifacts / ".staging" / "stale"
    for folder in (kept, old, stale.parent):
        folder.mkdir(parents=True)
    (old / "a.png").touch()
    stale.touch()
    for path in (old, stale):
        os.utime(path, (0, 0))
    assert sweep_staging(settings) == 2
    assert kept.exists()
    assert not old.exists()
    assert not stale.exists()
    assert sweep_staging(settings) == 0
