"""What a step waited, computed and lost adds up to its wall time; each second is told of once."""

import pytest
from nerfmodal.spec import ScanSpec
from scanjobs import control, dispatch, leases, meters, repository, workers
from scanjobs.leases import Claim, Failure
from scanjobs.messages import QUEUES, RENDER, TRAIN
from scanjobs.step_times import StepTimes, times_of
from scanjobs.store import Store
from scanjobs.tables import Attempt, Event, Step
from scanjobs.workers import WorkerIdentity
from sqlalchemy import select, update
from sqlalchemy.orm import Session

BROKEN = Failure(code="BROKEN", message="it broke.")
NOTHING = StepTimes(None, None, 0.0)


@pytest.fixture(autouse=True)
def scan(store: Store, spec: ScanSpec) -> None:
    """A scan, and a worker that is given everything."""
    identity = WorkerIdentity(id="w", host="here", pid=1, queues=QUEUES, slots=100)
    store.write(lambda session: workers.register(session, identity, 600.0))
    store.write(lambda session: repository.insert_scan(session, spec))


def times(store: Store, kind: str, frame: int) -> StepTimes:
    """Of one step."""
    with store.read() as session:
        scan = repository.list_scans(session).items[0]
        steps = repository.list_steps(session, scan)
        step = next(one for one in steps if (one.kind, one.frame) == (kind, frame))
        return times_of(session, scan, steps)[step.id]


def take(store: Store, frame: int) -> Claim:
    """Claim the rendering of a frame, whatever it waits for."""
    store.write(lambda session: session.execute(update(Step).values(not_before=None)))
    store.write(dispatch.dispatch)
    with store.read() as session:
        step_id = session.scalars(select(Step.id).where(Step.kind == RENDER, Step.frame == frame)).one()
    claim = store.write(lambda session: leases.claim(session, step_id, "w", 60.0))
    assert claim is not None
    return claim


def put(store: Store, step_id: str, ready: float, *attempts: tuple[float, float]) -> None:
    """Let it have become ready then, and its attempts have lasted so."""

    def work(session: Session) -> None:
        born = update(Event).where(Event.step_id == step_id, Event.from_state.is_(None))
        session.execute(born.values(at=ready))
        for token, (began, ended) in enumerate(attempts, 1):
            one = update(Attempt).where(Attempt.step_id == step_id, Attempt.token == token)
            session.execute(one.values(started_at=began, ended_at=ended))
        session.execute(update(Step).where(Step.id == step_id).values(finished_at=attempts[-1][1]))

    store.write(work)


def test_wait_run_and_loss_add_up_to_the_wall_time(store: Store) -> None:
    """Ready at 100, 20 s until it broke, claimed again at 150, done at 190.

    Seen to fail: with `_first_ready` telling nothing, so that `ready_at` of the last attempt stands, `waited_s` is 0
    here and in the next test.
    """
    first = take(store, 0)
    store.write(lambda session: leases.fail(session, first, BROKEN, 3))
    second = take(store, 0)
    assert store.write(lambda session: leases.finish(session, second, (), {}))
    put(store, first.step_id, 100.0, (110.0, 130.0), (150.0, 190.0))
    found = times(store, RENDER, 0)
    assert found == (30.0, 40.0, 20.0)
    assert sum(part or 0.0 for part in found) == 190.0 - 100.0


def test_step_that_is_tried_again_has_lost_what_its_worker_took(store: Store) -> None:
    lost = take(store, 1)
    expired = update(Step).where(Step.id == lost.step_id).values(lease_until=1.0)
    store.write(lambda session: session.execute(expired))
    store.write(lambda session: leases.reap(session, lost.step_id, 3))
    put(store, lost.step_id, 100.0, (110.0, 135.0))
    found = times(store, RENDER, 1)
    assert (found.run_s, found.lost_s) == (None, 25.0)
    assert (found.waited_s or 0.0) > 1e6, "it waits since, by the clock"


def test_what_is_under_way_runs_until_now(store: Store) -> None:
    claim = take(store, 2)
    long_ago = update(Attempt).where(Attempt.step_id == claim.step_id).values(started_at=1.0)
    store.write(lambda session: session.execute(long_ago))
    found = times(store, RENDER, 2)
    assert (found.run_s or 0.0) > 1e6
    assert found.lost_s == 0.0


def test_of_a_step_that_waits_for_its_parents_nothing_is_said(store: Store) -> None:
    """Its row has been there for long, but nobody could have computed it."""
    assert times(store, TRAIN, -1) == NOTHING
    with store.read() as session:
        scan_id = repository.list_scans(session).items[0].id
    store.write(lambda session: control.cancel_scan(session, scan_id))
    assert times(store, TRAIN, -1) == NOTHING


def test_totals_have_what_was_lost_by_kind_and_outcome(store: Store) -> None:
    broken, good = take(store, 0), take(store, 1)
    store.write(lambda session: leases.fail(session, broken, BROKEN, 3))
    store.write(lambda session: leases.finish(session, good, (), {}))
    put(store, broken.step_id, 100.0, (110.0, 130.0))
    store.write(meters.fold)
    with store.read() as session:
        lost = {row.labels["outcome"]: row.value for row in meters.read_totals(session) if row.name == "lost_seconds"}
    assert lost == {"failed": 20.0}
