"""Schedules: when a plant is scanned again. A chore submits what is due; what could not be is noted as missed."""

from collections.abc import Sequence

from sqlalchemy import func, select
from sqlalchemy.orm import Session

from scanjobs.fleet.tables import Schedule


def next_due_of(session: Session, plant_keys: Sequence[str]) -> dict[str, float]:
    """When plants are scanned next, of those that have a schedule."""
    query = select(Schedule.plant_key, func.min(Schedule.next_due_at)).where(
        Schedule.plant_key.in_(plant_keys), Schedule.enabled
    )
    return {row[0]: row[1] for row in session.execute(query.group_by(Schedule.plant_key))}
