"""How many seconds a scan may still take: the work left, at the pace the service has worked on it so far."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from scanjobs.clock import now_s
from scanjobs.repository import KindSummary
from scanjobs.states import StepState
from scanjobs.tables import Scan, Step
from sqlalchemy import func, select
from sqlalchemy.orm import Session


@dataclass(frozen=True, slots=True, kw_only=True)
class Pace:
    """Seconds that finished steps took on average, per kind, and in sum; seconds since the first began."""

    mean_s: Mapping[str, float]
    worked_s: float
    elapsed_s: float


def measure_pace(session: Session, scan: Scan) -> Pace:
    """The pace of the present generation; what was taken over from an earlier one does not count."""
    took = Step.finished_at - Step.started_at
    query = (
        select(Step.kind, func.avg(took), func.sum(took), func.min(Step.started_at), now_s())
        .where(Step.scan_id == scan.id, Step.generation == scan.generation)
        .where(Step.state == StepState.SUCCEEDED, Step.reused_from.is_(None), Step.started_at.is_not(None))
        .group_by(Step.kind)
    )
    rows = [
        (kind, float(mean), float(total), float(first), float(now))
        for kind, mean, total, first, now in session.execute(query)
    ]
    if not rows:
        return Pace(mean_s={}, worked_s=0.0, elapsed_s=0.0)
    return Pace(
        mean_s={row[0]: row[1] for row in rows},
        worked_s=sum(row[2] for row in rows),
        elapsed_s=rows[0][4] - min(row[3] for row in rows),
    )


def seconds_left(progress: Sequence[KindSummary], pace: Pace) -> float | None:
    """The work left, divided by the seconds of work done per second.

    A kind of which no step has ended yet is taken to cost what the dearest known kind costs. None while nothing
    has ended.
    """
    if not pace.mean_s or pace.worked_s <= 0 or pace.elapsed_s <= 0:
        return None
    dearest = max(pace.mean_s.values())
    left = sum(_steps_left(row) * pace.mean_s.get(row.kind, dearest) for row in progress)
    return round(left * pace.elapsed_s / pace.worked_s, 1)


def _steps_left(row: KindSummary) -> float:
    return max(row.total * (1 - row.fraction) - row.failed, 0.0)
