"""What a step is given: the files that its parents have made."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

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


_COLUMNS: Final = (Step.kind, Step.frame, ArtifactRef.role, ArtifactRef.name, ArtifactRef.digest)


def inputs_of(session: Session, step_id: str) -> tuple[InputFile, ...]:
    """What the parents of a step have made; never the truth of a simulation, nor its depth maps.

    Who tells the modes so far is given the clouds of all frames before it, not only of those that it waited for.
    """
    step = session.get_one(Step, step_id)
    query = (
        select(*_COLUMNS)
        .join(ArtifactRef, ArtifactRef.step_id == Step.id)
        .where(_is_given(step), ArtifactRef.role.not_in(("truth", "depth")))
        .order_by(Step.depth, Step.frame, ArtifactRef.role)
    )
    return tuple(_file(*row) for row in session.execute(query))


def inputs_of_all(session: Session, steps: Sequence[Step]) -> dict[str, tuple[InputFile, ...]]:
    """`inputs_of` of many steps by their ids, with one statement for all that are given their parents' files alone."""
    plain = [step.id for step in steps if not is_partial(StepKey(step.kind, step.frame))]
    found: dict[str, list[InputFile]] = {step_id: [] for step_id in plain}
    query = (
        select(StepDependency.child_id, *_COLUMNS)
        .join(Step, Step.id == StepDependency.parent_id)
        .join(ArtifactRef, ArtifactRef.step_id == Step.id)
        .where(StepDependency.child_id.in_(plain), ArtifactRef.role.not_in(("truth", "depth")))
        .order_by(Step.depth, Step.frame, ArtifactRef.role)
    )
    for child_id, kind, frame, role, name, digest in session.execute(query) if plain else ():
        found[child_id].append(_file(kind, frame, role, name, digest))
    others = {step.id: inputs_of(session, step.id) for step in steps if step.id not in found}
    return {step_id: tuple(files) for step_id, files in found.items()} | others


def _file(kind: str, frame: int, role: str, name: str, digest: str) -> InputFile:
    return InputFile(kind=kind, frame=frame, role=role, name=name, digest=digest)


def _is_given(step: Step) -> ColumnElement[bool]:
    """Whether a row is one whose files the step is given."""
    if not is_partial(StepKey(step.kind, step.frame)):
        return Step.id.in_(select(StepDependency.parent_id).where(StepDependency.child_id == step.id))
    earlier = and_(Step.kind == EXTRACT, Step.frame < step.frame)
    first = and_(Step.kind.in_((RENDER, READ)), Step.frame == 0)
    return and_(Step.scan_id == step.scan_id, Step.generation == step.generation, or_(earlier, first))
