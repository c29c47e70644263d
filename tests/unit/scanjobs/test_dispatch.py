"""Whose turn it is, and how many may be sent: the pure part by its laws, the rest on a database."""

from collections import Counter
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from nerfmodal.spec import ScanSpec
from scanjobs import dispatch, repository, workers
from scanjobs.dispatch import LEVEL_S, WINDOW, Candidate, Load, Room, choose, level_of, room_of
from scanjobs.messages import QUEUES
from scanjobs.states import StepState
from scanjobs.store import Store
from scanjobs.workers import WorkerIdentity

FLOOD: dict[str, Any] = {"queue": "render", "owner": "o", "priority": 0, "frame": 0}
NOTHING: Counter[str] = Counter()
ALL = set(QUEUES)


def candidate(name: str, *, scan: str = "s", owner: str = "o", depth: int = 0, priority: int = 0) -> Candidate:
    """A ready step of queue `render`."""
    return Candidate(step_id=name, queue="render", scan_id=scan, owner=owner, priority=priority, depth=depth, frame=0)


def wide() -> Room:
    """Room for everything."""
    return room_of([(ALL, 1000)], NOTHING, NOTHING)


def test_priority_goes_before_everything() -> None:
    steps = [candidate("deep", depth=9), candidate("urgent", scan="t", priority=1)]
    assert choose(steps, wide(), Load(Counter({"o": 5}), Counter({"t": 5})))[0] == "urgent"


def test_owner_with_less_under_way_goes_first() -> None:
    steps = [candidate("busy", owner="a"), candidate("idle", scan="t", owner="b")]
    assert choose(steps, wide(), Load(Counter({"a": 3, "b": 2})))[0] == "idle"


def test_small_scan_does_not_wait_behind_a_flood_of_its_owner() -> None:
    flood = [candidate(f"flood-{k}", scan="flood", depth=4) for k in range(50)]
    assert "small" in choose([*flood, candidate("small", scan="small")], wide(), Load())[:2]


def test_scan_that_has_had_little_goes_before_many_that_have_had_more() -> None:
    """Ten large scans with deeper and older steps, none under way at this moment: the newcomer is first."""
    flood = [Candidate(**FLOOD, step_id=f"{k}", scan_id=f"a{k}", depth=3, level=level_of(5, 0.0)) for k in range(10)]
    small = Candidate(**FLOOD, step_id="small", scan_id="z", depth=0, level=level_of(0, 0.0))
    assert choose([*flood, small], wide(), Load())[0] == "small"


@given(served=st.integers(0, 10**6))
def test_whoever_waits_long_enough_is_at_the_lowest_level(served: int) -> None:
    assert level_of(served, 0.0) <= 20
    assert level_of(served, 20 * LEVEL_S) == 0


def test_deepest_step_of_a_scan_goes_first() -> None:
    assert choose([candidate("first", depth=0), candidate("last", depth=3)], wide(), Load()) == ("last", "first")


@given(slots=st.integers(1, 8), running=st.integers(0, 8), sent=st.integers(0, 8), ready=st.integers(0, 40))
def test_sent_steps_never_exceed_twice_the_free_slots(slots: int, running: int, sent: int, ready: int) -> None:
    room = room_of([(ALL, slots)], Counter({"train-cpu": running}), Counter({"render": sent}))
    chosen = choose([candidate(str(k)) for k in range(ready)], room, Load())
    free = max(0, slots - running)
    assert len(chosen) == min(ready, max(0, WINDOW * free - sent))


def test_slots_shared_by_queues_are_counted_once() -> None:
    room = room_of([(ALL, 2)], NOTHING, NOTHING)
    steps = [
        Candidate(step_id=f"{queue}-{k}", queue=queue, scan_id="s", owner="o", priority=0, depth=0, frame=k)
        for queue in QUEUES
        for k in range(4)
    ]
    assert len(choose(steps, room, Load())) == WINDOW * 2


def test_queue_that_nobody_serves_is_sent_nothing() -> None:
    assert choose([candidate("a")], room_of([({"train-cpu"}, 4)], NOTHING, NOTHING), Load()) == ()


@pytest.fixture
def flooded(store: Store, spec: ScanSpec) -> Store:
    """A worker of two slots, and a scan that waits."""
    identity = WorkerIdentity(id="w", host="here", pid=1, queues=QUEUES, slots=2)
    store.write(lambda session: workers.register(session, identity, 60.0))
    store.write(lambda session: repository.insert_scan(session, spec))
    return store


def test_ready_steps_are_sent_once(flooded: Store) -> None:
    first = flooded.write(dispatch.dispatch)
    assert {message.kind for message in first} == {"frame.render"}
    assert len(first) == 3
    assert flooded.write(dispatch.dispatch) == ()


def test_only_steps_that_wait_too_long_are_unclaimed(flooded: Store) -> None:
    sent = flooded.write(dispatch.dispatch)
    with flooded.read() as session:
        assert dispatch.unclaimed_steps(session, 30.0) == ()
        assert len(dispatch.unclaimed_steps(session, -1.0)) == len(sent)


def test_step_taken_back_is_ready_at_once(flooded: Store) -> None:
    message = flooded.write(dispatch.dispatch)[0]
    assert flooded.write(lambda session: dispatch.take_back(session, message.step_id))
    with flooded.read() as session:
        assert not dispatch.is_sent(session, message.step_id)


def test_dead_or_draining_workers_are_sent_nothing(flooded: Store) -> None:
    flooded.write(lambda session: workers.drain(session, ["w"]))
    assert flooded.write(dispatch.dispatch) == ()


def test_states_are_stored_as_their_words(flooded: Store) -> None:
    flooded.write(dispatch.dispatch)
    with flooded.read() as session:
        scan = repository.list_scans(session).items[0]
        assert {step.state for step in repository.list_steps(session, scan)} == {StepState.SENT, StepState.PENDING}
