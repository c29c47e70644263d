"""What a user may do to a scan that has been submitted: cancel it, or have it run again from some step on."""

from collections.abc import Collection, Mapping

from nerfmodal.spec import ScanSpec
from sqlalchemy import delete, select
from sqlalchemy.orm import Session

from scanjobs.clock import now_s
from scanjobs.errors import IllegalTransition
from scanjobs.fanin import made_damaged, made_dropped, take_over_ready
from scanjobs.messages import IDENTIFY, INSPECT, KINDS
from scanjobs.plan import WHOLE_SCAN, PlannedStep, StepKey, first_steps, is_at_or_after, is_partial, later_steps
from scanjobs.planting import Inheritance, plant
from scanjobs.repository import LOCAL_OWNER, get_scan, insert_scan
from scanjobs.settling import hold_scan, live_steps, settle
from scanjobs.states import ScanState, StepState
from scanjobs.tables import ArtifactRef, Scan, Step
from scanjobs.transitions import move_scan, move_steps


def cancel_scan(session: Session, scan_id: str, *, owner: str = LOCAL_OWNER) -> Scan:
    """Ask a scan to stop: what waits is cancelled now, what computes by its worker within seconds.

    Cancelling twice is the same as once. Raises `NotFound`, or `IllegalTransition` when it has ended.
    """
    scan = hold_scan(session, scan_id, owner=owner)
    if scan.state != ScanState.CANCELING:
        move_scan(session, scan, ScanState.CANCELING, reason="asked", values={"cancel_seq": scan.cancel_seq + 1})
        waiting = live_steps(session, scan, StepState.PENDING, StepState.READY, StepState.SENT)
        move_steps(session, waiting, StepState.CANCELED, reason="asked", values={"finished_at": now_s()})
        settle(session, scan)
    return get_scan(session, scan_id, owner=owner)


def retry_scan(
    session: Session,
    scan_id: str,
    *,
    owner: str = LOCAL_OWNER,
    from_kind: str | None = None,
    frames: Collection[int] | None = None,
) -> Scan:
    """Run an ended scan again as its next generation.

    Steps of `from_kind` and after it are computed afresh (of `frames` only, if given, and what depends on them);
    all others are kept if they had succeeded. Without `from_kind` only what had not succeeded is computed. A retry
    tells no modes so far: it has most clouds already.

    Raises
    ------
    NotFound
        No such scan.
    IllegalTransition
        It has not ended, or `from_kind` is no kind of step that it has.
    """
    scan = hold_scan(session, scan_id, owner=owner)
    plan = _without_partials(_whole_plan(scan, from_kind))
    _check_kind(plan, from_kind)
    afresh = frozenset(step.key for step in plan if _is_asked(step.key, from_kind, frames))
    kept = _kept(session, scan, plan, afresh)
    missing = _missing(plan, kept, made_dropped(session, scan))
    inherited = Inheritance({key: step for key, step in kept.items() if key not in missing}, afresh | missing)
    values = {
        "generation": scan.generation + 1,
        "error": None,
        "started_at": None,
        "finished_at": None,
        "deadline_at": None,
        "paused_for": None,
        "unplanted_from": None,
    }
    move_scan(session, scan, ScanState.QUEUED, reason="retry", values=values)
    plant(session, scan, plan, inherited)
    take_over_ready(session, scan)
    settle(session, scan)
    return get_scan(session, scan_id, owner=owner)


def fork_scan(session: Session, scan_id: str, spec: ScanSpec, *, owner: str = LOCAL_OWNER) -> Scan:
    """Submit a changed specification as a scan of its own that takes over the results that are still the same.

    Changing only `identification` renders and trains nothing again. Raises `NotFound`.
    """
    return insert_scan(session, spec, owner=owner, fork_of=get_scan(session, scan_id, owner=owner)).scan


def delete_scan(session: Session, scan_id: str, *, owner: str = LOCAL_OWNER) -> None:
    """Forget a scan that has ended: its row stays as a tombstone, its files are garbage unless a fork has them too.

    Raises `NotFound`, or `IllegalTransition` when it has not ended.
    """
    scan = hold_scan(session, scan_id, owner=owner)
    move_scan(session, scan, ScanState.DELETING, reason="asked")
    steps = select(Step.id).where(Step.scan_id == scan.id)
    session.execute(delete(ArtifactRef).where(ArtifactRef.step_id.in_(steps)))
    move_scan(session, scan, ScanState.DELETED)


def _whole_plan(scan: Scan, from_kind: str | None) -> tuple[PlannedStep, ...]:
    spec = ScanSpec.model_validate(scan.spec)
    known = first_steps(spec)
    if scan.frames is None or from_kind == INSPECT or scan.source_kind == "simulation":
        return known  # the rest is planned when the source has been inspected
    return known + later_steps(spec, scan.frames)


def _without_partials(plan: tuple[PlannedStep, ...]) -> tuple[PlannedStep, ...]:
    return tuple(step for step in plan if not is_partial(step.key))


def _check_kind(plan: tuple[PlannedStep, ...], from_kind: str | None) -> None:
    kinds = [kind for kind in KINDS if any(step.key.kind == kind for step in plan)]
    if from_kind is not None and from_kind not in kinds:
        raise IllegalTransition(
            f"the scan has no step {from_kind!r}.", where="from", hint=f"Retry from one of: {', '.join(kinds)}."
        )


def _is_asked(key: StepKey, from_kind: str | None, frames: Collection[int] | None) -> bool:
    if from_kind is None or not is_at_or_after(key.kind, from_kind):
        return False
    return frames is None or key.kind == IDENTIFY or (key.frame != WHOLE_SCAN and key.frame in frames)


def _kept(
    session: Session, scan: Scan, plan: tuple[PlannedStep, ...], afresh: frozenset[StepKey]
) -> dict[StepKey, Step]:
    query = select(Step).where(
        Step.scan_id == scan.id, Step.generation == scan.generation, Step.state == StepState.SUCCEEDED
    )
    damaged = made_damaged(session, scan)
    finished = {StepKey(step.kind, step.frame): step for step in session.scalars(query) if step.id not in damaged}
    kept: dict[StepKey, Step] = {}
    for step in plan:  # parents come before their children
        if step.key in finished and step.key not in afresh and all(parent in kept for parent in step.parents):
            kept[step.key] = finished[step.key]
    return kept


def _missing(
    plan: tuple[PlannedStep, ...], kept: Mapping[StepKey, Step], dropped: Collection[str]
) -> frozenset[StepKey]:
    """Kept steps whose files retention has dropped although a step that is computed needs them."""
    missing: set[StepKey] = set()
    for step in reversed(plan):  # children come before their parents
        if step.key not in kept or step.key in missing:
            missing |= {parent for parent in step.parents if parent in kept and kept[parent].id in dropped}
    return frozenset(missing)
