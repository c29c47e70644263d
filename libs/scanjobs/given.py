"""What a step is given: the files that its parents have made."""

from dataclasses import dataclass
from typing import Any, Final

from sqlalchemy import Integer, Select, and_, bindparam, or_, select
from sqlalchemy.orm import Session

from scanjobs.messages import EXTRACT, READ, RENDER
from scanjobs.plan import StepKey, is_partial
from scanjobs.tables import ArtifactRef, Step, StepDependency, table_of
from scanjobs.transitions import StepRow

NEVER_GIVEN: Final = ("truth", "depth")
"""Roles that no step is given: the truth of a simulation and its depth maps."""


@dataclass(frozen=True, slots=True, kw_only=True)
class InputFile:
    """An artifact that a parent made."""

    kind: str
    frame: int
    role: str
    name: str
    digest: str


def inputs_of(session: Session, step: Step | StepRow) -> tuple[InputFile, ...]:
    """What the parents of a step have made; never the truth of a simulation, nor its depth maps.

    Who tells the modes so far is given the clouds of all frames before it, not only of those that it waited for.
    """
    if is_partial(StepKey(step.kind, step.frame)):
        whose = {"scan_id": step.scan_id, "generation": step.generation, "frame": step.frame}
        rows = session.execute(_OF_EARLIER, whose)
    else:
        rows = session.execute(_OF_PARENTS, {"child_id": step.id})
    return tuple(InputFile(**row._mapping) for row in rows)


def _make_queries() -> tuple[Select[Any], Select[Any]]:
    """Files of a step's parents, and of all frames before one; written once, since every step asks."""
    edge, step, ref = table_of(StepDependency), table_of(Step).c, table_of(ArtifactRef)
    files = (
        select(step.kind, step.frame, ref.c.role, ref.c.name, ref.c.digest)
        .join_from(table_of(Step), ref, ref.c.step_id == step.id)
        .where(ref.c.role.not_in(NEVER_GIVEN))
        .order_by(step.depth, step.frame, ref.c.role)
    )
    parents = files.join(edge, edge.c.parent_id == step.id).where(edge.c.child_id == bindparam("child_id"))
    clouds = and_(step.kind == EXTRACT, step.frame < bindparam("frame", type_=Integer))
    first = and_(step.kind.in_((RENDER, READ)), step.frame == 0)
    same = step.scan_id == bindparam("scan_id"), step.generation == bindparam("generation")
    return parents, files.where(*same, or_(clouds, first))


_OF_PARENTS, _OF_EARLIER = _make_queries()
