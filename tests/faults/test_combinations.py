"""Combinations that no list had: between two systems that each commit, a zombie across a retry, rot under many."""

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from scanjobs import control
from scanjobs.artifacts import ArtifactStore
from scanjobs.garbage import collect_garbage
from scanjobs.messages import TRAIN
from scanjobs.migrate import downgrade, upgrade
from scanjobs.plan import WHOLE_SCAN
from scanjobs.settings import Settings
from scanjobs.tables import Attempt, Step
from sqlalchemy import select

from tests.faults.steps import assert_whole, freeze, wait_for, workers
from tests.integration.toy_service import looking_at, serving, toy_spec, worker_process

DYING = "tests.faults.dying_worker"


@pytest.mark.parametrize("where", ["stored", "sent", "finished"])
def test_worker_that_dies_between_two_commits(
    settings: Settings, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, where: str
) -> None:
    """Files without rows, rows without messages, rows without anybody who was told.

    Guards: references are made in the finish transaction and files without any are garbage; `ready` and `sent` rows
    are the outbox. Seen to fail: with `unclaimed_steps` returning nothing `sent` never ends; with `overdue_steps`
    returning nothing `stored` never does. `finished` needs no guard of its own: all of it was committed.
    """
    monkeypatch.setenv("DIE_AT", where)
    monkeypatch.setenv("DIE_MARK", str(tmp_path / "died"))
    with looking_at(settings) as service:
        scan_id = service.submit(toy_spec(frames=2))
        with worker_process(settings, DYING) as dying:
            assert dying.wait(30) == -signal.SIGKILL
        with worker_process(settings, DYING):
            assert_whole(service, scan_id)
        collect_garbage(service.store, ArtifactStore(settings.artifacts), older_than_s=-1.0)
        assert service.violations() == ()


def test_sleeper_of_an_earlier_generation_changes_nothing(embedded: Settings) -> None:
    """A worker sleeps through a cancel and a retry, and wakes up with a result of the generation before.

    Guard: a step belongs to one generation, and its claim to a token (`leases.standing`, `leases._owned`).
    Seen to fail: with both looking at neither token nor state, the old step is accepted after its cancel.
    """
    quick = embedded.model_copy(update={"lease_s": 1.5, "slots": 1})
    with looking_at(quick) as service, worker_process(quick) as sleeper:
        scan_id = service.submit(toy_spec(frames=1, trouble=f"{TRAIN}:-1:takes=3"))
        service.runner_of(scan_id, TRAIN, WHOLE_SCAN)
        old = service.step(scan_id, TRAIN, WHOLE_SCAN).id
        freeze(sleeper, service)
        service.store.write(lambda session: control.cancel_scan(session, scan_id))
        with workers(quick, 1):
            assert service.end_of(scan_id).state == "canceled"
            service.store.write(lambda session: control.retry_scan(session, scan_id))
            time.sleep(2.0)  # the sleeper's runner has ended, the new generation trains
            sleeper.signal(signal.SIGCONT)
            assert_whole(service, scan_id)
        with service.store.read() as session:
            assert session.get_one(Step, old).state == "canceled"
            outcomes = session.scalars(select(Attempt.outcome).where(Attempt.step_id == old)).all()
        assert "succeeded" not in outcomes


def test_rotten_checkpoint_under_89_children(embedded: Settings) -> None:
    """The one file that 89 trainings start from rots. None of them uses it; one retry makes it and them anew.

    Guard: every digest is verified on the way in (`ArtifactStore.path`), and a damaged file's step is not kept
    (`control._kept`). Seen to fail: with `_verify` doing nothing the children are computed from rotten bytes and the
    scan goes on; without `made_damaged` the retry fails again.
    """
    wide = embedded.model_copy(update={"slots": 4})
    frames = 89
    with serving(wide) as service:
        scan_id = service.submit(toy_spec(frames=frames, trouble=f"{TRAIN}:-1:takes=0.5"))
        service.wait(lambda: service.step(scan_id, TRAIN, WHOLE_SCAN).state == "succeeded")
        rot(wide, service.file(scan_id, TRAIN, WHOLE_SCAN, "checkpoint"))
        scan = service.end_of(scan_id)
        assert (scan.state, (scan.error or {})["code"]) == ("failed", "ARTIFACT_DAMAGED")
        done = {(step.kind, step.frame) for step in service.steps(scan_id) if step.state == "succeeded"}
        kept = done - {(TRAIN, WHOLE_SCAN)}
        assert sum(kind == TRAIN for kind, _ in kept) < wide.slots, "only what already ran may have read the file"
        service.store.write(lambda session: control.retry_scan(session, scan_id))
        assert_whole(service, scan_id, 120)
        computed = {(step.kind, step.frame) for step in service.steps(scan_id) if step.token}
        assert {(TRAIN, k) for k in range(-1, frames)} - kept <= computed
        assert not computed & kept


def test_upgrade_under_load(settings: Settings) -> None:
    """A worker is killed in mid-scan, the database goes through the newest revisions, four upgrades start at once
    while the next worker computes; the scan ends as if nothing had been.

    Guard: revisions move rows in every state (`0004` renames the queue of waiting trainings).
    Seen to fail: without its UPDATE the trainings wait in a queue that nobody serves.
    """
    with looking_at(settings) as service:
        scan_id = service.submit(toy_spec(frames=4))
        with worker_process(settings) as worker:
            wait_for(service, scan_id, 3)
            worker.close()
        downgrade(settings.database, "0003")
        upgrade(settings.database)
        with worker_process(settings):
            assert upgrade_together(settings) == [0, 0, 0, 0]
            assert_whole(service, scan_id)


def rot(settings: Settings, digest: str) -> None:
    """Change the bytes of a stored file."""
    place = ArtifactStore(settings.artifacts).place(digest)
    place.chmod(0o644)
    place.write_text("rot")


def upgrade_together(settings: Settings) -> list[int]:
    """The exit codes of four processes that migrate at once."""
    program = f"from scanjobs.migrate import upgrade; upgrade({settings.database!r})"
    processes = [subprocess.Popen([sys.executable, "-c", program]) for _ in range(4)]
    return [process.wait(60) for process in processes]
