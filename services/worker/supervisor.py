"""One step from its doorbell to its end: claim it, let a runner compute it, watch both, write down what came of it.

Whoever writes down a good end claims the next step for the same slot with it (`scanjobs.handover`), so a slot that has
work goes from step to step without a message.
The supervisor imports nothing heavy. While a runner computes it renews the lease, relays progress and looks for a
cancel. When it cannot renew for a whole lease it kills its own runner: somebody else may have the step by then.
"""

import logging
import queue
import shutil
import threading
import time
from collections.abc import Callable, Collection, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple, TypeVar

from scanjobs import dispatch, handover, leases
from scanjobs.artifacts import ArtifactStore, Stored, place_input, stored_as
from scanjobs.claims import Claim, Failure, RunnerNote, Standing
from scanjobs.disk import is_low
from scanjobs.errors import ArtifactDamaged
from scanjobs.fanin import Output
from scanjobs.handover import Handover, Slot
from scanjobs.logs import about
from scanjobs.media import media_type_of
from scanjobs.messages import TRAIN_GPU
from scanjobs.settings import Settings
from scanjobs.slots import Devices
from scanjobs.store import Store
from scanjobs.tracing import NO_TRACING, Tracing
from sqlalchemy.exc import SQLAlchemyError
from sqlalchemy.orm import Session

from services.worker.child import Child, Children
from services.worker.failures import TOO_LONG, death_of, of_runner, of_system
from services.worker.protocol import Line, Made, Order, failed_line, read_failed, read_produced
from services.worker.step_log import StepLog

log = logging.getLogger(__name__)

T = TypeVar("T")
RESUME: Final = "resume"
Outcome = Failure | Handover | None
"""How an attempt ended; None when the step was taken from it, which is written down already."""
MOST_FILES: Final = 64
"""Threads that move files, at most; they come as they are needed."""
SMALL: Final = 1 << 20
"""Files of so many bytes together reach the disk while their rows are written, which then wait for them."""
PROGRESS_S: Final = 1.0
"""Progress is written at most this often."""


@dataclass(slots=True)
class Watch:
    """What is known of a running step; `renewed_at` is the monotonic time at which the last good renewal began."""

    began: float
    renewed_at: float
    done: int = 0
    total: int = 0
    message: str = ""
    told: bool = True
    is_noted: bool = False
    """Whether the database knows which process computes the step."""

    def note(self, line: Line) -> None:
        """Take over a progress line."""
        progress = line["progress"]
        self.done, self.total, self.message = progress["done"], progress["total"], progress["message"]
        self.told = False

    def is_due(self, lease_s: float) -> bool:
        """Whether the lease or the progress must be written now."""
        age = time.monotonic() - self.renewed_at
        return age >= lease_s / 3 or (not self.told and age >= PROGRESS_S)


class Turn(NamedTuple):
    """A claim, and the monotonic time at which its lease began at the latest."""

    claim: Claim
    began: float


