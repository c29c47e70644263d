"""The invariants of the tables and of the artifacts, checked on a database that may be in use.

Each check returns sentences; an empty list is a sound service.
"""

from collections.abc import Callable, Iterator
from typing import Final

from sqlalchemy import and_, func, or_, select
from sqlalchemy.orm import Session, aliased

from scanjobs.artifacts import ArtifactStore
from scanjobs.clock import now_s
from scanjobs.errors import ScanjobsError
from scanjobs.fanin import DROPPED
from scanjobs.states import LIVE_STEP_STATES, TERMINAL_SCAN_STATES, StepState
from scanjobs.tables import Artifact, ArtifactRef, Attempt, Event, Scan, Step, StepDependency

GRACE_S: Final = 5.0
"""An expired lease is reaped by the next tick, not at once."""

Check = Callable[[Session], Iterator[str]]


def check(session: Session, artifacts: ArtifactStore) -> tuple[str, ...]:
    """Everything that is wrong, in sentences."""
    found = [sentence for one in CHECKS for sentence in one(session)]
    return tuple(found + list(_artifacts_are_whole(session, artifacts)))


def _counters_are_right(session: Session) -> Iterator[str]:
    """`deps_left` of a waiting step is the number of its parents that have not ended."""
    parent = aliased(Step)
    ended = or_(parent.state == StepState.SUCCEEDED, parent.state == StepState.FAILED)
    open_parents = (
        select(func.count())
        .select_from(StepDependency)
        .join(parent, parent.id == StepDependency.parent_id)
        .where(StepDependency.child_id == Step.id, ~ended)
        .scalar_subquery()
    )
    query = select(Step.id, Step.deps_left, open_parents).where(
        Step.state.in_([state.value for state in LIVE_STEP_STATES]), Step.deps_left != open_parents
    )
    for step_id, said, counted in session.execute(query):
        yield f"step {step_id} waits for {said} parents, but {counted} have not ended"


def _nobody_waits_for_nothing(session: Session) -> Iterator[str]:
    """A pending step has something to wait for."""
    query = select(Step.id).where(Step.state == StepState.PENDING, Step.deps_left == 0)
    for step_id in session.scalars(query):
        yield f"step {step_id} is pending and waits for nothing"


def _results_are_single(session: Session) -> Iterator[str]:
    """At most one attempt of a step was accepted."""
    query = select(Attempt.step_id).where(Attempt.outcome == "succeeded").group_by(Attempt.step_id)
    for step_id in session.scalars(query.having(func.count() > 1)):
        yield f"step {step_id} was accepted more than once"


def _successes_were_earned(session: Session) -> Iterator[str]:
    """A succeeded step was computed by an accepted attempt, or took over another's result."""
    accepted = select(Attempt.step_id).where(Attempt.outcome == "succeeded")
    query = select(Step.id).where(
        Step.state == StepState.SUCCEEDED, Step.reused_from.is_(None), Step.id.not_in(accepted)
    )
    for step_id in session.scalars(query):
        yield f"step {step_id} has succeeded, but no attempt was accepted"


def _leases_are_alive(session: Session) -> Iterator[str]:
    """A running step has a lease, and only a running step."""
    running = Step.state == StepState.RUNNING
    stale = or_(Step.lease_until.is_(None), Step.lease_until < now_s() - GRACE_S)
    query = select(Step.id).where(or_(and_(running, stale), and_(~running, Step.lease_until.is_not(None))))
    for step_id in session.scalars(query):
        yield f"step {step_id} runs without a live lease, or has a lease and does not run"


def _attempts_are_closed(session: Session) -> Iterator[str]:
    """An attempt without an end is the present claim of a running step."""
    current = and_(Step.id == Attempt.step_id, Step.token == Attempt.token, Step.state == StepState.RUNNING)
    query = select(Attempt.step_id, Attempt.token).where(
        Attempt.ended_at.is_(None), ~select(Step.id).where(current).exists()
    )
    for step_id, token in session.execute(query):
        yield f"attempt {token} of step {step_id} has no end"


def _ended_scans_are_quiet(session: Session) -> Iterator[str]:
    """A scan that has ended has no step alive."""
    query = (
        select(Scan.id, func.count())
        .join(Step, Step.scan_id == Scan.id)
        .where(
            Scan.state.in_([state.value for state in TERMINAL_SCAN_STATES]),
            Step.state.in_([state.value for state in LIVE_STEP_STATES]),
        )
        .group_by(Scan.id)
    )
    for scan_id, count in session.execute(query):
        yield f"scan {scan_id} has ended, but {count} of its steps have not"


def _events_replay(session: Session) -> Iterator[str]:
    """The last event of every scan and step tells its present state."""
    last = select(func.max(Event.id).label("id")).group_by(Event.scan_id, Event.step_id).subquery()
    told = select(Event.scan_id, Event.step_id, Event.to_state).join(last, last.c.id == Event.id).subquery()
    steps = select(Step.id).outerjoin(told, told.c.step_id == Step.id)
    for step_id in session.scalars(steps.where(func.coalesce(told.c.to_state, "") != Step.state)):
        yield f"the events of step {step_id} do not end in its state"
    scans = select(Scan.id).outerjoin(told, and_(told.c.scan_id == Scan.id, told.c.step_id.is_(None)))
    for scan_id in session.scalars(scans.where(func.coalesce(told.c.to_state, "") != Scan.state)):
        yield f"the events of scan {scan_id} do not end in its state"


def _events_are_chained(session: Session) -> Iterator[str]:
    """Every event begins where the one before it ended."""
    before = func.lag(Event.to_state).over(partition_by=(Event.scan_id, Event.step_id), order_by=Event.id)
    pairs = select(Event.id, Event.from_state, before.label("before")).subquery()
    broken = func.coalesce(pairs.c.from_state, "") != func.coalesce(pairs.c.before, "")
    for event_id in session.scalars(select(pairs.c.id).where(broken)):
        yield f"event {event_id} does not begin where the one before it ended"


def _artifacts_are_whole(session: Session, artifacts: ArtifactStore) -> Iterator[str]:
    """Every digest that is referred to is stored, and its bytes match; those that retention has dropped may be gone."""
    kept = select(Artifact.digest).where(Artifact.state != DROPPED)
    for digest in session.scalars(select(ArtifactRef.digest).where(ArtifactRef.digest.in_(kept)).distinct()):
        try:
            artifacts.path(digest)
        except ScanjobsError as error:
            yield error.message


CHECKS: Final[tuple[Check, ...]] = (
    _counters_are_right,
    _nobody_waits_for_nothing,
    _results_are_single,
    _successes_were_earned,
    _leases_are_alive,
    _attempts_are_closed,
    _ended_scans_are_quiet,
    _events_replay,
    _events_are_chained,
)
