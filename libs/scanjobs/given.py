"""What a step is given: the files that its parents have made."""

from dataclasses import dataclass

from sqlalchemy import select
from sqlalchemy.orm import Session

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
    """What the parents of a step have made; never the truth of a simulation."""
    query = (
        select(Step.kind, Step.frame, ArtifactRef.role, ArtifactRef.name, ArtifactRef.digest)
        .join(StepDependency, StepDependency.parent_id == Step.id)
        .join(ArtifactRef, ArtifactRef.step_id == Step.id)
        .where(StepDependency.child_id == step_id, ArtifactRef.role != "truth")
        .order_by(Step.depth, Step.frame, ArtifactRef.role)
    )
    return tuple(
        InputFile(kind=kind, frame=frame, role=role, name=name, digest=digest)
        for kind, frame, role, name, digest in session.execute(query)
    )
