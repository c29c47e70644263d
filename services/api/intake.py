"""Submissions that arrive while one is being committed are committed together (group commit).

Nobody waits for company: whoever finds the database idle is written at once, and what comes meanwhile is the next
batch. An answer is given when the transaction that holds the scan has been committed, never before.
"""

import asyncio
import queue
from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from typing import Final

from scanjobs.intake import Answer, Asked, Submission, insert_asked
from scanjobs.store import Store
from sqlalchemy.exc import DataError, IntegrityError

MOST: Final = 64
"""Submissions of one transaction."""
Waiting = tuple[Asked, "Future[Submission]"]


class Intake:
    """Takes simulations in; one thread of its own writes them."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._queue: queue.SimpleQueue[Waiting] = queue.SimpleQueue()
        self._held: list[Waiting] = []
        self._writer = ThreadPoolExecutor(1, "intake")

    async def submit(self, asked: Asked) -> Submission:
        """The stored scan, committed. Raises what `insert_asked` answers, or what the database said."""
        future: Future[Submission] = Future()
        self._queue.put((asked, future))
        self._writer.submit(self._write_waiting)
        return await asyncio.wrap_future(future)

    def close(self) -> None:
        """Write what has been asked, and end."""
        self._writer.shutdown()

    def _write_waiting(self) -> None:
        """Called as often as somebody asks; most calls find that an earlier one has done it."""
        while batch := self._next_batch():
            asked = [one for one, _ in batch]
            for (_, future), answer in zip(batch, self._answers(asked), strict=True):
                if isinstance(answer, Submission):
                    future.set_result(answer)
                else:
                    future.set_exception(answer)

    def _next_batch(self) -> list[Waiting]:
        """What waits, each Idempotency-Key once: its second comer finds the first one stored."""
        waiting, self._held = self._held, []
        while len(waiting) < MOST:
            try:
                waiting.append(self._queue.get_nowait())
            except queue.Empty:
                break
        names: set[tuple[str, str]] = set()
        batch: list[Waiting] = []
        for one in waiting:
            name = one[0].name
            if name is not None and name in names:
                self._held.append(one)
            elif one[1].set_running_or_notify_cancel():
                batch.append(one)
                names |= {name} if name else set()
        return batch

    def _answers(self, asked: Sequence[Asked]) -> Sequence[Answer | Exception]:
        try:
            return self._store.write(partial(insert_asked, asked=asked))
        except (IntegrityError, DataError):  # one of them cannot go in, or another process has just used its key
            return [self._answer(one) for one in asked]
        except Exception as error:
            return [error] * len(asked)

    def _answer(self, one: Asked) -> Answer | Exception:
        for _ in range(2):
            try:
                return self._store.write(partial(insert_asked, asked=[one]))[0]
            except IntegrityError as refusal:
                error: Exception = refusal
            except Exception as failure:
                return failure
        return error
