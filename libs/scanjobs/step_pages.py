"""A scan's steps in pages, in the order they may run."""

from collections.abc import Collection
from typing import NamedTuple

from sqlalchemy import select, tuple_
from sqlalchemy.orm import Session

from scanjobs.tables import Scan, Step


class StepPlace(NamedTuple):
    """Behind which step a page begins."""

    depth: int
    frame: int
    id: str


def page_of_steps(
    session: Session,
    scan: Scan,
    *,
    after: StepPlace | None = None,
    kind: str | None = None,
    states: Collection[str] = (),
    limit: int = 500,
) -> tuple[Step, ...]:
    """Steps of the scan's present generation behind a place."""
    query = select(Step).where(Step.scan_id == scan.id, Step.generation == scan.generation)
    if kind is not None:
        query = query.where(Step.kind == kind)
    if states:
        query = query.where(Step.state.in_(states))
    if after is not None:
        query = query.where(tuple_(Step.depth, Step.frame, Step.id) > tuple_(*after))
    return tuple(session.scalars(query.order_by(Step.depth, Step.frame, Step.id).limit(limit)))


def place_of(step: Step) -> StepPlace:
    """Behind this step."""
    return StepPlace(step.depth, step.frame, step.id)
