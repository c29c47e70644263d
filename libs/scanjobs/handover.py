"""From step to step: a slot that ends one claims its next in the same transaction.

A message and its way through the broker cost more than all the rows of a small step, and every slot that has work
needs none: what comes next is chosen as the dispatcher would (`dispatch`), from what is ready and from what was sent
and not heard. Messages are for slots that are idle.

No two transactions wait for each other in a ring: this one holds the scan of the step that it ended, and of another
scan it takes the row only where nobody has it (SKIP LOCKED); a scan that is busy is left to the dispatcher.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

from sqlalchemy import select
from sqlalchemy.orm import Session

from scanjobs.claims import Begun, Claim, Ended, RunnerNote
from scanjobs.dispatch import Candidate, Load, candidates, load_of, turn_of
from scanjobs.fanin import Output
from scanjobs.leases import begin, end_well, record_begun
from scanjobs.states import WORKING_SCAN_STATES, StepState
from scanjobs.tables import Scan
from scanjobs.transitions import record

UNHEARD_S: Final = 1.0
"""A message that nobody has heard for so long waits for a busy slot: this one may be it."""
TRIES: Final = 3
"""Steps that are tried before a slot goes back to waiting for messages."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Slot:
    """Who would go on with what: its worker, the queues that it serves, and the lease of a claim."""

    worker_id: str
    queues: Collection[str]
    lease_s: float


class Handover(NamedTuple):
    """What came of an ending."""

    is_accepted: bool
    claim: Claim | None
    """The slot's next step."""
    is_more: bool
    """Whether other slots have something new to do."""


def finish_and_claim(
    session: Session,
    held: Claim,
    outputs: Sequence[Output],
    facts: dict[str, Any],
    runner: RunnerNote,
    slot: Slot | None,
) -> Handover:
    """`leases.finish`, then a claim for the same slot; without a slot nothing is claimed."""
    ended = end_well(session, held, outputs, facts, runner)
    if ended is None:
        return Handover(is_accepted=False, claim=None, is_more=False)
    events = ended.events
    woken = sum(event["to_state"] == StepState.READY for event in events)
    begun = None if slot is None else _claim_next(session, ended, slot)
    if begun is None:
        record(session, events)
    else:
        record_begun(session, begun, [*events, begun.event])
    return Handover(
        is_accepted=True, claim=begun and begun.claim, is_more=begun is None or not ended.events or woken > 1
    )


def _claim_next(session: Session, ended: Ended, slot: Slot) -> Begun | None:
    for step in _in_turn(session, slot)[:TRIES]:
        scan = ended.scan if step.scan_id == ended.scan.id else _hold_free(session, step.scan_id)
        if scan is None or scan.state not in WORKING_SCAN_STATES:
            continue
        begun = begin(session, scan, step.step_id, step.token, step.state, slot.worker_id, slot.lease_s)
        if begun is not None:
            return begun
    return None


def _in_turn(session: Session, slot: Slot) -> list[Candidate]:
    found = candidates(session, slot.queues, 1, unheard_s=UNHEARD_S)
    load = load_of(session) if len({step.scan_id for step in found}) > 1 else Load()
    return sorted(found, key=lambda step: turn_of(step, load))


def _hold_free(session: Session, scan_id: str) -> Scan | None:
    """The scan with its row locked, or None where somebody else holds it."""
    query = select(Scan).where(Scan.id == scan_id).with_for_update(skip_locked=True)
    return session.scalars(query.execution_options(populate_existing=True)).one_or_none()
