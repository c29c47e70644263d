"""The process `nerfmodal worker`: wait for a signal or a drain, then give the steps back and end.

SIGUSR1 prints what every thread is doing.
"""

import faulthandler
import signal
import threading
from collections.abc import Sequence

from scanjobs.logs import configure
from scanjobs.messages import QUEUES
from scanjobs.settings import Settings

from services.worker.app import create_worker


def main(queues: Sequence[str] = QUEUES, slots: int | None = None) -> int:
    """Work until SIGTERM, SIGINT or an operator's drain; the exit code."""
    settings = Settings()
    configure(settings)
    worker = create_worker(settings, queues=queues, slots=slots)
    asked = worker.drained
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: _ask(asked))
    faulthandler.register(signal.SIGUSR1)
    worker.start()
    asked.wait()
    worker.stop()
    return 0


def _ask(asked: threading.Event) -> None:
    asked.set()


if __name__ == "__main__":
    raise SystemExit(main())
