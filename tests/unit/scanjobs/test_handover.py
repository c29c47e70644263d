"""The next step of a slot, claimed in the transaction that ended the last one: by hand, without broker or runner."""

from functools import partial
from pathlib import Path

import pytest
from nerfmodal.spec import ScanSpec
from scanjobs import dispatch, handover, leases, pausing, repository, workers
from scanjobs.artifacts import ArtifactStore
from scanjobs.claims import Claim, RunnerNote
from scanjobs.dispatch import Candidate
from scanjobs.fsck import check
from scanjobs.handover import Handover, Slot, finish_and_claim
from scanjobs.messages import QUEUES, RENDER
from scanjobs.store import Store
from scanjobs.tables import Attempt, Scan, Step
from scanjobs.workers import WorkerIdentity
from sqlalchemy import select, update
from sqlalchemy.orm import Session

NOTE = RunnerNote(7, "log")
SLOT = Slot(worker_id="w", queues=QUEUES, lease_s=60.0)


@pytest.fixture(autouse=True)
def worker(store: Store) -> None:
    """One slot."""
    identity = WorkerIdentity(id="w", host="here", pid=1, queues=QUEUES, slots=1)
    store.write(lambda session: workers.register(session, identity, 600.0))


def submit(store: Store, spec: ScanSpec, owner: str = "local") -> Scan:
    """A scan with its plan."""
    return store.write(lambda session: repository.insert_scan(session, spec, owner=owner)).scan


def first_claim(store: Store) -> Claim:
    """What the dispatcher sends first, claimed by its message."""
    message = store.write(dispatch.dispatch)[0]
    claim = store.write(lambda session: leases.claim(session, message.step_id, "w", 60.0))
    assert claim is not None
    return claim


def hand_over(store: Store, claim: Claim, slot: Slot | None = SLOT) -> Handover:
    """End a step without files."""
    return store.write(partial(finish_and_claim, held=claim, outputs=(), facts={}, runner=NOTE, slot=slot))


def test_slot_goes_through_the_whole_scan_without_a_message(store: Store, spec: ScanSpec, tmp_path: Path) -> None:
    """Guard: the events of the ended step are recorded with the claim of the next (`finish_and_claim`).

    Seen to fail: without them fsck finds steps whose events do not end in their state; with nothing claimed the scan
    is still running when the slot has no more.
    """
    scan = submit(store, spec)
    claim: Claim | None = first_claim(store)
    age_messages(store)
    done = 0
    while claim is not None:
        claim, done = hand_over(store, claim).claim, done + 1
    with store.read() as session:
        steps = repository.list_steps(session, repository.get_scan(session, scan.id))
        assert repository.get_scan(session, scan.id).state == "succeeded"
        assert done == len(steps)
        assert set(session.scalars(select(Attempt.pid))) == {7}
        assert check(session, ArtifactStore(tmp_path / "artifacts")) == ()


def test_lost_claim_is_given_nothing(store: Store, spec: ScanSpec) -> None:
    """Guard: the state in `transitions._as_told`. Seen to fail: without it a second ending is accepted, and claims."""
    submit(store, spec)
    claim = first_claim(store)
    assert hand_over(store, claim).is_accepted
    again = hand_over(store, claim)
    assert (again.is_accepted, again.claim) == (False, None)


def test_no_slot_claims_nothing_and_says_that_there_is_more(store: Store, spec: ScanSpec) -> None:
    """Guard: `begun is None` in `is_more`. Seen to fail: without it nobody is told of the training that woke up."""
    submit(store, spec)
    ended = hand_over(store, first_claim(store), slot=None)
    assert (ended.is_accepted, ended.claim, ended.is_more) == (True, None, True)


def test_a_slot_takes_only_from_its_queues(store: Store, spec: ScanSpec) -> None:
    """Guard: `slot.queues` in `_in_turn`. Seen to fail: with every queue the slot claims a training."""
    submit(store, spec)
    claim = first_claim(store)
    assert claim.kind == RENDER
    ended = hand_over(store, claim, Slot(worker_id="w", queues=("identify",), lease_s=60.0))
    assert (ended.is_accepted, ended.claim) == (True, None)


