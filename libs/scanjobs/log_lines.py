"""What steps wrote while they were computed, line by line, for who follows a scan."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from sqlalchemy import insert, select
from sqlalchemy.orm import Session

from scanjobs.account_tables import LogLine
from scanjobs.clock import now_s
from scanjobs.tables import Scan, Step, table_of

LONGEST: Final = 1000
SETTLES_S: Final = 1.0
"""A line is shown this long after it was written: by then every line before it is there, whoever committed first."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Written:
    """A line, and the step that it is about."""

    id: int
    step_id: str | None
    kind: str | None
    frame: int | None
    token: int
    level: str
    text: str
    at: float


def append_lines(session: Session, *, scan_id: str, step_id: str, token: int, level: str, lines: Sequence[str]) -> None:
    """Keep lines of one attempt of a step; what is too long is cut, NUL (which PostgreSQL cannot hold) left out."""
    rows = [
        {"scan_id": scan_id, "step_id": step_id, "token": token, "level": level, "text": _clean(line)} for line in lines
    ]
    if rows:
        session.execute(insert(table_of(LogLine)).values(at=now_s()), rows)


def read_lines(
    session: Session, scan: Scan, *, after: int = 0, step_id: str | None = None, limit: int = 500
) -> tuple[Written, ...]:
    """The lines behind a place, oldest first."""
    query = (
        select(LogLine, Step.kind, Step.frame)
        .outerjoin(Step, Step.id == LogLine.step_id)
        .where(LogLine.scan_id == scan.id, LogLine.id > after)
    )
    if session.get_bind().dialect.name == "postgresql":
        query = query.where(LogLine.at < now_s() - SETTLES_S)
    if step_id is not None:
        query = query.where(LogLine.step_id == step_id)
    return tuple(
        Written(
            id=line.id,
            step_id=line.step_id,
            kind=kind,
            frame=frame,
            token=line.token,
            level=line.level,
            text=line.text,
            at=line.at,
        )
        for line, kind, frame in session.execute(query.order_by(LogLine.id).limit(limit))
    )


def _clean(line: str) -> str:
    return line.replace("\x00", "")[:LONGEST]
