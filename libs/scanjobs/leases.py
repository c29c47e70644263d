"""Who computes a step, and until when: claim, renew, finish, fail, give back, reap.

A claim takes the next fencing token of its step; every later write names that token and does nothing when another
claim has been made since. Leases run on the database's clock. `finish` counts down what the children wait for in the
transaction that ends the parent, so exactly one parent finds itself the last.
"""

from collections.abc import Sequence
from types import MappingProxyType
from typing import Any, Final

from sqlalchemy import Double, Update, bindparam, insert, select, update
from sqlalchemy.orm import Session

from scanjobs.claims import WORKER_LOST, Begun, Ended, RunnerNote
from scanjobs.claims import Claim as Claim
from scanjobs.claims import Failure as Failure
from scanjobs.claims import Standing as Standing
from scanjobs.clock import now_s
from scanjobs.fanin import (
    Output,
    attach_outputs,
    damn,
    digest_of,
    expand_plan,
    has_relatives,
    know_artifacts,
    lose_frame,
    wake_children,
)
from scanjobs.given import InputFile, inputs_of
from scanjobs.messages import IDENTIFY, TRAIN_GPU
from scanjobs.plan import StepKey
from scanjobs.settling import hold_scan_of, settle
from scanjobs.slots import Devices, take_slot
from scanjobs.states import OPEN_SCAN_STATES, WORKING_SCAN_STATES, ScanState, StepState
from scanjobs.store import together
from scanjobs.tables import Attempt, Scan, Step, table_of
from scanjobs.transitions import (
    UNSYNCHRONISED,
    EventRow,
    StepRow,
    change_step,
    move_scan,
    move_step,
    record,
    step_change,
)

FIRST_PAUSE_S: Final = 1.0
"""Before the second attempt; doubled for each later one. A worker that was lost has cost its lease already."""
LONGEST_PAUSE_S: Final = 30.0
BUSY_S: Final = 1.0
"""Before a step that found every GPU busy is sent again."""


def claim(
    session: Session, step_id: str, worker_id: str, lease_s: float, devices: Devices | None = None
) -> Claim | None:
    """Take a sent step; None when it is no longer there to be taken, or needs a GPU and none is free.

    Without `devices`, or with none of them, what prefers a GPU is computed without.
    """
    held = _held_step(session, step_id)
    if held is None:
        return None
    scan, step = held
    if step.state != StepState.SENT or scan.state not in WORKING_SCAN_STATES:
        return None
    device = None
    if step.queue == TRAIN_GPU and devices is not None and devices.gpus:
        device = take_slot(session, devices, step.id, step.token + 1)
        if device is None:
            move_step(session, step, StepState.READY, reason="no GPU is free", values={"not_before": now_s() + BUSY_S})
            return None
    began = begin(session, scan, step.id, step.token, StepState.SENT, worker_id, lease_s, device)
    if began is None:
        return None
    record_begun(session, began, [began.event])
    return began.claim


def begin(
    session: Session,
    scan: Scan,
    step_id: str,
    token: int,
    state: StepState,
    worker_id: str,
    lease_s: float,
    device: str | None = None,
) -> Begun | None:
    """Claim a step of a held scan, or None when it no longer is as told; `record_begun` completes it."""
    moved = change_step(session, _BEGINS[state], step_id, token, {"worker_id": worker_id, "lease_s": lease_s})
    if moved is None:
        return None
    claim = _claim_of(scan, moved.step, inputs_of(session, moved.step), device)
    if scan.state == ScanState.QUEUED:
        move_scan(session, scan, ScanState.RUNNING, values={"started_at": now_s()})
    return Begun(claim, worker_id, moved.event)


def record_begun(session: Session, begun: Begun, events: Sequence[EventRow]) -> None:
    """Write down, with the events of the transaction, the attempt that a claim is and that its scan was served."""
    claim = begun.claim
    attempt = {"step_id": claim.step_id, "token": claim.token, "worker_id": begun.worker_id}
    with together(session):
        session.execute(_SERVED, {"scan_id": claim.scan_id})
        session.execute(_ATTEMPTED, attempt)
        record(session, events)


def note_runner(session: Session, held: Claim, runner: RunnerNote) -> bool:
    """Record which process computes the claim, and where it logs."""
    statement = update(Attempt).where(Attempt.step_id == held.step_id, Attempt.token == held.token)
    session.execute(statement.values(runner._asdict()), execution_options=UNSYNCHRONISED)
    return True


