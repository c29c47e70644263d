"""Every invariant is seen to be broken when it is."""

from collections.abc import Callable
from pathlib import Path

import pytest
from nerfmodal.spec import ScanSpec
from scanjobs import dispatch, leases, repository, workers
from scanjobs.artifacts import ArtifactStore
from scanjobs.clock import now_s
from scanjobs.fanin import Output, attach_outputs
from scanjobs.fsck import check
from scanjobs.messages import QUEUES
from scanjobs.store import Store
from scanjobs.tables import ArtifactRef, Attempt, Event, Scan, Step
from scanjobs.workers import WorkerIdentity
from sqlalchemy import delete, func, insert, select, update
from sqlalchemy.orm import Session


def _lower_counter(session: Session) -> None:
    session.execute(update(Step).where(Step.state == "pending").values(deps_left=Step.deps_left - 1))


def _forget_to_wake(session: Session) -> None:
    session.execute(update(Step).where(Step.state == "ready").values(state="pending"))


def _accept_twice(session: Session) -> None:
    accepted = session.scalars(select(Attempt).where(Attempt.outcome == "succeeded")).first()
    assert accepted is not None
    row = {"step_id": accepted.step_id, "token": 99, "worker_id": "w", "started_at": 0.0, "ended_at": 1.0}
    session.execute(insert(Attempt).values(outcome="succeeded", **row))


def _forget_the_attempt(session: Session) -> None:
    session.execute(delete(Attempt).where(Attempt.outcome == "succeeded"))


def _let_a_lease_expire(session: Session) -> None:
    session.execute(update(Step).where(Step.state == "running").values(lease_until=now_s() - 60))


def _leave_an_attempt_open(session: Session) -> None:
    session.execute(update(Attempt).values(ended_at=None))


def _end_the_scan(session: Session) -> None:
    session.execute(update(Scan).values(state="succeeded"))


def _lose_the_last_event(session: Session) -> None:
    session.execute(delete(Event).where(Event.id == select(func.max(Event.id)).scalar_subquery()))


def _break_the_chain(session: Session) -> None:
    session.execute(update(Event).where(Event.to_state == "running").values(from_state="ready"))


def _refer_to_nothing(session: Session) -> None:
    step_id = session.scalars(select(ArtifactRef.step_id)).first()
    other = Output(role="ghost", name="n", digest="f" * 64, size=1, media_type="x")
    step = session.get_one(Step, step_id)
    attach_outputs(session, step, [other])


BREAKS: dict[str, tuple[Callable[[Session], None], str]] = {
    "counter": (_lower_counter, "waits for"),
    "not woken": (_forget_to_wake, "waits for nothing"),
    "accepted twice": (_accept_twice, "more than once"),
    "no attempt": (_forget_the_attempt, "no attempt was accepted"),
    "expired lease": (_let_a_lease_expire, "without a live lease"),
    "open attempt": (_leave_an_attempt_open, "has no end"),
    "ended scan": (_end_the_scan, "has ended, but"),
    "lost event": (_lose_the_last_event, "do not end in its state"),
    "broken chain": (_break_the_chain, "does not begin where"),
    "ghost": (_refer_to_nothing, "is missing"),
}


@pytest.fixture
def artifacts(tmp_path: Path) -> ArtifactStore:
    """An artifact store."""
    return ArtifactStore(tmp_path / "artifacts")


@pytest.fixture
def busy(store: Store, spec: ScanSpec, artifacts: ArtifactStore, tmp_path: Path) -> Store:
    """One step finished with a file, one running, others ready and pending; all is well."""
    identity = WorkerIdentity(id="w", host="here", pid=1, queues=QUEUES, slots=100)
    store.write(lambda session: workers.register(session, identity, 600.0))
    store.write(lambda session: repository.insert_scan(session, spec))
    (tmp_path / "file").write_text("bytes")
    stored = artifacts.put(tmp_path / "file")
    output = Output(role="frame", name="n", digest=stored.digest, size=stored.size, media_type="x")
    first, second, *_ = store.write(dispatch.dispatch)
    claim = store.write(lambda session: leases.claim(session, first.step_id, "w", 60.0))
    assert claim is not None
    store.write(lambda session: leases.finish(session, claim, [output], {}))
    store.write(lambda session: leases.claim(session, second.step_id, "w", 60.0))
    with store.read() as session:
        assert check(session, artifacts) == ()
    return store


@pytest.mark.parametrize("name", list(BREAKS))
def test_broken_invariant_is_reported(busy: Store, artifacts: ArtifactStore, name: str) -> None:
    damage, sentence = BREAKS[name]
    busy.write(damage)
    with busy.read() as session:
        assert any(sentence in one for one in check(session, artifacts))


def test_rotten_artifact_is_reported(busy: Store, artifacts: ArtifactStore) -> None:
    for digest in artifacts.digests():
        artifacts.place(digest).chmod(0o644)
        artifacts.place(digest).write_text("rot")
    with busy.read() as session:
        assert any("other bytes" in one for one in check(session, artifacts))
