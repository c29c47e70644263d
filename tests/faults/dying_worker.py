"""A worker that kills itself once, between one thing that is committed and the next: DIE_AT says where.

`stored`: a result's files are stored, its rows are not. `sent`: steps are `sent`, their messages are not published.
`finished`: a result is accepted, nobody has been told.
"""

import os
import signal
from pathlib import Path
from typing import Any

from scanjobs import handover
from scanjobs.messages import TRAIN

from services.worker import ticker
from services.worker.main import main
from services.worker.supervisor import Supervisor


def die_once() -> None:
    """The first process that comes here dies."""
    try:
        Path(os.environ["DIE_MARK"]).touch(exist_ok=False)
    except FileExistsError:
        return
    os.kill(os.getpid(), signal.SIGKILL)


def die_before_the_rows(finish: Any) -> Any:
    """Of a training, after its files are stored."""

    def dying(session: Any, held: Any, outputs: Any, *others: Any) -> Any:
        if held.kind == TRAIN and outputs:
            die_once()
        return finish(session, held, outputs, *others)

    return dying


def die_before_the_message(publish: Any) -> Any:
    """After the commit of a dispatch."""

    def dying(app: Any, message: Any) -> None:
        if message.kind == TRAIN:
            die_once()
        publish(app, message)

    return dying


def die_after_the_rows(accept: Any) -> Any:
    """After the commit of a result."""

    def dying(self: Any, claim: Any, *others: Any) -> Any:
        ended = accept(self, claim, *others)
        if claim.kind == TRAIN:
            die_once()
        return ended

    return dying


if __name__ == "__main__":
    where = os.environ["DIE_AT"]
    if where == "stored":
        handover.finish_and_claim = die_before_the_rows(handover.finish_and_claim)
    elif where == "sent":
        ticker.publish = die_before_the_message(ticker.publish)
    elif where == "finished":
        Supervisor._accept = die_after_the_rows(Supervisor._accept)  # type: ignore[method-assign]
    raise SystemExit(main())
