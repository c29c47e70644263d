"""Collecting what nothing refers to: files of results that were never accepted, and of deleted scans.

The database decides; one without a single scan in it is taken for the wrong database, and nothing is removed.
"""

from functools import partial

from sqlalchemy import delete, func, select
from sqlalchemy.orm import Session

from scanjobs.artifacts import ArtifactStore
from scanjobs.store import Store
from scanjobs.tables import Artifact, ArtifactRef, Scan

DAY_S = 24 * 3600.0


def collect_garbage(store: Store, artifacts: ArtifactStore, older_than_s: float = DAY_S) -> tuple[str, ...]:
    """Remove the unreferenced files that are older than a day; a younger one may belong to a step that is ending.

    Returns the digests removed.
    """
    with store.read() as session:
        if not session.scalars(select(func.count()).select_from(Scan)).one():
            return ()
        referenced = frozenset(session.scalars(select(ArtifactRef.digest).distinct()))
    garbage = [digest for digest in artifacts.digests() if digest not in referenced]
    removed = tuple(digest for digest in garbage if artifacts.remove_older(digest, older_than_s))
    for digest in removed:
        store.write(partial(_forget, digest=digest))
    return removed


def _forget(session: Session, digest: str) -> None:
    referenced = select(ArtifactRef.digest).where(ArtifactRef.digest == digest).exists()
    session.execute(delete(Artifact).where(Artifact.digest == digest, ~referenced))
