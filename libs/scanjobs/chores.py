"""Work that one worker does for all, now and then: whoever asks first after the interval does it."""

from sqlalchemy import update
from sqlalchemy.dialects import postgresql, sqlite
from sqlalchemy.orm import Session

from scanjobs.clock import now_s
from scanjobs.tables import Chore
from scanjobs.transitions import UNSYNCHRONISED


def is_mine(session: Session, name: str, every_s: float) -> bool:
    """Whether the caller is to do the chore now; True at most once in `every_s` over all machines.

    Who then dies in the middle leaves it to the next interval: a chore is never needed for a scan to go on.
    """
    dialect = postgresql if session.get_bind().dialect.name == "postgresql" else sqlite
    known = dialect.insert(Chore).values(name=name, begun_at=0.0).on_conflict_do_nothing()
    session.execute(known)
    due = update(Chore).where(Chore.name == name, Chore.begun_at <= now_s() - every_s).values(begun_at=now_s())
    return bool(session.execute(due.returning(Chore.name), execution_options=UNSYNCHRONISED).all())
