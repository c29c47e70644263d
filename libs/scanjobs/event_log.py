"""The event table read as a log: every event once, in an order that never changes, resumable from any place.

Ids alone do not give that on PostgreSQL: a transaction may take an id first and commit last, and a reader who has seen
the later id would never see it. There every event carries the number of its transaction; readers order by it and look
only at transactions that began before every one that is still open. SQLite has one writer: ids are the order.
"""

import re
from dataclasses import dataclass
from typing import Any, Final, Self

from sqlalchemy import BigInteger, ColumnElement, Select, select, tuple_
from sqlalchemy.ext.compiler import compiles
from sqlalchemy.orm import Session
from sqlalchemy.sql.functions import GenericFunction

from scanjobs.errors import InvalidCursor
from scanjobs.table_base import Base
from scanjobs.tables import Event, Scan, Step

PLACE: Final = re.compile(r"[0-9]{1,18}-[0-9]{1,18}")


class settled_before(GenericFunction[int]):
    """In a statement: every transaction with a lower number has ended."""

    type = BigInteger()
    name = "settled_before"
    inherit_cache = True


@compiles(settled_before, "sqlite")
def _settled_on_sqlite(element: settled_before, compiler: Any, **options: Any) -> str:  # noqa: ARG001
    return "1"


@compiles(settled_before, "postgresql")
def _settled_on_postgresql(element: settled_before, compiler: Any, **options: Any) -> str:  # noqa: ARG001
    return "pg_snapshot_xmin(pg_current_snapshot())::text::bigint"


@dataclass(frozen=True, slots=True, order=True)
class Place:
    """Where a reader stands: behind this event."""

    transaction: int = 0
    event: int = 0

    def __str__(self) -> str:
        return f"{self.transaction}-{self.event}"

    @classmethod
    def parse(cls, text: str) -> Self:
        """The place that `str` wrote. Raises `InvalidCursor`."""
        if not PLACE.fullmatch(text):
            hint = "Use the id of an event, or none to begin with."
            raise InvalidCursor("this is no place in the events.", where="Last-Event-ID", hint=hint)
        transaction, event = text.split("-")
        return cls(int(transaction), int(event))


BEGINNING: Final = Place()


@dataclass(frozen=True, slots=True, kw_only=True)
class Happening:
    """An event with what a reader wants to know beside it; `kind` and `frame` are None for one of the whole scan."""

    place: Place
    owner: str
    scan_id: str
    step_id: str | None
    kind: str | None
    frame: int | None
    generation: int
    before: str | None
    after: str
    reason: str
    at: float


def read_events(
    session: Session,
    after: Place,
    *,
    owner: str | None = None,
    scan_id: str | None = None,
    steps: bool = True,
    limit: int = 200,
) -> tuple[Happening, ...]:
    """What happened behind a place, oldest first: to one scan, or to all of an owner, or to all."""
    query = _events().where(_is_after(after), Event.transaction_number < settled_before())
    if scan_id is not None:
        query = query.where(Event.scan_id == scan_id)
    if owner is not None:
        query = query.where(Scan.owner == owner)
    if not steps:
        query = query.where(Event.step_id.is_(None))
    query = query.order_by(Event.transaction_number, Event.id).limit(limit)
    return tuple(_happening(*row) for row in session.execute(query))


def last_place(session: Session) -> Place:
    """Behind everything that has happened."""
    query = select(Event.transaction_number, Event.id).where(Event.transaction_number < settled_before())
    row = session.execute(query.order_by(Event.transaction_number.desc(), Event.id.desc()).limit(1)).one_or_none()
    return BEGINNING if row is None else Place(row[0], row[1])


def _events() -> "Select[Event, str, str, int]":
    return (
        select(Event, Scan.owner, Step.kind, Step.frame)
        .join(Scan, Scan.id == Event.scan_id)
        .outerjoin(Step, Step.id == Event.step_id)
    )


def _is_after(place: Place) -> ColumnElement[bool]:
    return tuple_(Event.transaction_number, Event.id) > tuple_(place.transaction, place.event)


def _happening(event: Base, owner: str, kind: str | None, frame: int | None) -> Happening:
    assert isinstance(event, Event)
    return Happening(
        place=Place(event.transaction_number, event.id),
        owner=owner,
        scan_id=event.scan_id,
        step_id=event.step_id,
        kind=kind,
        frame=frame,
        generation=event.generation,
        before=event.from_state,
        after=event.to_state,
        reason=event.reason,
        at=event.at,
    )