class Supervisor:
    """Runs steps for one worker; `supervise` is called by as many threads as the worker has slots."""

    def __init__(
        self,
        *,
        store: Store,
        artifacts: ArtifactStore,
        settings: Settings,
        worker_id: str,
        queues: Collection[str],
        on_change: Callable[[], None],
        devices: Devices | None = None,
        tracing: Tracing = NO_TRACING,
    ) -> None:
        self._store = store
        self._artifacts = artifacts
        self._settings = settings
        self._worker_id = worker_id
        self._on_change = on_change
        self._work = settings.data_folder.resolve() / "work" / worker_id
        self._devices = devices
        own_message = {TRAIN_GPU} if devices is not None and devices.gpus else set()  # a GPU is waited for
        self._slot = Slot(worker_id=worker_id, queues=set(queues) - own_message, lease_s=settings.lease_s)
        self._files = ThreadPoolExecutor(MOST_FILES, "files")
        self._tracing = tracing
        self._draining = threading.Event()
        self._paused = threading.Event()
        self.children = Children(settings, settings.data_folder.resolve() / "logs" / worker_id)

    def drain(self) -> None:
        """Take no more steps, and give back those under way."""
        self._draining.set()

    def pause(self, is_paused: bool) -> None:
        """Take no more steps while this holds, and finish those under way."""
        if is_paused:
            self._paused.set()
        else:
            self._paused.clear()

    def close(self) -> None:
        """End the idle runners and remove the working folder."""
        self.children.end_idle(0.0)
        self._files.shutdown(wait=False)
        shutil.rmtree(self._work, ignore_errors=True)

    def sweep(self, worker_ids: Sequence[str]) -> None:
        """Remove what dead workers left in the working folder, which nobody will come back to."""
        for worker_id in worker_ids:
            shutil.rmtree(self._work.parent / worker_id, ignore_errors=True)

    def supervise(self, step_id: str) -> None:
        """Compute a step if it is still to be had, and go on with others while there are any."""
        if not self._takes_steps():
            self._store.write(lambda session: dispatch.take_back(session, step_id))
            return
        if not self._is_wanted(step_id):
            return
        began = time.monotonic()
        claim = self._store.write(
            lambda session: leases.claim(session, step_id, self._worker_id, self._settings.lease_s, self._devices)
        )
        turn = None if claim is None else Turn(claim, began)
        while turn is not None:
            turn = self._attend(turn.claim, Watch(turn.began, turn.began))

    def _takes_steps(self) -> bool:
        return not self._draining.is_set() and not self._paused.is_set()

    def _attend(self, claim: Claim, watch: Watch) -> Turn | None:
        """Compute a claimed step; the slot's next one."""
        folder = self._work / f"{claim.step_id}-{claim.token}"
        ended: Outcome = None
        try:
            ids: dict[str, str | int] = {"scan_id": claim.scan_id, "step_id": claim.step_id, "frame": claim.frame}
            with about(kind=claim.kind, **ids), self._tracing.span(claim.kind, claim.traceparent, ids):
                ended = self._compute(claim, folder, watch)
                if isinstance(ended, Failure):
                    self._fail(claim, ended, watch)
        finally:
            self._files.submit(shutil.rmtree, folder, ignore_errors=True)  # the next step does not wait for it
            if not isinstance(ended, Handover) or ended.is_more:
                self._on_change()
        if isinstance(ended, Handover) and ended.claim is not None:
            return Turn(ended.claim, watch.renewed_at)
        return None

    def _is_wanted(self, step_id: str) -> bool:
        """A look before the transaction: repeated and late messages cost one read."""
        with self._store.read() as session:
            return dispatch.is_sent(session, step_id)

    def _compute(self, claim: Claim, folder: Path, watch: Watch) -> Outcome:
        """Everything from the input files to the accepted result; what went wrong, if the claim is still ours."""
        try:
            order = self._meanwhile(claim, watch, lambda: self._order(claim, folder))
            child = self.children.take(claim.kind, claim.device)
        except ArtifactDamaged as error:
            return Failure(
                code=error.code, message=error.message, hint=error.hint, retryable=False, damaged=error.digest
            )
        except OSError as error:
            return of_system(error)
        try:
            return self._with(child, claim, order, watch)
        except OSError as error:
            return of_system(error)
        finally:
            self.children.give_back(child)

    def _with(self, child: Child, claim: Claim, order: Order, watch: Watch) -> Outcome:
        log_of_step = StepLog(self._store, claim, child.log_path)
        child.order(order)
        try:
            line = self._watch(claim, child, watch, log_of_step)
        finally:
            log_of_step.relay(is_over=True)
        if line is None:
            return None
        if "failed" in line:
            self._note(claim, child, watch)
            log_of_step.say(line["failed"]["message"], "error")
            exit_code = child.exit_code
            child.kill()  # what failed in it may have left it in any state
            return of_runner(read_failed(line), exit_code)
        return self._accept(claim, child, line, watch)

    def _note(self, claim: Claim, child: Child, watch: Watch) -> None:
        """Write down which process computes; of a short step the ending says it."""
        if not watch.is_noted:
            note = RunnerNote(child.pid, child.log_path.name)
            watch.is_noted = bool(self._write(watch, lambda session: leases.note_runner(session, claim, note)))

    def _order(self, claim: Claim, folder: Path) -> Order:
        (folder / "out").mkdir(parents=True)
        inputs = []
        for one in claim.inputs:
            path = folder / f"{one.kind}-{one.frame}-{one.name}"
            place_input(self._artifacts.path(one.digest), path)
            inputs.append({"kind": one.kind, "frame": one.frame, "role": one.role, "path": str(path)})
        return Order(
            kind=claim.kind,
            frame=claim.frame,
            spec=claim.spec,
            inputs=tuple(inputs),
            out=str(folder / "out"),
            save_every_s=self._settings.save_every_s,
            resume=self._resume(claim, folder),
        )

    def _resume(self, claim: Claim, folder: Path) -> str | None:
        """What an earlier attempt has saved; the last attempt begins anew, in case that is what it fails of."""
        if claim.resume is None or claim.attempt >= self._settings.max_attempts > 1:
            return None
        path = folder / "resume"
        try:
            place_input(self._artifacts.path(claim.resume), path)
        except ArtifactDamaged:
            log.warning("what step %s has saved is damaged; it begins anew", claim.step_id)
            return None
        return str(path)

    def _watch(self, claim: Claim, child: Child, watch: Watch, log_of_step: StepLog) -> Line | None:
        """The runner's last line, or None when the step was taken from it."""
        looked_at = time.monotonic()
        limit_s = claim.spec.get("step_limit_s") or self._settings.step_limit_s
        while True:
            try:
                line = child.receive(self._settings.watch_s)
            except queue.Empty:
                line = {}
            if line is None:
                return death_of(child)
            if "progress" in line:
                watch.note(line)
            elif "saved" in line:
                self._save(claim, Path(line["saved"]), watch)
            elif line:
                return line
            if time.monotonic() - looked_at >= self._settings.watch_s:
                looked_at = time.monotonic()
                log_of_step.relay()
                self._note(claim, child, watch)
                if not self._go_on(claim, child, watch):
                    return None
                if looked_at - watch.began >= limit_s:
                    child.stop(self._settings.stop_grace_s)
                    return failed_line(TOO_LONG)

    def _go_on(self, claim: Claim, child: Child, watch: Watch) -> bool:
        """Look at the claim; False after the runner has been stopped for a reason that is written down."""
        if self._draining.is_set():
            saved = child.stop(self._settings.drain_s / 2)
            if saved is not None:
                self._save(claim, saved, watch)
            self._write(watch, lambda session: leases.give_back(session, claim, "drain"))
            return False
        standing = self._standing(claim, watch)
        if standing is Standing.HELD:
            return True
        child.stop(self._settings.stop_grace_s if standing is Standing.CANCELED else 0.0)
        if standing is Standing.CANCELED:
            self._write(watch, lambda session: leases.stopped(session, claim))
        return False

    def _standing(self, claim: Claim, watch: Watch) -> Standing:
        asked_at = time.monotonic()
        try:
            if not watch.is_due(self._settings.lease_s):
                with self._store.read() as session:
                    return leases.standing(session, claim)
            standing = self._store.write(
                lambda session: leases.renew(
                    session, claim, self._settings.lease_s, watch.done, watch.total, watch.message
                )
            )
        except SQLAlchemyError:
            log.warning("the database does not answer; step %s goes on while its lease lasts", claim.step_id)
            return Standing.LOST if self._is_expired(watch) else Standing.HELD
        watch.renewed_at, watch.told = asked_at, True
        return standing

    def _is_expired(self, watch: Watch) -> bool:
        return time.monotonic() - watch.renewed_at >= self._settings.lease_s

    def _accept(self, claim: Claim, child: Child, line: Line, watch: Watch) -> Handover | None:
        made, facts = read_produced(line)
        outputs, kept = self._begin_to_keep(claim, watch, made)
        runner = RunnerNote(child.pid, child.log_path.name)
        slot = self._slot if self._takes_steps() and not is_low(self._settings) else None
        asked_at = time.monotonic()

        def end(session: Session) -> Handover:
            ended = handover.finish_and_claim(session, claim, outputs, facts, runner, slot)
            kept.result()  # the commit waits for the bytes
            return ended

        ended = self._write(watch, end)
        watch.renewed_at = asked_at
        if ended is not None and ended.is_accepted:
            log.info("step succeeded", extra={"duration_s": round(time.monotonic() - watch.began, 3)})
        else:
            log.warning("the result of step %s came too late and is dropped", claim.step_id)
        return ended

    def _begin_to_keep(
        self, claim: Claim, watch: Watch, made: Sequence[Made]
    ) -> tuple[tuple[Output, ...], Future[None]]:
        """What the files are, and their storing: under way where they are small and the store is near, else done."""
        is_quick = self._artifacts.is_near and sum(one.path.stat().st_size for one in made) <= SMALL
        outputs = _outputs(made) if is_quick else self._meanwhile(claim, watch, lambda: _outputs(made))
        kept = self._files.submit(self._keep, made, outputs)
        if not is_quick:
            self._meanwhile(claim, watch, kept.result)
        return outputs, kept

    def _save(self, claim: Claim, path: Path, watch: Watch) -> None:
        """Store what the next attempt would go on from; without it that one only has more to do."""
        try:
            (saved,), kept = self._begin_to_keep(claim, watch, [Made(RESUME, path)])
            kept.result()
            path.unlink(missing_ok=True)
            self._store.write(lambda session: leases.save(session, claim, saved))
        except (OSError, SQLAlchemyError) as error:
            log.warning("step %s cannot save its state: %s", claim.step_id, error)

    def _meanwhile(self, claim: Claim, watch: Watch, work: Callable[[], T]) -> T:
        """Do what may take long (files that travel, digests) while the lease is kept alive."""
        future = self._files.submit(work)
        while not wait((future,), timeout=self._settings.watch_s).done:
            self._standing(claim, watch)
        return future.result()

    def _keep(self, made: Sequence[Made], outputs: Sequence[Output]) -> None:
        for one, output in zip(made, outputs, strict=True):
            self._artifacts.take(one.path, Stored(output.digest, output.size))

    def _fail(self, claim: Claim, failure: Failure, watch: Watch) -> None:
        log.warning(
            "step %s (%s, frame %s): %s %s", claim.step_id, claim.kind, claim.frame, failure.code, failure.message
        )
        most = self._settings.max_attempts
        self._write(watch, lambda session: leases.fail(session, claim, failure, most))

    def _write(self, watch: Watch, work: Callable[[Session], T]) -> T | None:
        """Write something down, trying again while the database is away and the lease lasts; None when it is over."""
        while True:
            try:
                return self._store.write(work)
            except SQLAlchemyError:
                if self._is_expired(watch):
                    log.exception("the database was away for a whole lease; the result is dropped")
                    return None
                time.sleep(self._settings.watch_s)


def _outputs(made: Sequence[Made]) -> tuple[Output, ...]:
    stored = [stored_as(one.path) for one in made]
    return tuple(
        Output(
            role=one.role,
            name=one.path.name,
            digest=known.digest,
            size=known.size,
            media_type=media_type_of(one.path.name),
        )
        for one, known in zip(made, stored, strict=True)
    )
