"""A paused scan begins nothing and loses nothing; each cause is lifted by itself."""

from pathlib import Path

import pytest
from nerfmodal.spec import ScanSpec
from scanjobs import control, dispatch, leases, pausing, repository, workers
from scanjobs.account_tables import Owner
from scanjobs.artifacts import ArtifactStore
from scanjobs.errors import IllegalTransition
from scanjobs.fanin import Output
from scanjobs.fsck import check
from scanjobs.leases import Claim
from scanjobs.messages import QUEUES, RENDER, TRAIN
from scanjobs.pausing import Cause
from scanjobs.settings import NO_LIMIT
from scanjobs.settling import miss_deadline, overdue_scans
from scanjobs.store import Store
from scanjobs.tables import Scan, Step
from scanjobs.workers import WorkerIdentity
from sqlalchemy import insert

IDENTITY = WorkerIdentity(id="w", host="here", pid=1, queues=QUEUES, slots=100)


@pytest.fixture
def scan(store: Store, spec: ScanSpec) -> Scan:
    """A scan whose first rendering is claimed."""
    store.write(lambda session: workers.register(session, IDENTITY, 600.0))
    return store.write(lambda session: repository.insert_scan(session, spec)).scan


def take(store: Store, kind: str, frame: int) -> Claim | None:
    """Send what may be sent and claim one step, if it may be claimed."""
    store.write(dispatch.dispatch)
    with store.read() as session:
        steps = repository.list_steps(session, repository.list_scans(session).items[0])
    step = next(step for step in steps if (step.kind, step.frame) == (kind, frame))
    return store.write(lambda session: leases.claim(session, step.id, "w", 60.0))


def state_of(store: Store, scan: Scan) -> tuple[str, str | None]:
    """State and cause."""
    with store.read() as session:
        now = repository.get_scan(session, scan.id)
        return now.state, now.paused_for


def test_result_that_comes_while_paused_counts_and_its_children_wait(store: Store, scan: Scan, tmp_path: Path) -> None:
    """Guards: a paused scan is open (`leases.end_well`) and not working (`dispatch._make_query`).

    Seen to fail: with its endings not counted the training is never woken; without the second it is sent at once.
    """
    claim = take(store, RENDER, 0)
    assert claim is not None
    store.write(lambda session: pausing.pause_scan(session, scan.id))
    assert store.write(lambda session: leases.finish(session, claim, (), {}))
    assert store.write(dispatch.dispatch) == ()
    assert take(store, TRAIN, -1) is None
    store.write(lambda session: pausing.resume_scan(session, scan.id))
    assert state_of(store, scan) == ("running", None)
    assert take(store, TRAIN, -1) is not None
    with store.read() as session:
        assert check(session, ArtifactStore(tmp_path / "artifacts")) == ()


def test_step_that_was_sent_before_the_pause_is_not_claimed(store: Store, scan: Scan) -> None:
    """Guard: the scan's state in `leases.claim`. Seen to fail: without it the step is claimed."""
    message = store.write(dispatch.dispatch)[0]
    store.write(lambda session: pausing.pause_scan(session, scan.id))
    assert store.write(lambda session: leases.claim(session, message.step_id, "w", 60.0)) is None
    store.write(lambda session: pausing.resume_scan(session, scan.id))
    assert state_of(store, scan) == ("queued", None)


def test_pausing_and_resuming_twice_is_the_same_as_once(store: Store, scan: Scan) -> None:
    """Guards: both look at the state first.

    Seen to fail: without the look the second pause and the second resumption raise `IllegalTransition`.
    """
    for _ in range(2):
        store.write(lambda session: pausing.pause_scan(session, scan.id))
    assert state_of(store, scan) == ("paused", "asked")
    for _ in range(2):
        store.write(lambda session: pausing.resume_scan(session, scan.id))
    assert state_of(store, scan) == ("queued", None)


def test_ended_scan_is_neither_paused_nor_resumed(store: Store, scan: Scan) -> None:
    """Guards: `SCAN_MOVES`, and `check_move` in `resume_scan`.

    Seen to fail: with `paused` among the moves of a cancelled scan it is paused; without `check_move` resuming it says
    nothing.
    """
    store.write(lambda session: control.cancel_scan(session, scan.id))
    for verb in (pausing.pause_scan, pausing.resume_scan):
        with pytest.raises(IllegalTransition):
            store.write(lambda session, do=verb: do(session, scan.id))


