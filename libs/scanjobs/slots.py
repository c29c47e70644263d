"""One training per GPU: a host's devices are rows, and a claim that needs one takes one.

A slot belongs to a claim (a step and its token) and is free as soon as that claim no longer computes, however it ended:
there is nothing to give back that could be forgotten.
"""

from dataclasses import dataclass

from sqlalchemy import insert, select, update
from sqlalchemy.orm import Session

from scanjobs.states import StepState
from scanjobs.store import one_at_a_time
from scanjobs.tables import ResourceSlot, Step, table_of
from scanjobs.transitions import UNSYNCHRONISED

TAKING = 3
"""Names the lock: two claims at once would each see the same device free."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Devices:
    """The GPUs of a worker's machine."""

    host: str
    gpus: int

    @property
    def names(self) -> tuple[str, ...]:
        """`gpu:0`, `gpu:1` …"""
        return tuple(f"gpu:{number}" for number in range(self.gpus))


def take_slot(session: Session, devices: Devices, step_id: str, token: int) -> str | None:
    """A free device for the claim of a step under this token; None when all compute."""
    one_at_a_time(session, TAKING)
    _know(session, devices)
    busy = select(Step.id).where(
        Step.id == ResourceSlot.step_id, Step.token == ResourceSlot.token, Step.state == StepState.RUNNING
    )
    free = select(ResourceSlot.name).where(
        ResourceSlot.host == devices.host, ResourceSlot.name.in_(devices.names), ~busy.exists()
    )
    name = session.scalars(free.order_by(ResourceSlot.name).limit(1)).one_or_none()
    if name is not None:
        mine = update(ResourceSlot).where(ResourceSlot.host == devices.host, ResourceSlot.name == name)
        session.execute(mine.values(step_id=step_id, token=token), execution_options=UNSYNCHRONISED)
    return name


def _know(session: Session, devices: Devices) -> None:
    known = set(session.scalars(select(ResourceSlot.name).where(ResourceSlot.host == devices.host)))
    rows = [{"host": devices.host, "name": name, "token": 0} for name in devices.names if name not in known]
    if rows:
        session.execute(insert(table_of(ResourceSlot)), rows)
