"""Retention and garbage: old checkpoints are dropped, and files that nothing refers to are removed.

The database decides; one without a single scan in it is taken for the wrong database, and nothing is removed. A file
younger than a day is left alone: it may belong to a step that is ending.

A dropped file keeps its row and its references, so that a fork still finds its step by the digest of its inputs; only
the bytes go. A checkpoint is dropped when all that was computed from it has succeeded, in every scan that refers to it.
"""

import shutil
import time
from contextlib import suppress
from functools import partial
from typing import Final

from sqlalchemy import ColumnElement, and_, delete, func, or_, select, update
from sqlalchemy.orm import Session, aliased

from scanjobs.artifacts import STAGING, ArtifactStore
from scanjobs.clock import now_s
from scanjobs.fanin import DROPPED, FORGOTTEN, STORED
from scanjobs.settings import Settings
from scanjobs.states import LIVE_STEP_STATES, ScanState, StepState
from scanjobs.store import Store
from scanjobs.tables import Artifact, ArtifactRef, Scan, Step, StepDependency
from scanjobs.transitions import UNSYNCHRONISED

DAY_S = 24 * 3600.0
CHECKPOINT: Final = "checkpoint"


def collect_garbage(store: Store, artifacts: ArtifactStore, older_than_s: float = DAY_S) -> tuple[str, ...]:
    """Remove the dropped and the unreferenced files that are older than a day.

    Returns the digests removed.
    """
    with store.read() as session:
        if not session.scalars(select(func.count()).select_from(Scan)).one():
            return ()
        needed = _needed(session)
    garbage = [digest for digest in artifacts.digests() if digest not in needed]
    removed = tuple(digest for digest in garbage if artifacts.remove_older(digest, older_than_s))
    for digest in removed:
        store.write(partial(_forget, digest=digest))
    return removed


def sweep_staging(settings: Settings, older_than_s: float = DAY_S) -> int:
    """Remove what processes that died have left half put together; how many there were."""
    swept = 0
    for folder in (settings.captures, settings.artifacts):
        for path in (folder / STAGING).glob("*"):
            with suppress(FileNotFoundError):  # it was finished, or another worker sweeps too
                if time.time() - path.stat().st_mtime > older_than_s:
                    shutil.rmtree(path) if path.is_dir() else path.unlink()
                    swept += 1
    return swept


def drop_checkpoints(store: Store, age_s: float) -> int:
    """Drop the checkpoints of scans that succeeded longer ago than `age_s`; how many there were."""
    return store.write(lambda session: _drop(session, age_s))


def _needed(session: Session) -> frozenset[str]:
    """Digests that a step refers to or would go on from, unless they were dropped."""
    referenced = select(ArtifactRef.digest).join(Artifact, Artifact.digest == ArtifactRef.digest)
    live = [state.value for state in LIVE_STEP_STATES]
    saved = select(Step.resume_digest).where(Step.resume_digest.is_not(None), Step.state.in_(live))
    needed = referenced.where(Artifact.state != DROPPED).union(saved)
    return frozenset(digest for digest in session.scalars(needed) if digest is not None)


def _drop(session: Session, age_s: float) -> int:
    refers = ArtifactRef.digest == Artifact.digest
    ours = select(ArtifactRef.step_id).join(Step, Step.id == ArtifactRef.step_id).join(Scan, Scan.id == Step.scan_id)
    checkpoint = ours.where(refers, ArtifactRef.role == CHECKPOINT).exists()
    still_of_use = ours.where(refers, _is_of_use(age_s)).exists()
    statement = update(Artifact).where(Artifact.state == STORED, checkpoint, ~still_of_use)
    dropped = session.execute(
        statement.values(state=DROPPED).returning(Artifact.digest), execution_options=UNSYNCHRONISED
    )
    return len(dropped.all())


def _is_of_use(age_s: float) -> ColumnElement[bool]:
    """Whether a reference may still be read: its scan is not over, or something was not computed from it."""
    child = aliased(Step)
    unfinished = (
        select(StepDependency.child_id)
        .join(child, child.id == StepDependency.child_id)
        .where(StepDependency.parent_id == Step.id, child.state != StepState.SUCCEEDED)
        .exists()
    )
    over = and_(Scan.state == ScanState.SUCCEEDED, Scan.finished_at < now_s() - age_s)
    return and_(
        Scan.state.not_in(FORGOTTEN),
        or_(~over, ArtifactRef.role != CHECKPOINT, and_(Step.generation == Scan.generation, unfinished)),
    )


def _forget(session: Session, digest: str) -> None:
    referenced = select(ArtifactRef.digest).where(ArtifactRef.digest == digest).exists()
    session.execute(delete(Artifact).where(Artifact.digest == digest, ~referenced))
