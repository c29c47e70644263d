"""Wiring: a worker is a ticker, a supervisor and a Celery pool of threads around one store and one broker.

`create_worker` builds one; `embedded_worker` runs one inside another process, on a data folder that nobody else uses.
"""

import fcntl
import logging
import os
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Final

import uuid6
from celery import Celery
from scanjobs import workers
from scanjobs.errors import DataFolderInUse
from scanjobs.messages import QUEUES
from scanjobs.migrate import check_current, upgrade
from scanjobs.object_store import open_artifacts
from scanjobs.queue import make_app, make_consumer, serve
from scanjobs.settings import Settings
from scanjobs.slots import Devices
from scanjobs.store import Store, open_store
from scanjobs.telemetry import Telemetry
from scanjobs.tracing import open_tracing
from scanjobs.workers import WorkerIdentity
from sqlalchemy.exc import SQLAlchemyError
from sqlalchemy.orm import Session

from services.worker.chores import Chores
from services.worker.endpoint import Endpoint
from services.worker.supervisor import Supervisor
from services.worker.ticker import Ticker, process_table

log = logging.getLogger(__name__)

LOCK_NAME: Final = "server.lock"


class Worker:
    """A worker of this process. `start`, then `stop` (which drains), once each."""

    def __init__(self, *, store: Store, app: Celery, settings: Settings, identity: WorkerIdentity) -> None:
        self.identity = identity
        self.drained = threading.Event()
        self._store = store
        self._settings = settings
        artifacts = open_artifacts(settings)
        self._chores = Chores(store, artifacts, settings)
        self._tracing = open_tracing(settings, "nerfmodal-worker")
        self.supervisor = Supervisor(
            store=store,
            artifacts=artifacts,
            settings=settings,
            worker_id=identity.id,
            queues=identity.queues,
            on_change=self._wake,
            devices=Devices(host=identity.host, gpus=settings.gpus),
            tracing=self._tracing,
        )
        telemetry = Telemetry(settings, store)
        serve(app, self.supervisor.supervise)
        name = f"{identity.id}@{identity.host}"
        self._celery = make_consumer(app, name=name, queues=identity.queues, slots=identity.slots)
        self._consumer = threading.Thread(target=self._celery.start, name="consumer", daemon=True)
        self._ticker = Ticker(
            store=store,
            app=app,
            settings=settings,
            identity=identity,
            telemetry=telemetry,
            on_tick=self._tick,
            on_drain=self.drained.set,
            on_pause=self.supervisor.pause,
            on_dead=self.supervisor.sweep,
        )
        self.endpoint = (
            Endpoint(
                settings=settings,
                store=store,
                telemetry=telemetry,
                seconds_since_tick=self._ticker.seconds_since_tick,
            )
            if settings.metrics_port
            else None
        )

    def start(self) -> None:
        """Begin to take steps."""
        self._ticker.start()
        self._consumer.start()
        if self.endpoint is not None:
            self.endpoint.start()

    def stop(self) -> None:
        """Drain: give the steps under way back, and end. Takes at most about `drain_s`."""
        self._say(lambda session: workers.leave(session, self.identity))
        self.supervisor.drain()
        self._ticker.stop()
        self._celery.stop()
        self._consumer.join(self._settings.drain_s)
        self.supervisor.close()
        if self.endpoint is not None:
            self.endpoint.stop()
        self._say(lambda session: workers.bury(session, [self.identity.id]))
        self._store.close()
        self._tracing.close()

    def _tick(self) -> None:
        self.supervisor.children.end_idle(self._settings.runner_idle_s)
        self._chores.run()

    def _wake(self) -> None:
        self._ticker.wake()

    def _say(self, word: Callable[[Session], None]) -> None:
        try:
            self._store.write(word)
        except SQLAlchemyError:
            log.warning("the database does not answer; this worker is forgotten when its lease ends")


def create_worker(settings: Settings, *, queues: Sequence[str] = QUEUES, slots: int | None = None) -> Worker:
    """A worker that is not started yet. Raises `DatabaseOutOfDate` where the database must be migrated first."""
    identity = WorkerIdentity(
        id=str(uuid6.uuid7()),
        host=process_table(),
        pid=os.getpid(),
        queues=tuple(queues),
        slots=slots or settings.slots,
    )
    store = open_store(settings.database)
    check_current(store)
    return Worker(store=store, app=make_app(settings.broker_url), settings=settings, identity=identity)


@contextmanager
def embedded_worker(
    settings: Settings, *, queues: Sequence[str] = QUEUES, slots: int | None = None
) -> Iterator[Worker]:
    """A worker inside this process while the block runs; brings the database up to date first.

    Raises
    ------
    DataFolderInUse
        Another server runs on the same data folder.
    """
    with only_server(settings.data_folder):
        upgrade(settings.database)
        worker = create_worker(settings, queues=queues, slots=slots)
        worker.start()
        try:
            yield worker
        finally:
            worker.stop()


@contextmanager
def only_server(data_folder: Path) -> Iterator[None]:
    """Hold the data folder's lock; the kernel lets go of it when this process dies."""
    data_folder.mkdir(parents=True, exist_ok=True)
    with (data_folder / LOCK_NAME).open("a") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise DataFolderInUse(
                f"another server runs on {data_folder.resolve()}.",
                hint="Stop it, or set NERFMODAL_DATA_FOLDER to another folder.",
            ) from error
        yield
