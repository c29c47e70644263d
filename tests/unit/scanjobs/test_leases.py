"""Claims, tokens and fan-in, driven by hand: no broker, no runner."""

import threading
from collections.abc import Sequence
from pathlib import Path

import pytest
from nerfmodal.spec import ScanSpec
from scanjobs import control, dispatch, leases, repository, workers
from scanjobs.artifacts import ArtifactStore
from scanjobs.fanin import Output
from scanjobs.fsck import check
from scanjobs.leases import Claim, Failure, Standing
from scanjobs.messages import EXTRACT, IDENTIFY, QUEUES, RENDER, TRAIN
from scanjobs.states import StepState
from scanjobs.store import Store
from scanjobs.tables import Scan, Step
from scanjobs.workers import WorkerIdentity

BROKEN = Failure(code="BROKEN", message="it broke.")


@pytest.fixture
def scan(store: Store, spec: ScanSpec) -> Scan:
    """A waiting scan of three frames, and a worker with room for all of it."""
    identity = WorkerIdentity(id="w", host="here", pid=1, queues=QUEUES, slots=100)
    store.write(lambda session: workers.register(session, identity, 600.0))
    return store.write(lambda session: repository.insert_scan(session, spec)).scan


def take(store: Store, kind: str, frame: int, lease_s: float = 60.0) -> Claim:
    """Send everything and claim one step."""
    store.write(dispatch.dispatch)
    step = find(store, kind, frame)
    claim = store.write(lambda session: leases.claim(session, step.id, "w", lease_s))
    assert claim is not None
    return claim


def find(store: Store, kind: str, frame: int) -> Step:
    """A step of the only scan."""
    with store.read() as session:
        steps = repository.list_steps(session, repository.list_scans(session).items[0])
    return next(step for step in steps if (step.kind, step.frame) == (kind, frame))


def finish(store: Store, claim: Claim) -> bool:
    """End a step without files."""
    return store.write(lambda session: leases.finish(session, claim, (), {}))


def do(store: Store, steps: Sequence[tuple[str, int]]) -> None:
    """Claim and finish steps in order."""
    for kind, frame in steps:
        assert finish(store, take(store, kind, frame))


def assert_sound(store: Store, tmp_path: Path) -> None:
    """Fsck finds nothing."""
    with store.read() as session:
        assert check(session, ArtifactStore(tmp_path / "artifacts")) == ()


def test_step_is_claimed_once(store: Store, scan: Scan) -> None:
    claim = take(store, RENDER, 0)
    assert store.write(lambda session: leases.claim(session, claim.step_id, "other", 60.0)) is None
    assert scan.state == "queued"
    with store.read() as session:
        assert repository.get_scan(session, scan.id).state == "running"


@pytest.mark.usefixtures("scan")
def test_result_is_accepted_once(store: Store) -> None:
    claim = take(store, RENDER, 0)
    assert finish(store, claim)
    assert not finish(store, claim)


@pytest.mark.usefixtures("scan")
def test_older_token_writes_nothing(store: Store, tmp_path: Path) -> None:
    zombie = take(store, RENDER, 0, lease_s=-1.0)
    assert store.write(lambda session: leases.reap(session, zombie.step_id, 3))
    make_ready_now(store)
    present = take(store, RENDER, 0)
    assert present.token == zombie.token + 1
    assert store.write(lambda session: leases.renew(session, zombie, 60.0, 1, 2, "zombie")) is Standing.LOST
    assert not finish(store, zombie)
    assert not store.write(lambda session: leases.fail(session, zombie, BROKEN, 3))
    assert not store.write(lambda session: leases.give_back(session, zombie, "drain"))
    assert find(store, RENDER, 0).progress_message == ""
    assert finish(store, present)
    assert_sound(store, tmp_path)


@pytest.mark.usefixtures("scan")
def test_live_lease_is_not_reaped(store: Store) -> None:
    claim = take(store, RENDER, 0)
    assert not store.write(lambda session: leases.reap(session, claim.step_id, 3))
    with store.read() as session:
        assert leases.overdue_steps(session) == ()


@pytest.mark.usefixtures("scan")
def test_attempts_are_spent_one_by_one(store: Store) -> None:
    for attempt in (1, 2, 3):
        claim = take(store, RENDER, 1)
        assert claim.attempt == attempt
        store.write(lambda session, held=claim: leases.fail(session, held, BROKEN, 3))
        make_ready_now(store)
    with store.read() as session:
        scan = repository.list_scans(session).items[0]
    assert (scan.state, (scan.error or {})["code"]) == ("failed", "BROKEN")


