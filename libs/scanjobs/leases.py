"""Who computes a step, and until when: claim, renew, finish, fail, give back, reap.

A claim takes the next fencing token of its step; every later write names that token and does nothing when another
claim has been made since. Leases run on the database's clock. `finish` counts down what the children wait for in the
transaction that ends the parent, so exactly one parent finds itself the last.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Final

from sqlalchemy import insert, select, update
from sqlalchemy.orm import Session

from scanjobs.clock import now_s
from scanjobs.errors import NotFound
from scanjobs.fanin import Output, attach_outputs, damn, expand_plan, know_artifact, lose_frame, release_children
from scanjobs.given import InputFile, inputs_of
from scanjobs.messages import TRAIN_GPU
from scanjobs.settling import hold_scan, settle
from scanjobs.slots import Devices, take_slot
from scanjobs.states import OPEN_SCAN_STATES, WORKING_SCAN_STATES, ScanState, StepState
from scanjobs.tables import Attempt, Scan, Step
from scanjobs.transitions import UNSYNCHRONISED, move_scan, move_step

FIRST_PAUSE_S: Final = 1.0
"""Before the second attempt; doubled for each later one. A worker that was lost has cost its lease already."""
LONGEST_PAUSE_S: Final = 30.0
BUSY_S: Final = 1.0
"""Before a step that found every GPU busy is sent again."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Claim:
    """The right to compute one step once, and all that is needed for it."""

    step_id: str
    scan_id: str
    token: int
    attempt: int
    kind: str
    frame: int
    spec: dict[str, Any]
    inputs: tuple[InputFile, ...]
    traceparent: str | None = None
    """Of the request that the step comes from."""
    resume: str | None = None
    """Digest of what an earlier attempt has saved on its way."""
    device: str | None = None
    """The GPU that this claim has for itself (`gpu:0`)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Failure:
    """Why an attempt failed, in the words that the user reads."""

    code: str
    message: str
    hint: str | None = None
    retryable: bool = True
    counted: bool = True
    """False where the step is not to blame: a full disk."""
    exit_code: int | None = None
    damaged: str | None = None
    """Digest of an input that is not what it was; the step that made it is no longer kept by a retry."""


WORKER_LOST: Final = Failure(
    code="LEASE_EXPIRED",
    message="the worker that computed this step was not heard of any more.",
    hint="If it happens again, look at that machine's memory and log, then retry the scan.",
)


class Standing(StrEnum):
    """What a claim is worth now."""

    HELD = "held"
    LOST = "lost"
    CANCELED = "canceled"


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
    _serve_scan(session, scan)
    values = {
        "token": step.token + 1,
        "attempt": step.attempt + 1,
        "worker_id": worker_id,
        "lease_until": now_s() + lease_s,
        "started_at": now_s(),
        "progress_done": 0,
        "progress_total": 0,
        "progress_message": "",
        "error": None,
    }
    if not move_step(session, step, StepState.RUNNING, values=values):
        return None
    attempt = {"step_id": step.id, "token": step.token, "worker_id": worker_id, "started_at": now_s()}
    session.execute(insert(Attempt).values(attempt))
    return _claim_of(session, scan, step, device)


def note_runner(session: Session, held: Claim, pid: int, log_key: str) -> bool:
    """Record which process computes the claim, and where it logs."""
    statement = update(Attempt).where(Attempt.step_id == held.step_id, Attempt.token == held.token)
    session.execute(statement.values(pid=pid, log_key=log_key), execution_options=UNSYNCHRONISED)
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
    know_artifact(session, saved)
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


def finish(session: Session, held: Claim, outputs: Sequence[Output], facts: dict[str, Any]) -> bool:
    """Accept the result of a claim and wake what waited for it; False when the claim is lost."""
    owned = _owned(session, held)
    if owned is None:
        return False
    scan, step = owned
    attach_outputs(session, step, outputs)
    ended = {"facts": facts, "finished_at": now_s(), "resume_digest": None}
    _move_from_running(session, step, StepState.SUCCEEDED, "succeeded", **ended)
    if scan.state in OPEN_SCAN_STATES:
        expand_plan(session, scan, step)
        release_children(session, scan, step)
    settle(session, scan)
    return True


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
    try:
        scan = hold_scan(session, select(Step.scan_id).where(Step.id == step_id).scalar_subquery())
    except NotFound:
        return None
    step = session.get(Step, step_id, populate_existing=True)
    return None if step is None else (scan, step)


def _owned(session: Session, held: Claim) -> tuple[Scan, Step] | None:
    found = _held_step(session, held.step_id)
    if found is None or found[1].token != held.token or found[1].state != StepState.RUNNING:
        return None
    return found


def _serve_scan(session: Session, scan: Scan) -> None:
    served = update(Scan).where(Scan.id == scan.id).values(served=Scan.served + 1, served_at=now_s())
    session.execute(served, execution_options=UNSYNCHRONISED)
    if scan.state == ScanState.QUEUED:
        move_scan(session, scan, ScanState.RUNNING, values={"started_at": now_s()})


def _claim_of(session: Session, scan: Scan, step: Step, device: str | None) -> Claim:
    return Claim(
        step_id=step.id,
        scan_id=scan.id,
        token=step.token,
        attempt=step.attempt,
        kind=step.kind,
        frame=step.frame,
        spec=scan.spec,
        inputs=inputs_of(session, step.id),
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


def _error_of(step: Step, failure: Failure) -> dict[str, Any]:
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


def _end_attempt(session: Session, step: Step, outcome: str, failure: Failure | None) -> None:
    values: dict[str, Any] = {"ended_at": now_s(), "outcome": outcome[:32]}
    if failure is not None:
        values |= {"exit_code": failure.exit_code, "error": _error_of(step, failure)}
    statement = update(Attempt).where(
        Attempt.step_id == step.id, Attempt.token == step.token, Attempt.ended_at.is_(None)
    )
    session.execute(statement.values(values), execution_options=UNSYNCHRONISED)
