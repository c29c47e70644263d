"""The one place that moves rows from state to state: checked by the tables of `states`, each with its event."""

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, Final, NamedTuple

from sqlalchemy import ColumnElement, bindparam, case, insert, literal, select, update
from sqlalchemy.orm import Session
from sqlalchemy.sql.dml import ReturningUpdate

from scanjobs.clock import now_s
from scanjobs.fleet.notes import note_scan
from scanjobs.meters import count_scan
from scanjobs.states import TERMINAL_SCAN_STATES, ScanState, StepState, check_move
from scanjobs.tables import Event, Scan, Step, StepDependency, table_of
from scanjobs.webhooks import announce_scan

Values = Mapping[str, Any]
EventRow = dict[str, Any]
BATCH = 500
"""Rows named in one statement; SQLite allows 32,766 variables."""
REFRESHED: Final[Mapping[str, Any]] = MappingProxyType({"synchronize_session": False, "populate_existing": True})
UNSYNCHRONISED: Final[Mapping[str, Any]] = MappingProxyType({"synchronize_session": False})
"""Rows in memory are refreshed by hand, after the guard has spoken."""


class StepChange(NamedTuple):
    """A move that many steps make, its statement written once: putting one together costs as much as asking it."""

    current: StepState
    target: StepState
    reason: str
    statement: ReturningUpdate[Any]


class StepRow(NamedTuple):
    """What is looked at of a step whose row the session does not know; it costs far less than one that it does."""

    id: str
    scan_id: str
    generation: int
    kind: str
    frame: int
    token: int
    attempt: int
    deps_left: int
    facts: dict[str, Any] | None
    traceparent: str | None
    resume_digest: str | None


STEP_ROW: Final = tuple(table_of(Step).c[name] for name in StepRow._fields)
"""The columns of a `StepRow`."""


class Moved(NamedTuple):
    """A step after its move, and the event that is still to be recorded."""

    step: StepRow
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


def step_change(current: StepState, target: StepState, values: Values, reason: str = "") -> StepChange:
    """The move from `current` to `target` that also sets `values`, for `change_step`."""
    table = table_of(Step)
    statement = update(table).where(*_as_told(table.c, bindparam("step_id"), bindparam("held_token"), current))
    return StepChange(current, target, reason, statement.values(_changes(current, target, values)).returning(*STEP_ROW))


def change_step(
    session: Session, change: StepChange, step_id: str, token: int, values: Values | None = None
) -> Moved | None:
    """`move_step` where nobody has loaded the row; the caller records the event in the same transaction.

    `values` are those that the change left open.
    """
    row = session.execute(change.statement, {"step_id": step_id, "held_token": token, **(values or {})}).one_or_none()
    if row is None:
        return None
    step = StepRow(*row)
    return Moved(step, _step_event(step, change.current, change.target, change.reason))


def _as_told(columns: Any, step_id: Any, token: Any, current: StepState) -> tuple[ColumnElement[bool], ...]:
    return columns.id == step_id, columns.state == current.value, columns.token == token


def _changes(current: StepState, target: StepState, values: Values | None) -> dict[str, Any]:
    check_move(current, target)
    changes = {"state": target.value, **(values or {})}
    if target is StepState.READY and current is not StepState.SENT:  # a lost message does not end the wait
        changes.setdefault("ready_at", changes.get("not_before", now_s()))
    return changes


def _step_event(step: Step | StepRow, current: StepState, target: StepState, reason: str) -> EventRow:
    return _event(step.scan_id, step.id, step.generation, current.value, target.value, reason)


def count_down(session: Session, parent_id: str) -> list[EventRow]:
    """One parent less for every pending child of a step of a held scan: `ready` is who waits for nothing more.

    The caller records the events.
    """
    rows = session.execute(_COUNT_DOWN, {"parent_id": parent_id}).all()
    for known in session:
        if isinstance(known, Step):  # it may be one of the children
            session.expire(known)
    woken = sorted(StepRow(*row) for row in rows if row.deps_left == 0)
    return [_step_event(step, StepState.PENDING, StepState.READY, "") for step in woken]


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
        session.execute(_APPEND, list(rows[start : start + BATCH]))


def _make_count_down() -> ReturningUpdate[Any]:
    step, edge = table_of(Step), table_of(StepDependency).c
    children = select(edge.child_id).where(edge.parent_id == bindparam("parent_id"))
    check_move(StepState.PENDING, StepState.READY)
    is_last = step.c.deps_left == 1
    values = {
        "deps_left": step.c.deps_left - 1,
        "state": case((is_last, StepState.READY.value), else_=StepState.PENDING.value),
        "ready_at": case((is_last, now_s()), else_=None),
    }
    statement = update(step).where(step.c.id.in_(children), step.c.state == StepState.PENDING.value)
    return statement.values(values).returning(*STEP_ROW)


_COUNT_DOWN: Final = _make_count_down()
_APPEND: Final = insert(table_of(Event)).values(at=now_s()).inline()