def test_next_is_whose_turn_it_is_not_who_had_the_last(store: Store, spec: ScanSpec) -> None:
    """An owner who has nothing under way comes before one who has, as the dispatcher has it.

    Guard: `turn_of` in `_in_turn`. Seen to fail: in the order of the rows the flood's scan goes on.
    """
    flood = submit(store, spec, "flood")
    claim = first_claim(store)
    second = next(
        one for one in steps_of(store, flood) if (one.kind, one.state) == (RENDER, "ready") and one.id != claim.step_id
    )
    store.write(lambda session: session.execute(update(Step).where(Step.id == second.id).values(state="sent")))
    assert store.write(lambda session: leases.claim(session, second.id, "other", 60.0)) is not None
    small = submit(store, spec, "small")
    following = hand_over(store, claim).claim
    assert following is not None
    assert following.scan_id == small.id


def test_message_that_nobody_has_heard_is_not_waited_for(store: Store, spec: ScanSpec) -> None:
    """Guard: steps that were sent a second ago are candidates too. Seen to fail: without `unheard_s` the slot stops."""
    scan = submit(store, spec)
    claim = first_claim(store)
    others = [one.id for one in steps_of(store, scan) if one.state in ("ready", "sent")]
    store.write(lambda session: session.execute(update(Step).where(Step.id.in_(others)).values(state="sent")))
    age_messages(store)
    had = []
    while (following := hand_over(store, claim).claim) is not None:
        had.append(following.kind)
        claim = following
    assert had.count(RENDER) == len(others)


def test_message_of_a_step_that_was_handed_over_finds_nothing(store: Store, spec: ScanSpec) -> None:
    """Guards: the question before a claim (`is_sent`), and `sent` as the state that `leases.claim` starts from.

    Seen to fail: with `is_sent` true of any step; with `claim` starting from the state that it finds, it raises
    `IllegalTransition`: a step that is running cannot become running.
    """
    scan = submit(store, spec)
    following = hand_over(store, first_claim(store)).claim
    assert following is not None
    with store.read() as session:
        assert not dispatch.is_sent(session, following.step_id)
    assert store.write(lambda session: leases.claim(session, following.step_id, "other", 60.0)) is None
    assert not [one for one in steps_of(store, scan) if one.id == following.step_id and one.state != "running"]


def test_paused_scan_hands_nothing_over(store: Store, spec: ScanSpec) -> None:
    """Guards: paused scans are no candidates (`dispatch._make_query`), and are asked again when they are held.

    Seen to fail: without both a training is claimed; either is enough here, the next test needs the second.
    """
    scan = submit(store, spec)
    claim = first_claim(store)
    store.write(lambda session: pausing.pause_scan(session, scan.id))
    ended = hand_over(store, claim)
    assert (ended.is_accepted, ended.claim) == (True, None)


def test_scan_that_was_paused_after_the_look_hands_nothing_over(
    store: Store, spec: ScanSpec, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Between the candidates and their lock somebody pauses the other scan.

    Guard: the state of a held scan in `_claim_next`. Seen to fail: without it a rendering of the paused scan is
    claimed.
    """
    submit(store, spec, "busy")
    claim = first_claim(store)
    other = submit(store, spec, "other")
    look = handover._in_turn

    def look_and_be_late(session: Session, slot: Slot) -> list[Candidate]:
        found = look(session, slot)
        pausing.pause_scan(session, other.id, owner="other")
        return [step for step in found if step.scan_id == other.id]

    monkeypatch.setattr(handover, "_in_turn", look_and_be_late)
    ended = hand_over(store, claim)
    assert (ended.is_accepted, ended.claim) == (True, None)


def age_messages(store: Store) -> None:
    """As if every message had been sent long ago."""
    store.write(lambda session: session.execute(update(Step).where(Step.state == "sent").values(sent_at=0.0)))


def steps_of(store: Store, scan: Scan) -> tuple[Step, ...]:
    """Of the present generation."""
    with store.read() as session:
        return repository.list_steps(session, scan)