def test_paused_scan_can_be_cancelled(store: Store, scan: Scan) -> None:
    """Guard: `SCAN_MOVES`. Seen to fail: without `canceling` among the moves of a paused scan."""
    store.write(lambda session: pausing.pause_scan(session, scan.id))
    store.write(lambda session: control.cancel_scan(session, scan.id))
    assert state_of(store, scan)[0] == "canceled"


def test_what_somebody_asked_for_is_not_undone_by_a_disk_with_room(store: Store, scan: Scan) -> None:
    """Guards: a request takes over a pause, and a cause lifts its own pauses alone.

    Seen to fail: without either the scan goes on when there is room.
    """
    store.write(lambda session: pausing.pause_all(session, Cause.DISK_LOW))
    assert state_of(store, scan) == ("paused", "disk_low")
    store.write(lambda session: pausing.pause_scan(session, scan.id))
    assert store.write(lambda session: pausing.resume_all(session, Cause.DISK_LOW)) == 0
    assert state_of(store, scan) == ("paused", "asked")


def test_disk_with_room_resumes_what_it_had_paused(store: Store, scan: Scan) -> None:
    """Seen to fail: with `_resume_if_paused` doing nothing it stays paused."""
    store.write(lambda session: pausing.pause_all(session, Cause.DISK_LOW))
    assert store.write(lambda session: pausing.resume_all(session, Cause.DISK_LOW)) == 1
    assert state_of(store, scan) == ("queued", None)


def test_deadline_passes_while_paused(store: Store, spec: ScanSpec) -> None:
    """Guards: `OPEN_SCAN_STATES` in `overdue_scans` and `miss_deadline`.

    Seen to fail: with the working states in either, it stays paused for ever.
    """
    hasty = spec.model_copy(update={"deadline_s": 1e-3})
    scan = store.write(lambda session: repository.insert_scan(session, hasty)).scan
    store.write(lambda session: pausing.pause_scan(session, scan.id))
    with store.read() as session:
        assert overdue_scans(session) == (scan.id,)
    store.write(lambda session: miss_deadline(session, scan.id))
    assert state_of(store, scan)[0] == "failed"


def test_owner_over_his_quota_is_paused_until_he_is_below(store: Store, scan: Scan) -> None:
    """The scan has made ten bytes; the service's limit is nine, then the owner is given twenty.

    Seen to fail: with bytes not counted it is not paused; without the owner's own quota, or with paused scans left out
    of `_owners_at_work`, it is never resumed.
    """
    claim = take(store, RENDER, 0)
    assert claim is not None
    ten = Output(role="frame", name="n", digest="a" * 64, size=10, media_type="x")
    store.write(lambda session: leases.finish(session, claim, [ten], {}))
    store.write(lambda session: pausing.hold_to_quota(session, NO_LIMIT))
    assert state_of(store, scan)[0] == "running"
    store.write(lambda session: pausing.hold_to_quota(session, 9))
    assert state_of(store, scan) == ("paused", "quota")
    owner = {"id": scan.owner, "weight": 1.0, "quota_bytes": 20, "created_at": 0.0}
    store.write(lambda session: session.execute(insert(Owner).values(owner)))
    store.write(lambda session: pausing.hold_to_quota(session, 9))
    assert state_of(store, scan) == ("running", None)


def test_paused_worker_is_sent_nothing_until_it_is_resumed(store: Store, scan: Scan) -> None:
    """Guards: `active_workers`, and the state that `beat` returns and leaves.

    Seen to fail: with paused workers counted three messages are sent; with `beat` writing `active` the pause ends by
    itself.
    """
    store.write(lambda session: workers.pause(session, ["w"]))
    assert store.write(dispatch.dispatch) == ()
    assert store.write(lambda session: workers.beat(session, IDENTITY, 60.0)) == workers.PAUSED
    store.write(lambda session: workers.resume(session, ["w"]))
    assert store.write(dispatch.dispatch)
    with store.read() as session:
        assert session.query(Step).filter(Step.state == "sent").count() == 3
    assert scan.state == "queued"
