"""Who holds a scan's row, and when a scan has ended.

Every transaction that ends or revives a step holds the row of its scan first (`hold_scan`), so what happens to the
steps of one scan happens in one order: no two parents finish at once, no cancel passes a finish.
"""

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, Final

from sqlalchemy import bindparam, select, update
from sqlalchemy.orm import Session

from scanjobs.clock import now_s
from scanjobs.errors import NotFound
from scanjobs.messages import IDENTIFY
from scanjobs.plan import WHOLE_SCAN
from scanjobs.states import LIVE_STEP_STATES, OPEN_SCAN_STATES, TERMINAL_SCAN_STATES, ScanState, StepState
from scanjobs.tables import Attempt, Scan, Step
from scanjobs.transitions import UNSYNCHRONISED, move_scan, move_steps

DEADLINE_PASSED: Final = MappingProxyType(
    {
        "step": None,
        "code": "DEADLINE_PASSED",
        "message": "the scan's deadline has passed.",
        "hint": "Retry it: what has been computed is kept.",
        "retryable": True,
    }
)


def hold_scan(session: Session, scan_id: str, *, owner: str | None = None) -> Scan:
    """The scan, its row locked until the transaction ends. Raises `NotFound`."""
    scan = session.scalars(_HELD, {"scan_id": scan_id}).one_or_none()
    if scan is None or (owner is not None and scan.owner != owner) or scan.state == ScanState.DELETED:
        raise NotFound(f"there is no scan {scan_id}.", hint="List your scans with GET /v1/scans.")
    return scan


def hold_scan_of(session: Session, step_id: str) -> Scan | None:
    """The scan of a step, its row locked until the transaction ends; None where there is none any more."""
    scan = session.scalars(_HELD_OF, {"step_id": step_id}).one_or_none()
    return None if scan is None or scan.state == ScanState.DELETED else scan


_LOCKED: Final = select(Scan).with_for_update().execution_options(populate_existing=True)
_HELD: Final = _LOCKED.where(Scan.id == bindparam("scan_id"))
_HELD_OF: Final = _LOCKED.where(
    Scan.id == select(Step.scan_id).where(Step.id == bindparam("step_id")).scalar_subquery()
)


def live_steps(session: Session, scan: Scan, *states: StepState) -> tuple[Step, ...]:
    """The steps of a held scan that are in one of `states` (by default: that have not ended)."""
    chosen = [state.value for state in states or LIVE_STEP_STATES]
    query = select(Step).where(Step.scan_id == scan.id, Step.state.in_(chosen)).order_by(Step.id)
    return tuple(session.scalars(query.execution_options(populate_existing=True)))


def settle(session: Session, scan: Scan) -> None:
    """End a held scan if its steps say so: cancelled when none is left alive, succeeded with its identification."""
    if scan.state == ScanState.CANCELING:
        if not live_steps(session, scan):
            move_scan(session, scan, ScanState.CANCELED, values={"finished_at": now_s()})
    elif scan.state not in TERMINAL_SCAN_STATES and _is_identified(session, scan):
        _stop_live(session, scan, "superseded")  # modes so far that nobody needs any more
        move_scan(session, scan, ScanState.SUCCEEDED, values={"finished_at": now_s(), "error": None})


def fail_scan(session: Session, scan: Scan, error: Mapping[str, Any]) -> None:
    """End a held scan for good; what still lived is cancelled and what still computes is fenced off."""
    _stop_live(session, scan, "scan failed")
    values = {"finished_at": now_s(), "error": dict(error)}
    move_scan(session, scan, ScanState.FAILED, reason=str(error["code"]), values=values)


def overdue_scans(session: Session) -> tuple[str, ...]:
    """Scans whose deadline has passed."""
    query = select(Scan.id).where(Scan.deadline_at < now_s(), Scan.state.in_([s.value for s in OPEN_SCAN_STATES]))
    return tuple(session.scalars(query.order_by(Scan.id)))


def miss_deadline(session: Session, scan_id: str) -> None:
    """End a scan whose deadline has passed, unless it has ended meanwhile."""
    scan = hold_scan(session, scan_id)
    if scan.state in OPEN_SCAN_STATES:
        fail_scan(session, scan, DEADLINE_PASSED)


def close_attempts(session: Session, steps: Sequence[Step], outcome: str) -> None:
    """End the attempts that are under way at these steps; what they still compute is not accepted."""
    statement = update(Attempt).where(Attempt.step_id.in_([step.id for step in steps]), Attempt.ended_at.is_(None))
    values = {"ended_at": now_s(), "outcome": outcome[:32]}
    session.execute(statement.values(values), execution_options=UNSYNCHRONISED)


def _stop_live(session: Session, scan: Scan, reason: str) -> None:
    steps = live_steps(session, scan)
    close_attempts(session, [step for step in steps if step.state == StepState.RUNNING], reason)
    move_steps(session, steps, StepState.CANCELED, reason=reason, values=_ended())


def _is_identified(session: Session, scan: Scan) -> bool:
    query = select(Step.id).where(
        Step.scan_id == scan.id,
        Step.generation == scan.generation,
        Step.kind == IDENTIFY,
        Step.frame == WHOLE_SCAN,
        Step.state == StepState.SUCCEEDED,
    )
    return session.scalars(query).first() is not None


def _ended() -> dict[str, Any]:
    return {"finished_at": now_s(), "lease_until": None}
