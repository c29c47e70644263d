"""The only place where Celery is configured. Messages are JSON and carry a step's id; results live in SQL.

Messages are acknowledged early: a step that its worker loses comes back by its lease, not by redelivery.
"""

import contextlib
import logging
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from celery import Celery
from celery.concurrency.thread import TaskPool
from celery.worker import WorkController
from kombu import Queue

from scanjobs.messages import KINDS, QUEUE_OF, QUEUES, Message

Supervise = Callable[[str], None]


def make_app(broker_url: str) -> Celery:
    """A Celery application that can publish; `serve` makes it a worker's."""
    app = Celery("nerfmodal", broker=broker_url, set_as_current=False)
    app.conf.update(
        result_backend=None,
        task_ignore_result=True,
        task_acks_late=False,
        worker_prefetch_multiplier=1,
        worker_disable_prefetch=broker_url.startswith("redis"),
        worker_pool="threads",
        worker_cancel_long_running_tasks_on_connection_loss=False,
        task_serializer="json",
        accept_content=["json"],
        task_publish_retry=False,
        broker_transport_options=_transport_options(broker_url),
        broker_connection_retry_on_startup=True,
        broker_connection_max_retries=None,
        task_queues=[Queue(name) for name in QUEUES],
        task_create_missing_queues=False,
        task_routes={kind: {"queue": queue} for kind, queue in QUEUE_OF.items()},
        worker_enable_remote_control=False,
        worker_send_task_events=False,
        worker_hijack_root_logger=False,
        worker_redirect_stdouts=False,
    )
    return app


def serve(app: Celery, supervise: Supervise) -> None:
    """Let every task of the application call one supervisor."""
    for kind in KINDS:
        app.task(name=kind, ignore_result=True, shared=False)(_doorbell(supervise))


def make_consumer(app: Celery, *, name: str, queues: Sequence[str], slots: int) -> WorkController:
    """A Celery worker of threads that serves some queues; `start` blocks, `stop` is called from another thread."""
    return WorkController(
        app=app,
        hostname=name,
        concurrency=slots,
        queues=list(queues),
        pool_cls=ThreadsOfApp,
        loglevel=logging.WARNING,
        without_heartbeat=True,
        without_mingle=True,
        without_gossip=True,
        quiet=True,
    )


class ThreadsOfApp(TaskPool):
    """Threads that know their application, and that wake the consumer when one of them is free again.

    Celery looks a task up in the current application of the thread that runs it: here that is the worker's own. With
    prefetching disabled it asks Redis for the next message only when its event loop turns, which nobody else would
    make it do before a second is over.
    """

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        self.executor = ThreadPoolExecutor(max_workers=self.limit, initializer=self.app.set_current)
        self._ear, self._mouth = os.pipe()
        os.set_blocking(self._ear, False)
        os.set_blocking(self._mouth, False)

    def register_with_event_loop(self, loop: Any) -> None:
        """Let the loop turn whenever a thread is free."""
        loop.add_reader(self._ear, self._hear)

    def on_apply(self, *args: Any, **options: Any) -> Any:
        """Run a task; its future is done after Celery has counted it out."""
        result = super().on_apply(*args, **options)
        result.f.add_done_callback(self._say)
        return result

    def on_stop(self) -> None:
        """Wait for the threads."""
        super().on_stop()
        for end in (self._ear, self._mouth):
            os.close(end)

    def _say(self, _: object) -> None:
        with contextlib.suppress(OSError):  # the pipe is full, so the loop will turn, or the worker ends
            os.write(self._mouth, b".")

    def _hear(self) -> None:
        with contextlib.suppress(OSError):
            os.read(self._ear, 4096)


def publish(app: Celery, message: Message) -> None:
    """Ring for a step. Raises kombu's OperationalError when the broker cannot be reached."""
    app.send_task(message.kind, args=(message.step_id,), queue=message.queue, ignore_result=True)


def _doorbell(supervise: Supervise) -> Supervise:
    def ring(step_id: str) -> None:
        supervise(step_id)

    return ring


def _transport_options(broker_url: str) -> dict[str, Any]:
    if broker_url.startswith("redis"):
        return {"socket_timeout": 5, "socket_connect_timeout": 3, "health_check_interval": 25}
    if broker_url.startswith("memory"):
        return {"polling_interval": 0.05}
    return {}