def renew(session: Session, held: Claim, lease_s: float, done: int, total: int, message: str) -> Standing:
    """Prolong the lease and tell how far the step is."""
    statement = (
        update(Step)
        .where(Step.id == held.step_id, Step.token == held.token, Step.state == StepState.RUNNING)
        .values(
            lease_until=now_s() + lease_s,
            progress_done=done,
            progress_total=total,
            progress_message=message[:500],
        )
    )
    session.execute(statement, execution_options=UNSYNCHRONISED)
    return standing(session, held)


def save(session: Session, held: Claim, saved: Output) -> bool:
    """Remember what a computing step has saved on its way, for its next attempt; False when the claim is lost."""
    owned = _owned(session, held)
    if owned is None:
        return False
    know_artifacts(session, [saved])
    statement = update(Step).where(Step.id == held.step_id).values(resume_digest=saved.digest)
    session.execute(statement, execution_options=UNSYNCHRONISED)
    return True


def standing(session: Session, held: Claim) -> Standing:
    """Whether the step is still this claim's, and wanted."""
    query = select(Step.token, Step.state, Scan.state).join(Scan, Scan.id == Step.scan_id)
    row = session.execute(query.where(Step.id == held.step_id)).one_or_none()
    if row is None or row[0] != held.token or row[1] != StepState.RUNNING:
        return Standing.LOST
    return Standing.CANCELED if row[2] == ScanState.CANCELING else Standing.HELD


def finish(
    session: Session, held: Claim, outputs: Sequence[Output], facts: dict[str, Any], runner: RunnerNote | None = None
) -> bool:
    """Accept the result of a claim and wake what waited for it; False when the claim is lost."""
    ended = end_well(session, held, outputs, facts, runner)
    if ended is None:
        return False
    record(session, ended.events)
    return True


def end_well(
    session: Session, held: Claim, outputs: Sequence[Output], facts: dict[str, Any], runner: RunnerNote | None
) -> Ended | None:
    """`finish` without the events that it leaves to the caller; None when the claim is lost."""
    scan = hold_scan_of(session, held.step_id)
    if scan is None:
        return None
    digest = digest_of(held.spec, StepKey(held.kind, held.frame), held.inputs)
    values = {"facts": facts, "input_digest": digest}
    moved = change_step(session, _ENDS_WELL, held.step_id, held.token, values)
    if moved is None:
        return None
    step = moved.step
    with together(session):
        _end_attempt(session, step, "succeeded", None, runner)
        attach_outputs(session, step, outputs)
    events = [moved.event]
    if scan.state in OPEN_SCAN_STATES:
        expand_plan(session, scan, step)
        events += wake_children(session, scan, step)
    if scan.state == ScanState.CANCELING or step.kind == IDENTIFY or has_relatives(scan):
        record(session, events)  # who follows the scan hears of the step before he hears of the end
        settle(session, scan)
        events = []
    return Ended(scan, events)


def fail(session: Session, held: Claim, failure: Failure, max_attempts: int) -> bool:
    """Record a failed attempt: the step is tried again, or is lost for good; False when the claim is lost."""
    owned = _owned(session, held)
    if owned is None:
        return False
    scan, step = owned
    if failure.damaged is not None:
        damn(session, failure.damaged)
    _end_attempt(session, step, "failed", failure)
    _after_failure(session, scan, step, failure, max_attempts)
    return True


def give_back(session: Session, held: Claim, reason: str) -> bool:
    """Return a step untouched, its attempt not counted (a drain); False when the claim is lost."""
    owned = _owned(session, held)
    if owned is None:
        return False
    scan, step = owned
    if scan.state == ScanState.CANCELING:
        return _stop(session, scan, step, reason)
    _move_from_running(session, step, StepState.READY, reason, attempt=max(0, step.attempt - 1))
    return True


def stopped(session: Session, held: Claim) -> bool:
    """The step of a cancelled scan has stopped computing; False when the claim is lost."""
    owned = _owned(session, held)
    return owned is not None and _stop(session, *owned, "canceled")


def reap(session: Session, step_id: str, max_attempts: int) -> bool:
    """Take a step from a worker that has not been heard of for a lease; False when there is nothing to take."""
    held = _held_step(session, step_id)
    if held is None:
        return False
    scan, step = held
    overdue = select(Step.id).where(Step.id == step_id, Step.lease_until < now_s(), Step.state == StepState.RUNNING)
    if session.scalars(overdue).first() is None:
        return False
    _end_attempt(session, step, "lease expired", WORKER_LOST)
    _after_failure(session, scan, step, WORKER_LOST, max_attempts)
    return True


def overdue_steps(session: Session) -> tuple[str, ...]:
    """Running steps whose lease has expired."""
    query = select(Step.id).where(Step.state == StepState.RUNNING, Step.lease_until < now_s())
    return tuple(session.scalars(query.order_by(Step.id)))


