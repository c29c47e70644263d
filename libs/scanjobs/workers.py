"""The workers that are alive: who they are, which queues they serve, and whether they are asked to drain."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from sqlalchemy import insert, select, update
from sqlalchemy.orm import Session

from scanjobs.clock import now_s
from scanjobs.states import StepState
from scanjobs.tables import Step, Worker
from scanjobs.transitions import UNSYNCHRONISED

ACTIVE: Final = "active"
PAUSED: Final = "paused"
DRAINING: Final = "draining"
GONE: Final = "gone"


@dataclass(frozen=True, slots=True, kw_only=True)
class WorkerIdentity:
    """One worker process; `host` tells in which process table its `pid` stands."""

    id: str
    host: str
    pid: int
    queues: tuple[str, ...]
    slots: int


def register(session: Session, worker: WorkerIdentity, lease_s: float) -> None:
    """Make a starting worker known."""
    values = {
        "id": worker.id,
        "host": worker.host[:255],
        "pid": worker.pid,
        "queues": ",".join(sorted(worker.queues)),
        "slots": worker.slots,
        "state": ACTIVE,
        "lease_until": now_s() + lease_s,
        "started_at": now_s(),
    }
    session.execute(insert(Worker).values(values))


def beat(session: Session, worker: WorkerIdentity, lease_s: float) -> str:
    """Prolong the worker's life; returns its state, `draining` or `paused` when an operator asked for it."""
    statement = update(Worker).where(Worker.id == worker.id, Worker.state != GONE)
    statement = statement.values(lease_until=now_s() + lease_s).returning(Worker.state)
    return session.scalars(statement, execution_options=UNSYNCHRONISED).one_or_none() or GONE


def drain(session: Session, worker_ids: Sequence[str]) -> None:
    """Ask workers to take no more steps and to end."""
    statement = update(Worker).where(Worker.id.in_(worker_ids), Worker.state.in_((ACTIVE, PAUSED)))
    session.execute(statement.values(state=DRAINING), execution_options=UNSYNCHRONISED)


def pause(session: Session, worker_ids: Sequence[str]) -> None:
    """Ask workers to take no more steps; what they compute they finish, and they stay."""
    statement = update(Worker).where(Worker.id.in_(worker_ids), Worker.state == ACTIVE)
    session.execute(statement.values(state=PAUSED), execution_options=UNSYNCHRONISED)


def resume(session: Session, worker_ids: Sequence[str]) -> None:
    """Let paused workers take steps again."""
    statement = update(Worker).where(Worker.id.in_(worker_ids), Worker.state == PAUSED)
    session.execute(statement.values(state=ACTIVE), execution_options=UNSYNCHRONISED)


def leave(session: Session, worker: WorkerIdentity) -> None:
    """The worker ends in good order."""
    statement = update(Worker).where(Worker.id == worker.id).values(state=GONE, lease_until=now_s())
    session.execute(statement, execution_options=UNSYNCHRONISED)


def bury(session: Session, worker_ids: Sequence[str]) -> None:
    """Workers that are known to be dead: their leases end now, and what waits in their memory is ready again."""
    if not worker_ids:
        return
    dead = update(Worker).where(Worker.id.in_(worker_ids)).values(state=GONE, lease_until=now_s())
    session.execute(dead, execution_options=UNSYNCHRONISED)
    held = update(Step).where(Step.worker_id.in_(worker_ids), Step.state == StepState.RUNNING)
    session.execute(held.values(lease_until=now_s() - 1.0), execution_options=UNSYNCHRONISED)
    unheard = update(Step).where(Step.worker_id.in_(worker_ids), Step.state == StepState.SENT)
    session.execute(unheard.values(sent_at=0.0), execution_options=UNSYNCHRONISED)


def living_of(session: Session, host: str) -> tuple[Worker, ...]:
    """The workers of a host that have not said goodbye, whether they are alive or not."""
    return tuple(session.scalars(select(Worker).where(Worker.host == host, Worker.state != GONE)))


def present_workers(session: Session) -> tuple[Worker, ...]:
    """Workers that live by the database's clock, whether they take steps or not."""
    query = select(Worker).where(Worker.state != GONE, Worker.lease_until > now_s())
    return tuple(session.scalars(query.order_by(Worker.id)))


def active_workers(session: Session) -> tuple[Worker, ...]:
    """Workers that take steps, by the database's clock."""
    query = select(Worker).where(Worker.state == ACTIVE, Worker.lease_until > now_s())
    return tuple(session.scalars(query.order_by(Worker.id)))
