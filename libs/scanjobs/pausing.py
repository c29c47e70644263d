"""Pausing: a paused scan begins no step; what computes goes on and its result counts.

A scan is paused because somebody asked, because the disk of the artifacts is low, or because its owner's files have
used up the quota. What was paused for one reason is not resumed for another.
"""

from enum import StrEnum

from sqlalchemy import func, select
from sqlalchemy.orm import Session

from scanjobs.account_tables import Owner
from scanjobs.repository import LOCAL_OWNER, get_scan
from scanjobs.settling import hold_scan
from scanjobs.states import WORKING_SCAN_STATES, ScanState, check_move
from scanjobs.tables import Artifact, ArtifactRef, Scan, Step
from scanjobs.transitions import move_scan

WORKING = [state.value for state in WORKING_SCAN_STATES]


class Cause(StrEnum):
    """Why a scan is paused."""

    ASKED = "asked"
    DISK_LOW = "disk_low"
    QUOTA = "quota"


def pause_scan(session: Session, scan_id: str, *, owner: str = LOCAL_OWNER) -> Scan:
    """Begin no more steps of a scan until it is resumed; pausing twice is the same as once.

    Raises `NotFound`, or `IllegalTransition` when it has ended or is being cancelled.
    """
    scan = hold_scan(session, scan_id, owner=owner)
    if scan.state == ScanState.PAUSED:
        scan.paused_for = Cause.ASKED.value  # nothing but a request resumes it now
    else:
        _pause(session, scan, Cause.ASKED)
    session.flush()
    return get_scan(session, scan_id, owner=owner)


def resume_scan(session: Session, scan_id: str, *, owner: str = LOCAL_OWNER) -> Scan:
    """Go on with a paused scan, whatever it was paused for; if that still holds it is paused again.

    Resuming a scan that is not paused changes nothing. Raises `NotFound`, or `IllegalTransition` when it has ended.
    """
    scan = hold_scan(session, scan_id, owner=owner)
    if scan.state == ScanState.PAUSED:
        _resume(session, scan)
    elif scan.state not in WORKING_SCAN_STATES:
        check_move(ScanState(scan.state), ScanState.PAUSED)  # says why not
    return get_scan(session, scan_id, owner=owner)


def pause_all(session: Session, cause: Cause) -> int:
    """Pause every scan that works; how many there were."""
    ids = tuple(session.scalars(select(Scan.id).where(Scan.state.in_(WORKING)).order_by(Scan.id)))
    return sum(_pause_if_working(session, scan_id, cause) for scan_id in ids)


def resume_all(session: Session, cause: Cause) -> int:
    """Resume every scan that was paused for this cause; how many there were."""
    ids = tuple(session.scalars(select(Scan.id).where(Scan.paused_for == cause.value).order_by(Scan.id)))
    return sum(_resume_if_paused(session, scan_id, cause) for scan_id in ids)


def hold_to_quota(session: Session, default_bytes: int) -> None:
    """Pause the scans of owners whose files are more than they may be, and resume them when they are fewer."""
    for owner, paused_for in _owners_at_work(session):
        over = bytes_of(session, owner) > _quota_of(session, owner, default_bytes)
        mine = select(Scan.id).where(Scan.owner == owner).order_by(Scan.id)
        if over and paused_for is None:
            for scan_id in session.scalars(mine.where(Scan.state.in_(WORKING))).all():
                _pause_if_working(session, scan_id, Cause.QUOTA)
        elif not over and paused_for == Cause.QUOTA:
            for scan_id in session.scalars(mine.where(Scan.paused_for == Cause.QUOTA.value)).all():
                _resume_if_paused(session, scan_id, Cause.QUOTA)


def bytes_of(session: Session, owner: str) -> int:
    """Bytes of the files that an owner's scans refer to, each file counted once."""
    mine = (
        select(ArtifactRef.digest)
        .join(Step, Step.id == ArtifactRef.step_id)
        .join(Scan, Scan.id == Step.scan_id)
        .where(Scan.owner == owner)
    )
    total = select(func.coalesce(func.sum(Artifact.size), 0)).where(Artifact.digest.in_(mine))
    return int(session.scalars(total).one())


def _owners_at_work(session: Session) -> tuple[tuple[str, str | None], ...]:
    working = select(Scan.owner, Scan.paused_for).where(Scan.state.in_(WORKING))
    paused = select(Scan.owner, Scan.paused_for).where(Scan.paused_for == Cause.QUOTA.value)
    return tuple((owner, cause) for owner, cause in session.execute(working.union(paused)))


def _quota_of(session: Session, owner: str, default_bytes: int) -> int:
    own = session.scalars(select(Owner.quota_bytes).where(Owner.id == owner)).one_or_none()
    return default_bytes if own is None else own


def _pause_if_working(session: Session, scan_id: str, cause: Cause) -> bool:
    scan = hold_scan(session, scan_id)
    if scan.state not in WORKING_SCAN_STATES:
        return False
    _pause(session, scan, cause)
    return True


def _resume_if_paused(session: Session, scan_id: str, cause: Cause) -> bool:
    scan = hold_scan(session, scan_id)
    if scan.state != ScanState.PAUSED or scan.paused_for != cause:
        return False
    _resume(session, scan)
    return True


def _pause(session: Session, scan: Scan, cause: Cause) -> None:
    move_scan(session, scan, ScanState.PAUSED, reason=cause.value, values={"paused_for": cause.value})


def _resume(session: Session, scan: Scan) -> None:
    target = ScanState.RUNNING if scan.started_at else ScanState.QUEUED
    move_scan(session, scan, target, reason="resumed", values={"paused_for": None})
