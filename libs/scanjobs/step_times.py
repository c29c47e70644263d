"""Where the wall time of a step went: waiting for a slot, in attempts that came to nothing, in the one that counts.

The three add up to the time from the moment when the step could first be computed to its end, or to now. What a lost
attempt had saved is gone on from, so `lost_s` is the price of faults at most. By the database's clock.
"""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

from sqlalchemy import func, select
from sqlalchemy.orm import Session

from scanjobs.clock import now_s
from scanjobs.states import LIVE_STEP_STATES, StepState
from scanjobs.tables import Attempt, Event, Scan, Step

WAITING: Final = (StepState.READY, StepState.SENT)
GOES_ON: Final = (None, "succeeded")
"""Outcomes of the attempt that counts: it is under way, or its result was accepted."""


class StepTimes(NamedTuple):
    """Seconds of one step; None where nothing of the kind can be said."""

    waited_s: float | None
    """Ready, but in no slot: queueing, pauses after failures, a paused scan."""
    run_s: float | None
    """In the attempt that counts."""
    lost_s: float
    """In attempts that failed, whose lease expired, or that were given back."""


def times_of(session: Session, scan: Scan, steps: Sequence[Step]) -> Mapping[str, StepTimes]:
    """By step id, for steps of a scan's present generation."""
    now = session.scalars(select(now_s())).one()
    attempts: dict[str, list[Attempt]] = defaultdict(list)
    tried = select(Attempt).where(Attempt.step_id.in_([step.id for step in steps if step.token]))
    for attempt in session.scalars(tried.order_by(Attempt.token)):
        attempts[attempt.step_id].append(attempt)
    again = [step.id for step in steps if step.token > 1 or (step.token and step.state in WAITING)]
    first = _first_ready(session, scan, again)
    return {step.id: _times(step, attempts[step.id], first.get(step.id, step.ready_at), now) for step in steps}


def _first_ready(session: Session, scan: Scan, step_ids: Sequence[str]) -> dict[str, float]:
    """`ready_at` is that of the last attempt: of steps that were tried again the event log knows the first."""
    query = select(Event.step_id, func.min(Event.at)).where(
        Event.scan_id == scan.id, Event.step_id.in_(step_ids), Event.to_state == StepState.READY
    )
    return {step_id: at for step_id, at in session.execute(query.group_by(Event.step_id)) if step_id is not None}


def _times(step: Step, attempts: Sequence[Attempt], ready_at: float | None, now: float) -> StepTimes:
    if ready_at is None or not (attempts or step.state in WAITING):
        return StepTimes(None, None, 0.0)  # it waits for its parents, was taken over, or ended before its turn
    spent = [(attempt.ended_at or now) - attempt.started_at for attempt in attempts]
    run = spent.pop() if attempts and attempts[-1].outcome in GOES_ON else None
    end = now if step.state in LIVE_STEP_STATES else step.finished_at
    lost = sum(spent)
    waited = None if end is None else max(0.0, end - ready_at - lost - (run or 0.0))
    return StepTimes(waited, run, lost)
