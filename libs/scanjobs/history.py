"""How long steps of past scans took: what the time of a next one is told from."""

from dataclasses import dataclass
from typing import Any

from sqlalchemy import func, select
from sqlalchemy.orm import Session

from scanjobs.states import ScanState, StepState
from scanjobs.tables import Scan, Step

SCANS = 20
"""The newest that are looked at."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PastKind:
    """The mean duration of the steps of one kind in one scan, its specification and its number of frames."""

    spec: dict[str, Any]
    frames: int
    step: str
    seconds: float


def past_kinds(session: Session) -> tuple[PastKind, ...]:
    """Of the newest succeeded scans of all owners, whose durations alone are looked at.

    Frame steps only, and the whole scan's identification: the first training is of another size. What was taken over
    from an earlier scan took no time and does not count.
    """
    newest = select(Scan.id).where(Scan.state == ScanState.SUCCEEDED).order_by(Scan.id.desc()).limit(SCANS)
    query = (
        select(Scan.id, Step.kind, func.avg(Step.finished_at - Step.started_at))
        .join(Step, Step.scan_id == Scan.id)
        .where(Scan.id.in_(newest), Step.state == StepState.SUCCEEDED, Step.reused_from.is_(None))
        .where((Step.frame >= 0) | (Step.kind == "scan.identify"))
        .where(Step.generation == Scan.generation)
        .group_by(Scan.id, Step.kind)
    )
    rows = session.execute(query).all()
    scans = {scan.id: scan for scan in session.scalars(select(Scan).where(Scan.id.in_({row[0] for row in rows})))}
    return tuple(
        PastKind(spec=scans[scan].spec, frames=scans[scan].frames or 0, step=kind, seconds=float(mean))
        for scan, kind, mean in rows
        if mean is not None
    )
