"""The one place that moves rows from state to state: checked by the tables of `states`, each with its event."""

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, Final, NamedTuple

from sqlalchemy import ColumnElement, bindparam, insert, literal, select, update
from sqlalchemy.orm import Session

from scanjobs.clock import now_s
from scanjobs.fleet.notes import note_scan
from scanjobs.meters import count_scan
from scanjobs.states import TERMINAL_SCAN_STATES, ScanState, StepState, check_move
from scanjobs.tables import Event, Scan, Step, table_of
from scanjobs.webhooks import announce_scan

Values = Mapping[str, Any]
EventRow = dict[str, Any]
BATCH = 500
"""Rows named in one statement; SQLite allows 32,766 variables."""
REFRESHED: Final[Mapping[str, Any]] = MappingProxyType({"synchronize_session": False, "populate_existing": True})
UNSYNCHRONISED: Final[Mapping[str, Any]] = MappingProxyType({"synchronize_session": False})
"""Rows in memory are refreshed by hand, after the guard has spoken."""


class Moved(NamedTuple):
    """A step after its move, and the event that is still to be recorded."""

    step: Step
    event: EventRow


def move_scan(
    session: Session, scan: Scan, target: ScanState, *, reason: str = "", values: Values | None = None
) -> None:
    """Move a scan whose row this transaction holds; raises `IllegalTransition`."""
    current = ScanState(scan.state)
    check_move(current, target)
    changes = {"state": target.value, "version": scan.version + 1, **(values or {})}
    session.execute(update(Scan).where(Scan.id == scan.id).values(changes), execution_options=UNSYNCHRONISED)
    session.refresh(scan)
    record(session, [_event(scan.id, None, scan.generation, current.value, target.value, reason)])
    if target in TERMINAL_SCAN_STATES:
        count_scan(session, target)
    note_scan(session, scan)
    announce_scan(session, scan)


def move_step(
    session: Session,
    step: Step,
    target: StepState,
    *,
    reason: str = "",
    values: Values | None = None,
    guard: ColumnElement[bool] | None = None,
) -> bool:
    """Move one step if it still is as `step` says (and `guard` holds); False when somebody was faster."""
    moved = change_step(
        session, step.id, step.token, StepState(step.state), target, reason=reason, values=values, guard=guard
    )
    if moved is None:
        return False
    record(session, [moved.event])
    return True


def change_step(
    session: Session,
    step_id: str,
    token: int,
    current: StepState,
    target: StepState,
    *,
    reason: str = "",
    values: Values | None = None,
    guard: ColumnElement[bool] | None = None,
) -> Moved | None:
    """Move one step if it still is as the arguments say; the caller records the event in the same transaction."""
    check_move(current, target)
    statement = update(Step).where(Step.id == step_id, Step.state == current.value, Step.token == token)
    if guard is not None:
        statement = statement.where(guard)
    if target is StepState.READY and current is not StepState.SENT:  # a lost message does not end the wait
        values = {"ready_at": (values or {}).get("not_before", now_s()), **(values or {})}
    step = session.scalars(
        statement.values({"state": target.value, **(values or {})}).returning(Step), execution_options=REFRESHED
    ).one_or_none()  # the row as it is now, in the place of a second look
    if step is None:
        return None
    return Moved(step, _event(step.scan_id, step.id, step.generation, current.value, target.value, reason))


def wake_steps(session: Session, digests: Mapping[str, str | None], steps: Sequence[Step]) -> list[EventRow]:
    """Make pending steps of a held scan `ready`, each with the digest of its inputs; the caller records the events."""
    check_move(StepState.PENDING, StepState.READY)
    table = table_of(Step)
    statement = update(table).where(table.c.id == bindparam("step_id"), table.c.state == StepState.PENDING.value)
    statement = statement.values(state=StepState.READY.value, ready_at=now_s(), input_digest=bindparam("digest"))
    session.execute(statement, [{"step_id": step.id, "digest": digests[step.id]} for step in steps])
    before, after = StepState.PENDING.value, StepState.READY.value
    events = [_event(step.scan_id, step.id, step.generation, before, after, "") for step in steps]
    for step in steps:
        session.expire(step)
    return events


def move_steps(
    session: Session, steps: Sequence[Step], target: StepState, *, reason: str = "", values: Values | None = None
) -> int:
    """Move many steps of a scan whose row this transaction holds; how many still were as `steps` says."""
    groups: dict[str, list[Step]] = {}
    for step in steps:
        groups.setdefault(step.state, []).append(step)
    return sum(
        _move_group(session, StepState(state), group, target, reason, values or {}) for state, group in groups.items()
    )


def _move_group(
    session: Session, current: StepState, steps: Sequence[Step], target: StepState, reason: str, values: Values
) -> int:
    check_move(current, target)
    moved: set[str] = set()
    for start in range(0, len(steps), BATCH):
        ids = [step.id for step in steps[start : start + BATCH]]
        statement = update(Step).where(Step.id.in_(ids), Step.state == current.value)
        statement = statement.values({"state": target.value, **values})
        moved |= set(session.scalars(statement.returning(Step.id), execution_options=UNSYNCHRONISED))
    changed = [step for step in steps if step.id in moved]
    record(
        session,
        [_event(step.scan_id, step.id, step.generation, current.value, target.value, reason) for step in changed],
    )
    for step in changed:
        session.expire(step)
    return len(changed)


def born_scans(session: Session, scans: Sequence[Scan]) -> None:
    """Record the first state of new scans."""
    record(session, [_event(scan.id, None, scan.generation, None, scan.state, "submitted") for scan in scans])
    _note_born(session, scans)


def born_queued(session: Session, scans: Sequence[Scan], at: float) -> None:
    """Record the first state of many new scans that are `queued`, in one statement."""
    row = (Scan.id, literal(0), literal(ScanState.QUEUED.value), literal("submitted"), literal(at))
    columns = ("scan_id", "generation", "to_state", "reason", "at")
    born = select(*row).where(Scan.id.in_([scan.id for scan in scans])).order_by(Scan.id)
    session.execute(insert(table_of(Event)).from_select(columns, born))
    _note_born(session, scans)


def _note_born(session: Session, scans: Sequence[Scan]) -> None:
    """The plants' rows always in one order, whoever else writes them."""
    for scan in sorted(scans, key=lambda scan: (scan.owner, scan.plant or "", scan.id)):
        note_scan(session, scan, born=True)


def born_steps(session: Session, steps: Sequence[Mapping[str, Any]], reason: str = "") -> None:
    """Record the first state of new steps, given as the values of their rows."""
    record(
        session,
        [_event(row["scan_id"], row["id"], row["generation"], None, row["state"], reason) for row in steps],
    )


def _event(scan_id: str, step_id: str | None, generation: int, before: str | None, after: str, reason: str) -> EventRow:
    return {
        "scan_id": scan_id,
        "step_id": step_id,
        "generation": generation,
        "from_state": before,
        "to_state": after,
        "reason": reason[:64],
    }


def record(session: Session, rows: Sequence[EventRow]) -> None:
    """Append events, in the order of `rows`."""
    for start in range(0, len(rows), BATCH):
        session.execute(insert(table_of(Event)).values(at=now_s()).inline(), list(rows[start : start + BATCH]))
