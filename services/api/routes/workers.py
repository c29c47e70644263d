"""The workers of the service, for its operator: looked at, paused, resumed, drained.

They compute for everybody, so the scope `admin` is not enough: it makes a key the master of its own owner alone. The
operator is the owner `local`, who is also whoever calls a keyless service from its own machine.
"""

from collections.abc import Callable, Sequence
from typing import Annotated

from fastapi import APIRouter, Path
from scanjobs import workers
from scanjobs.errors import NotFound
from sqlalchemy.orm import Session

from services.api.dependencies import Operator, Parts, TheParts, uuid_of
from services.api.schemas import PresentWorker, WorkerList

LIST = "GET /v1/workers"
Name = Annotated[str, Path(description="Id of a worker.")]
Ask = Callable[[Session, Sequence[str]], None]
router = APIRouter(prefix="/v1/workers", tags=["workers"])


@router.get("")
def list_(parts: TheParts, _: Operator) -> WorkerList:
    """Every worker that is alive, whether it takes steps or not."""
    with parts.store.read() as session:
        return WorkerList(items=[PresentWorker.of(row) for row in workers.present_workers(session)])


@router.post("/{worker_id}/pause", status_code=202)
def pause(worker_id: Name, parts: TheParts, _: Operator) -> PresentWorker:
    """Take no more steps; what it computes it finishes, and it stays. Twice is the same as once."""
    return _do(parts, worker_id, workers.pause)


@router.post("/{worker_id}/resume", status_code=202)
def resume(worker_id: Name, parts: TheParts, _: Operator) -> PresentWorker:
    """Let a paused worker take steps again; one that drains goes on draining."""
    return _do(parts, worker_id, workers.resume)


@router.post("/{worker_id}/drain", status_code=202)
def drain(worker_id: Name, parts: TheParts, _: Operator) -> PresentWorker:
    """Give the steps under way back, with what they have saved, and end."""
    return _do(parts, worker_id, workers.drain)


def _do(parts: Parts, worker_id: str, ask: Ask) -> PresentWorker:
    which = uuid_of(worker_id, "worker", LIST)

    def work(session: Session) -> PresentWorker:
        ask(session, [which])
        found = next((row for row in workers.present_workers(session) if row.id == which), None)
        if found is None:
            raise NotFound(f"there is no worker {which}.", hint=f"List them with {LIST}.")
        return PresentWorker.of(found)

    return parts.store.write(work)
