"""A plan becomes rows: the steps of one generation, their dependencies and their first events.

A long plan is planted in chunks, each in a transaction of its own; a later chunk finds the parents it needs among the
rows, with what has become of them by then. What an earlier generation has finished is kept: its step is born
`succeeded`, with the same artifacts.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, NamedTuple

import uuid6
from sqlalchemy import insert, select
from sqlalchemy.orm import Session

from scanjobs.clock import now_s
from scanjobs.inputs import input_digest
from scanjobs.plan import PlannedStep, StepKey
from scanjobs.states import LIVE_STEP_STATES, StepState
from scanjobs.tables import ArtifactRef, Scan, Step, StepDependency, table_of
from scanjobs.transitions import BATCH, born_steps

Row = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Inheritance:
    """Steps of an earlier generation that are kept, and the keys that must be computed afresh."""

    kept: Mapping[StepKey, Step]
    afresh: frozenset[StepKey]


class Planted(NamedTuple):
    """A step that has a row already."""

    id: str
    state: str


NOTHING_INHERITED = Inheritance(MappingProxyType({}), frozenset())


def plant(
    session: Session, scan: Scan, steps: Sequence[PlannedStep], inherited: Inheritance = NOTHING_INHERITED
) -> None:
    """Insert the rows of a plan in the scan's present generation; steps without open parents are `ready`."""
    ids = {step.key: str(uuid6.uuid7()) for step in steps}
    planted = _planted_parents(session, scan, steps, ids)
    ended = inherited.kept.keys() | {key for key, row in planted.items() if row.state not in LIVE_STEP_STATES}
    rows = [_row(scan, step, ids[step.key], inherited, ended) for step in steps]
    of_key = ids | {key: row.id for key, row in planted.items()}
    edges = [{"parent_id": of_key[parent], "child_id": ids[step.key]} for step in steps for parent in step.parents]
    _insert(session, Step, rows, {"created_at": now_s(), "ready_at": now_s()})
    _insert(session, StepDependency, edges, {})
    _insert(session, ArtifactRef, _inherited_refs(session, ids, inherited), {})
    born_steps(session, rows)


def _planted_parents(
    session: Session, scan: Scan, steps: Sequence[PlannedStep], ids: Mapping[StepKey, str]
) -> dict[StepKey, Planted]:
    """The parents that an earlier chunk has planted."""
    wanted = {parent for step in steps for parent in step.parents if parent not in ids}
    if not wanted:
        return {}
    frames = [key.frame for key in wanted]
    query = select(Step.kind, Step.frame, Step.id, Step.state).where(
        Step.scan_id == scan.id,
        Step.generation == scan.generation,
        Step.kind.in_({key.kind for key in wanted}),
        Step.frame.between(min(frames), max(frames)),
    )
    rows = {StepKey(kind, frame): Planted(step_id, state) for kind, frame, step_id, state in session.execute(query)}
    return {key: rows[key] for key in wanted}


def _row(scan: Scan, step: PlannedStep, step_id: str, inherited: Inheritance, ended: Collection[StepKey]) -> Row:
    kept = inherited.kept.get(step.key)
    open_parents = sum(parent not in ended for parent in step.parents)
    state = StepState.SUCCEEDED if kept else StepState.PENDING if open_parents else StepState.READY
    return {
        "id": step_id,
        "scan_id": scan.id,
        "kind": step.key.kind,
        "frame": step.key.frame,
        "generation": scan.generation,
        "queue": step.queue,
        "depth": step.depth,
        "state": state.value,
        "deps_left": 0 if kept else open_parents,
        "fresh": step.key in inherited.afresh,
        "attempt": 0,
        "token": 0,
        "traceparent": scan.traceparent,
        "progress_done": kept.progress_done if kept else 0,
        "progress_total": kept.progress_total if kept else 0,
        "progress_message": kept.progress_message if kept else "",
        "input_digest": kept.input_digest if kept else _digest_of_root(scan, step),
        "reused_from": kept.id if kept else None,
        "facts": kept.facts if kept else None,
        "started_at": kept.started_at if kept else None,
        "finished_at": kept.finished_at if kept else None,
    }


def _digest_of_root(scan: Scan, step: PlannedStep) -> str | None:
    """A step without parents depends on the specification alone."""
    return None if step.parents else input_digest(scan.spec, step.key, ())


def _inherited_refs(session: Session, ids: Mapping[StepKey, str], inherited: Inheritance) -> list[Row]:
    heirs = {step.id: ids[key] for key, step in inherited.kept.items()}
    rows: list[Row] = []
    old_ids = list(heirs)
    for start in range(0, len(old_ids), BATCH):
        query = select(ArtifactRef).where(ArtifactRef.step_id.in_(old_ids[start : start + BATCH]))
        rows += [
            {"step_id": heirs[ref.step_id], "role": ref.role, "name": ref.name, "digest": ref.digest}
            for ref in session.scalars(query)
        ]
    return rows


def _insert(session: Session, entity: type[Any], rows: Sequence[Row], common: Row) -> None:
    for start in range(0, len(rows), BATCH):
        session.execute(insert(table_of(entity)).values(common), list(rows[start : start + BATCH]))
