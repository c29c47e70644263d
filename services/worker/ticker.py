"""The heart of a worker: every tick it says that it lives, takes back what was lost, and sends what is ready.

Every worker process has one; they need no leader, because each move they make is guarded by the state it starts from.
"""

import logging
import socket
import threading
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Final

from celery import Celery
from kombu.exceptions import OperationalError as BrokerError
from scanjobs import dispatch, leases, meters, workers
from scanjobs.disk import is_low
from scanjobs.messages import Message
from scanjobs.queue import publish
from scanjobs.settings import Settings
from scanjobs.settling import miss_deadline, overdue_scans
from scanjobs.store import Store
from scanjobs.telemetry import Telemetry
from scanjobs.workers import WorkerIdentity

log = logging.getLogger(__name__)

QUIET_S: Final = 5.0
"""After a message that the broker did not take none is sent for so long: each try may cost as much, and the worker must
say in time that it lives."""
NAMESPACE: Final = Path("/proc/self/ns/pid")
COUNT_S: Final = 5.0
"""Between two looks for attempts that are not in the totals yet."""


def process_table() -> str:
    """This host and the process table that its process ids are from: two containers may share a name."""
    return f"{socket.gethostname()}/{NAMESPACE.stat().st_ino if NAMESPACE.exists() else 0}"


def is_process(pid: int) -> bool:
    """Whether a process of this table exists; a zombie has nothing left to say. Without /proc nobody can tell."""
    if not NAMESPACE.exists():
        return True
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] not in "ZX"
    except OSError:
        return False


class Ticker:
    """A thread that ticks every `tick_s`, and at once when told that something has changed."""

    def __init__(
        self,
        *,
        store: Store,
        app: Celery,
        settings: Settings,
        identity: WorkerIdentity,
        telemetry: Telemetry,
        on_tick: Callable[[], None],
        on_drain: Callable[[], None],
        on_pause: Callable[[bool], None],
        on_dead: Callable[[Sequence[str]], None],
    ) -> None:
        self._store = store
        self._app = app
        self._settings = settings
        self._identity = identity
        self._telemetry = telemetry
        self._looked_at = self._counted_at = time.monotonic()
        self._on_tick = on_tick
        self._on_drain = on_drain
        self._on_pause = on_pause
        self._on_dead = on_dead
        self._quiet_until = 0.0
        self._holder = identity.id if settings.broker_url.startswith("memory") else None
        self._wake = threading.Event()
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name="ticker", daemon=True)

    def start(self) -> None:
        """Make the worker known and begin to tick."""
        self._store.write(lambda session: workers.register(session, self._identity, self._settings.lease_s))
        self._thread.start()

    def wake(self) -> None:
        """Tick now: a step has ended."""
        self._wake.set()

    def stop(self) -> None:
        """Tick no more."""
        self._ended.set()
        self._wake.set()
        self._thread.join()

    def tick(self) -> None:
        """One tick; what cannot be done now is done by the next."""
        self._beat()
        self._bury_dead()
        self._take_back_lost()
        self._send_ready()
        self._count_ended()
        self._on_tick()
        self._telemetry.last_tick.set_to_current_time()

    def seconds_since_tick(self) -> float:
        """Since the last tick began, whether it went well or not."""
        return time.monotonic() - self._looked_at

    def _count_ended(self) -> None:
        """Add what has ended to the totals, now and then: they are for people and Prometheus, not for steps."""
        if time.monotonic() - self._counted_at < COUNT_S:
            return
        self._counted_at = time.monotonic()
        with self._store.read() as session:
            any_left = meters.has_uncounted(session)
        while any_left:
            any_left = self._store.write(meters.fold) == meters.BATCH

    def _run(self) -> None:
        due = 0.0
        while not self._ended.is_set():
            self._looked_at = time.monotonic()
            try:
                if time.monotonic() >= due:
                    self.tick()
                    due = time.monotonic() + self._settings.tick_s
                else:
                    self._send_ready()
            except Exception:  # whatever it is, the worker must not fall silent: the next tick tries again
                log.exception("a tick failed; next try in %s s", self._settings.tick_s)
            self._wake.wait(max(0.0, due - time.monotonic()) or self._settings.tick_s)
            self._wake.clear()

    def _beat(self) -> None:
        state = self._store.write(lambda session: workers.beat(session, self._identity, self._settings.lease_s))
        self._on_pause(state == workers.PAUSED)
        if state not in (workers.ACTIVE, workers.PAUSED):
            self._on_drain()

    def _send_ready(self) -> None:
        if time.monotonic() < self._quiet_until:
            return
        if is_low(self._settings):
            log.warning("the disk is nearly full: no step is begun")
            return
        for message in self._store.write(lambda session: dispatch.dispatch(session, self._holder)):
            if not self._ring(message):
                self._quiet_until = time.monotonic() + QUIET_S
                return  # the others would wait as long for nothing; all are sent again when nobody claims them

    def _bury_dead(self) -> None:
        """Workers of this process table that have died without a word need not be waited for."""
        with self._store.read() as session:
            neighbours = workers.living_of(session, self._identity.host)
        dead = [one.id for one in neighbours if not is_process(one.pid)]
        if dead:
            log.warning("workers %s have died", ", ".join(dead))
            self._store.write(lambda session: workers.bury(session, dead))
            self._on_dead(dead)

    def _take_back_lost(self) -> None:
        with self._store.read() as session:
            expired = leases.overdue_steps(session)
            unclaimed = dispatch.unclaimed_steps(session, self._settings.resend_s)
            late = overdue_scans(session)
        most = self._settings.max_attempts
        for step_id in expired:
            log.warning("the lease of step %s has expired", step_id)
            self._store.write(partial(leases.reap, step_id=step_id, max_attempts=most))
        for step_id in unclaimed:
            self._store.write(partial(dispatch.take_back, step_id=step_id))
        for scan_id in late:
            self._store.write(partial(miss_deadline, scan_id=scan_id))

    def _ring(self, message: Message) -> bool:
        try:
            publish(self._app, message)
        except (BrokerError, OSError):
            self._telemetry.broker_errors.inc()
            log.warning("the broker does not answer; step %s is sent again later", message.step_id)
            return False
        self._telemetry.messages.inc()
        return True
