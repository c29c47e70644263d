"""What the end of one step means for the others: children woken, the plan expanded, a frame lost."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from nerfmodal.spec import CloudsSource, ScanSpec
from sqlalchemy import func, insert, select, update
from sqlalchemy.dialects import postgresql, sqlite
from sqlalchemy.orm import Session

from scanjobs.clock import now_s
from scanjobs.given import InputFile, inputs_of
from scanjobs.inputs import input_digest
from scanjobs.messages import IDENTIFY, INSPECT
from scanjobs.plan import CHUNK, WHOLE_SCAN, StepKey, chunk_of_frames, is_essential, is_partial, later_steps
from scanjobs.planting import plant
from scanjobs.settling import fail_scan, hold_scan, live_steps
from scanjobs.states import OPEN_SCAN_STATES, ScanState, StepState
from scanjobs.tables import Artifact, ArtifactRef, Scan, Step, table_of
from scanjobs.transitions import UNSYNCHRONISED, EventRow, StepRow, count_down, move_step, record

STORED: Final = "stored"
DAMAGED: Final = "damaged"
DROPPED: Final = "dropped"
"""Its bytes may be gone, by retention; its digest is still known."""
FORGOTTEN: Final = (ScanState.DELETING.value, ScanState.DELETED.value)


@dataclass(frozen=True, slots=True, kw_only=True)
class Output:
    """A stored file that a step made."""

    role: str
    name: str
    digest: str
    size: int
    media_type: str


def attach_outputs(session: Session, step: StepRow, outputs: Sequence[Output]) -> None:
    """Refer to the files that the step made; the bytes are in the store already."""
    know_artifacts(session, outputs)
    rows = [{"step_id": step.id, "role": out.role, "name": out.name, "digest": out.digest} for out in outputs]
    if rows:
        session.execute(_REFER, rows)


_REFER: Final = insert(table_of(ArtifactRef))


def damn(session: Session, digest: str) -> None:
    """The stored bytes of a digest are no longer its own: no retry and no fork relies on them."""
    statement = update(Artifact).where(Artifact.digest == digest).values(state=DAMAGED)
    session.execute(statement, execution_options=UNSYNCHRONISED)


def made_damaged(session: Session, scan: Scan) -> frozenset[str]:
    """Steps of the scan's root, one of whose files is damaged."""
    return _makers_of(session, scan, DAMAGED)


def made_dropped(session: Session, scan: Scan) -> frozenset[str]:
    """Steps of the scan's root, one of whose files retention has dropped."""
    return _makers_of(session, scan, DROPPED)


def _makers_of(session: Session, scan: Scan, state: str) -> frozenset[str]:
    query = (
        select(ArtifactRef.step_id)
        .join(Artifact, Artifact.digest == ArtifactRef.digest)
        .join(Step, Step.id == ArtifactRef.step_id)
        .join(Scan, Scan.id == Step.scan_id)
        .where(Artifact.state == state, Scan.root_id == scan.root_id)
    )
    return frozenset(session.scalars(query))


def expand_plan(session: Session, scan: Scan, step: StepRow) -> None:
    """Plan the rest of a scan whose source has been inspected."""
    if step.kind != INSPECT:
        return
    frames = int((step.facts or {})["frames"])
    session.execute(update(Scan).where(Scan.id == scan.id).values(frames=frames), execution_options=UNSYNCHRONISED)
    plant_rest(session, scan, frames)


def plant_rest(session: Session, scan: Scan, frames: int) -> None:
    """Plant a held scan whose number of frames is known: the first chunk now, the others by whoever ticks next."""
    spec = ScanSpec.model_validate(scan.spec)
    if isinstance(spec.source, CloudsSource):
        plant(session, scan, later_steps(spec, frames))
        take_over_ready(session, scan)
    else:
        _plant_chunk(session, scan, spec, frames, 0)


def plant_next_chunk(session: Session, scan_id: str) -> bool:
    """Plant the next chunk of a scan; False when its plan is whole, or it has ended."""
    scan = hold_scan(session, scan_id)
    if scan.unplanted_from is None or scan.frames is None or scan.state not in OPEN_SCAN_STATES:
        return False
    _plant_chunk(session, scan, ScanSpec.model_validate(scan.spec), scan.frames, scan.unplanted_from)
    return True


def unplanted_scans(session: Session, most: int = 100) -> tuple[str, ...]:
    """Scans whose plan is not whole yet: those without any step first, the small before the large."""
    states = [state.value for state in OPEN_SCAN_STATES]
    query = select(Scan.id).where(Scan.unplanted_from.is_not(None), Scan.state.in_(states))
    turn = (Scan.priority.desc(), Scan.unplanted_from, Scan.frames, Scan.id)
    return tuple(session.scalars(query.order_by(*turn).limit(most)))


def _plant_chunk(session: Session, scan: Scan, spec: ScanSpec, frames: int, start: int) -> None:
    plant(session, scan, chunk_of_frames(spec, frames, start))
    rest = start + CHUNK if start + CHUNK < frames else None
    session.execute(
        update(Scan).where(Scan.id == scan.id).values(unplanted_from=rest), execution_options=UNSYNCHRONISED
    )
    session.refresh(scan)
    take_over_ready(session, scan, start)


