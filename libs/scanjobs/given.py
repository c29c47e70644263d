"""What a step is given: the files that its parents have made."""

from dataclasses import dataclass

from sqlalchemy import ColumnElement, and_, or_, select
from sqlalchemy.orm import Session

from scanjobs.messages import EXTRACT, READ, RENDER
from scanjobs.plan import StepKey, is_partial
from scanjobs.tables import ArtifactRef, Step, StepDependency


@dataclass(frozen=True, slots=True, kw_only=True)
class InputFile:
    """An artifact that a parent made."""

    kind: str
    frame: int
    role: str
    name: str
    digest: str


def inputs_of(session: Session, step_id: str) -> tuple[InputFile, ...]:
    """What the parents of a step have made; never the truth of a simulation.

    Who tells the modes so far is given the clouds of all frames before it, not only of those that it waited for.
    """
    step = session.get_one(Step, step_id)
    query = (
        select(Step.kind, Step.frame, ArtifactRef.role, ArtifactRef.name, ArtifactRef.digest)
        .join(ArtifactRef, ArtifactRef.step_id == Step.id)
        .where(_is_given(step), ArtifactRef.role != "truth")
        .order_by(Step.depth, Step.frame, ArtifactRef.role)
    )
    return tuple(
        InputFile(kind=kind, frame=frame, role=role, name=name, digest=digest)
        for kind, frame, role, name, digest in session.execute(query)
    )


def _is_given(step: Step) -> ColumnElement[bool]:
    """Whether a row is one whose files the step is given."""
    if not is_partial(StepKey(step.kind, step.frame)):
        return Step.id.in_(select(StepDependency.parent_id).where(StepDependency.child_id == step.id))
    earlier = and_(Step.kind == EXTRACT, Step.frame < step.frame)
    first = and_(Step.kind.in_((RENDER, READ)), Step.frame == 0)
    return and_(Step.scan_id == step.scan_id, Step.generation == step.generation, or_(earlier, first))
