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
    current = StepState(step.state)
    statement = update(Step).where(*_as_told(Step, step.id, step.token, current), *(() if guard is None else (guard,)))
    statement = statement.values(_changes(current, target, values)).returning(Step)
    moved = session.scalars(statement, execution_options=REFRESHED).all()  # the row as it is now, without a second look
    if not moved:
        return False
    record(session, [_step_event(step, current, target, reason)])
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
) -> Moved | None:
    """`move_step` where nobody has loaded the row; the caller records the event in the same transaction.

    The step that is returned is a copy which the session does not know: half the price of one that it does.
    """
    table = table_of(Step)
    statement = update(table).where(*_as_told(table.c, step_id, token, current))
    statement = statement.values(_changes(current, target, values)).returning(*table.c)
    row = session.execute(statement).one_or_none()
    if row is None:
        return None
    step = Step(**row._mapping)
    return Moved(step, _step_event(step, current, target, reason))


def _as_told(columns: Any, step_id: str, token: int, current: StepState) -> tuple[ColumnElement[bool], ...]:
    return columns.id == step_id, columns.state == current.value, columns.token == token


def _changes(current: StepState, target: StepState, values: Values | None) -> dict[str, Any]:
    check_move(current, target)
    changes = {"state": target.value, **(values or {})}
    if target is StepState.READY and current is not StepState.SENT:  # a lost message does not end the wait
        changes.setdefault("ready_at", changes.get("not_before", now_s()))
    return changes


def _step_event(step: Step, current: StepState, target: StepState, reason: str) -> EventRow:
    return _event(step.scan_id, step.id, step.generation, current.value, target.value, reason)


def wake_steps(session: Session, digests: Mapping[str, str | None], steps: Sequence[Step]) -> list[EventRow]:
    """Make pending steps of a held scan `ready`, each with the digest of its inputs; the caller records the events."""
    check_move(StepState.PENDING, StepState.READY)
    table = table_of(Step)
    statement = update(table).where(table.c.id == bindparam("step_id"), table.c.state == StepState.PENDING.value)
    statement = statement.values(state=StepState.READY.value, ready_at=now_s(), input_digest=bindparam("digest"))
    session.execute(statement, [{"step_id": step.id, "digest": digests[step.id]} for step in steps])
    return [_step_event(step, StepState.PENDING, StepState.READY, "") for step in steps]


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