def _held_step(session: Session, step_id: str) -> tuple[Scan, Step] | None:
    scan = hold_scan_of(session, step_id)
    step = None if scan is None else session.get(Step, step_id, populate_existing=True)
    return None if scan is None or step is None else (scan, step)


def _owned(session: Session, held: Claim) -> tuple[Scan, Step] | None:
    found = _held_step(session, held.step_id)
    if found is None or found[1].token != held.token or found[1].state != StepState.RUNNING:
        return None
    return found


def _claim_of(scan: Scan, step: StepRow, inputs: tuple[InputFile, ...], device: str | None) -> Claim:
    return Claim(
        step_id=step.id,
        scan_id=scan.id,
        token=step.token,
        attempt=step.attempt,
        kind=step.kind,
        frame=step.frame,
        spec=scan.spec,
        inputs=inputs,
        traceparent=step.traceparent,
        resume=step.resume_digest,
        device=device,
    )


def _after_failure(session: Session, scan: Scan, step: Step, failure: Failure, max_attempts: int) -> None:
    error = _error_of(step, failure)
    if scan.state == ScanState.CANCELING:
        _stop(session, scan, step, failure.code)
    elif failure.retryable and (step.attempt < max_attempts or not failure.counted):
        lasts_s = 0.0 if failure is WORKER_LOST else _pause_after(step.attempt)
        attempt = step.attempt if failure.counted else max(0, step.attempt - 1)
        _move_from_running(
            session, step, StepState.READY, failure.code, error=error, not_before=now_s() + lasts_s, attempt=attempt
        )
    else:
        _move_from_running(session, step, StepState.FAILED, failure.code, error=error, finished_at=now_s())
        lose_frame(session, scan, step, error)


def _pause_after(attempt: int) -> float:
    return min(LONGEST_PAUSE_S, FIRST_PAUSE_S * 2.0 ** min(10, max(0, attempt - 1)))


def _error_of(step: Step | StepRow, failure: Failure) -> dict[str, Any]:
    return {
        "step": step.kind,
        "frame": step.frame,
        "code": failure.code,
        "message": failure.message,
        "hint": failure.hint,
        "retryable": failure.retryable,
    }


def _stop(session: Session, scan: Scan, step: Step, reason: str) -> bool:
    _move_from_running(session, step, StepState.CANCELED, reason, finished_at=now_s())
    settle(session, scan)
    return True


def _move_from_running(session: Session, step: Step, target: StepState, reason: str, **values: Any) -> None:
    _end_attempt(session, step, reason, None)
    move_step(session, step, target, reason=reason, values={"lease_until": None, "worker_id": None, **values})


def _end_attempt(
    session: Session, step: Step | StepRow, outcome: str, failure: Failure | None, runner: RunnerNote | None = None
) -> None:
    values: dict[str, Any] = {"of_step": step.id, "of_token": step.token, "outcome": outcome[:32]}
    if runner is not None:
        values |= runner._asdict()
    if failure is not None:
        values |= {"exit_code": failure.exit_code, "error": _error_of(step, failure)}
    session.execute(_ATTEMPT_ENDED, values)


_ENDS_WELL: Final = step_change(
    StepState.RUNNING,
    StepState.SUCCEEDED,
    {"finished_at": now_s(), "resume_digest": None, "lease_until": None, "worker_id": None},
    reason="succeeded",
)
_BEGUN: Final = MappingProxyType(
    {
        "token": Step.token + 1,
        "attempt": Step.attempt + 1,
        "lease_until": now_s() + bindparam("lease_s", type_=Double),
        "started_at": now_s(),
        "progress_done": 0,
        "progress_total": 0,
        "progress_message": "",
        "not_before": None,
        "error": None,
    }
)
_BEGINS: Final = {state: step_change(state, StepState.RUNNING, _BEGUN) for state in (StepState.READY, StepState.SENT)}


def _make_served() -> Update:
    table = table_of(Scan)
    return update(table).where(table.c.id == bindparam("scan_id")).values(served=table.c.served + 1, served_at=now_s())


def _make_attempt_ended() -> Update:
    table = table_of(Attempt)
    named = table.c.step_id == bindparam("of_step"), table.c.token == bindparam("of_token")
    return update(table).where(*named, table.c.ended_at.is_(None)).values(ended_at=now_s())


_SERVED: Final = _make_served()
_ATTEMPTED: Final = insert(table_of(Attempt)).values(started_at=now_s()).inline()
_ATTEMPT_ENDED: Final = _make_attempt_ended()