def release_children(session: Session, scan: Scan, step: Step | StepRow) -> None:
    """Count one parent less for every child, and wake those that wait for nothing more."""
    record(session, wake_children(session, scan, step))


def wake_children(session: Session, scan: Scan, step: Step | StepRow) -> list[EventRow]:
    """`release_children` without its events, which the caller records in the same transaction."""
    events = count_down(session, step.id)
    if not has_relatives(scan):
        return events
    record(session, events)
    for event in events:  # each may end at once, and wake others
        take_over(session, scan, session.get_one(Step, event["step_id"], populate_existing=True))
    return []


def take_over_ready(session: Session, scan: Scan, start: int = WHOLE_SCAN) -> None:
    """Give the ready steps of a new plan, from frame `start` on, the results that a relative of the scan has."""
    if has_relatives(scan):
        for step in live_steps(session, scan, StepState.READY):
            if step.frame >= start:
                take_over(session, scan, step)


def take_over(session: Session, scan: Scan, step: Step) -> None:
    """Note what a ready step's result depends on, and end it at once if the same has been computed before.

    Only scans of one root are relatives: a new submission of an old specification is computed.
    """
    digest = digest_of(scan.spec, StepKey(step.kind, step.frame), inputs_of(session, step))
    session.execute(
        update(Step).where(Step.id == step.id).values(input_digest=digest), execution_options=UNSYNCHRONISED
    )
    known = _same_step(session, scan, digest) if digest and has_relatives(scan) and not step.fresh else None
    if known is None:
        return
    refs = session.scalars(select(ArtifactRef).where(ArtifactRef.step_id == known.id))
    rows = [{"step_id": step.id, "role": ref.role, "name": ref.name, "digest": ref.digest} for ref in refs]
    if rows:
        session.execute(_REFER, rows)
    values = {"reused_from": known.id, "facts": known.facts, "finished_at": now_s()}
    move_step(session, step, StepState.SUCCEEDED, reason="same inputs", values=values)
    release_children(session, scan, step)


def digest_of(spec: Mapping[str, Any], key: StepKey, files: Sequence[InputFile]) -> str | None:
    """`inputs.input_digest` of a step that is given these files."""
    return input_digest(spec, key, [(one.kind, one.frame, one.role, one.digest) for one in files])


def has_relatives(scan: Scan) -> bool:
    """Whether a step of the scan may take over a result that was computed before."""
    return scan.generation > 0 or scan.root_id != scan.id


def _same_step(session: Session, scan: Scan, digest: str) -> Step | None:
    query = (
        select(Step)
        .join(Scan, Scan.id == Step.scan_id)
        .where(Step.input_digest == digest, Step.state == StepState.SUCCEEDED)
        .where(Scan.root_id == scan.root_id, Scan.owner == scan.owner, Scan.state.not_in(FORGOTTEN))
        .order_by(Step.id)
    )
    damaged = made_damaged(session, scan)
    return next((step for step in session.scalars(query) if step.id not in damaged), None)


def lose_frame(session: Session, scan: Scan, step: Step, error: dict[str, Any]) -> None:
    """A step has failed for good: the scan goes on without its frame, or ends; modes so far nobody waits for."""
    if is_partial(StepKey(step.kind, step.frame)):
        release_children(session, scan, step)
        return
    if is_essential(StepKey(step.kind, step.frame)) or _lost_frames(session, scan) > scan.max_failed_frames:
        fail_scan(session, scan, error)
        return
    for descendant in _waiting_steps_of_frame(session, step):
        values = {"error": error, "finished_at": now_s()}
        move_step(session, descendant, StepState.FAILED, reason="frame lost", values=values)
        release_children(session, scan, descendant)
    release_children(session, scan, step)


def _lost_frames(session: Session, scan: Scan) -> int:
    query = select(func.count(Step.frame.distinct())).where(
        Step.scan_id == scan.id,
        Step.generation == scan.generation,
        Step.state == StepState.FAILED,
        Step.kind != IDENTIFY,
    )
    return session.scalars(query).one()


def _waiting_steps_of_frame(session: Session, step: Step) -> tuple[Step, ...]:
    query = select(Step).where(
        Step.scan_id == step.scan_id,
        Step.generation == step.generation,
        Step.frame == step.frame,
        Step.kind != IDENTIFY,
        Step.depth > step.depth,
        Step.state == StepState.PENDING,
    )
    return tuple(session.scalars(query.order_by(Step.depth)))


def know_artifacts(session: Session, outputs: Sequence[Output]) -> None:
    """Note stored files, always in one order; bytes that were damaged or dropped before are whole again."""
    rows = [
        {"digest": one.digest, "size": one.size, "media_type": one.media_type, "state": STORED}
        for one in sorted(outputs, key=lambda output: output.digest)
    ]
    if rows:
        session.execute(_KNOW[session.get_bind().dialect.name], rows)


def _make_know(dialect: Any) -> Any:
    statement = dialect.insert(table_of(Artifact)).values(created_at=now_s())
    return statement.on_conflict_do_update(index_elements=["digest"], set_={"state": STORED})


_KNOW: Final = {"postgresql": _make_know(postgresql), "sqlite": _make_know(sqlite)}