@pytest.mark.usefixtures("scan")
def test_second_attempt_waits_a_little(store: Store) -> None:
    claim = take(store, RENDER, 1)
    store.write(lambda session: leases.fail(session, claim, BROKEN, 3))
    assert claim.step_id not in {message.step_id for message in store.write(dispatch.dispatch)}


@pytest.mark.usefixtures("scan")
@pytest.mark.parametrize("uncounted", ["drain", "disk full"])
def test_drain_and_full_disk_cost_no_attempt(store: Store, uncounted: str) -> None:
    full = Failure(code="DISK_FULL", message="no room.", counted=False)
    for _ in range(4):
        claim = take(store, RENDER, 0)
        if uncounted == "drain":
            store.write(lambda session, held=claim: leases.give_back(session, held, "drain"))
        else:
            store.write(lambda session, held=claim: leases.fail(session, held, full, 1))
        make_ready_now(store)
    assert find(store, RENDER, 0).attempt == 0


def test_truth_is_never_an_input(store: Store, scan: Scan, tmp_path: Path) -> None:
    files = ArtifactStore(tmp_path / "artifacts")
    (tmp_path / "file").write_text("bytes")
    stored = files.put(tmp_path / "file")
    outputs = [
        Output(role=role, name="n", digest=stored.digest, size=stored.size, media_type="text/plain")
        for role in ("frame", "truth", "depth")
    ]
    claim = take(store, RENDER, 0)
    store.write(lambda session: leases.finish(session, claim, outputs, {}))
    assert [one.role for one in take(store, TRAIN, -1).inputs] == ["frame"]
    with store.read() as session:
        assert {one.role for one in repository.list_artifacts(session, scan)} == {"frame", "truth", "depth"}


@pytest.mark.parametrize("repetition", range(5))
@pytest.mark.usefixtures("scan")
def test_last_parents_that_finish_together_wake_the_child_once(store: Store, repetition: int, tmp_path: Path) -> None:
    do(store, [(RENDER, k) for k in range(3)] + [(TRAIN, -1)] + [(TRAIN, k) for k in range(3)])
    claims = [take(store, EXTRACT, k) for k in range(3)]
    barrier = threading.Barrier(3)

    def race(claim: Claim) -> None:
        barrier.wait()
        finish(store, claim)

    threads = [threading.Thread(target=race, args=(claim,)) for claim in claims]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    identify = find(store, IDENTIFY, -1)
    assert (identify.state, identify.deps_left) == (StepState.READY, 0), repetition
    assert_sound(store, tmp_path)


def test_cancel_waits_for_what_computes(store: Store, scan: Scan, tmp_path: Path) -> None:
    claim = take(store, RENDER, 0)
    asked = store.write(lambda session: control.cancel_scan(session, scan.id))
    assert asked.state == "canceling"
    with store.read() as session:
        assert leases.standing(session, claim) is Standing.CANCELED
    store.write(lambda session: leases.stopped(session, claim))
    with store.read() as session:
        assert repository.get_scan(session, scan.id).state == "canceled"
    assert_sound(store, tmp_path)


def test_cancel_of_a_dead_worker_ends_with_its_lease(store: Store, scan: Scan, tmp_path: Path) -> None:
    claim = take(store, RENDER, 0, lease_s=-1.0)
    store.write(lambda session: control.cancel_scan(session, scan.id))
    store.write(lambda session: leases.reap(session, claim.step_id, 3))
    with store.read() as session:
        assert repository.get_scan(session, scan.id).state == "canceled"
    assert_sound(store, tmp_path)


def test_result_that_comes_during_a_cancel_wakes_nobody(store: Store, scan: Scan, tmp_path: Path) -> None:
    claim = take(store, RENDER, 0)
    store.write(lambda session: control.cancel_scan(session, scan.id))
    assert finish(store, claim)
    assert find(store, TRAIN, -1).state == StepState.CANCELED
    with store.read() as session:
        assert repository.get_scan(session, scan.id).state == "canceled"
    assert_sound(store, tmp_path)


def make_ready_now(store: Store) -> None:
    """Let no step wait for its next attempt."""
    store.write(lambda session: session.query(Step).update({"not_before": None}))
