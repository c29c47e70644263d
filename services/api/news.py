"""One look at the database for all who listen: a task that reads new events and wakes only whom they concern.

At rest a page that is open costs nothing but its share of one small query every half second, however many are open.
"""

import asyncio
import contextlib
from collections import Counter
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Final

from scanjobs.event_log import Happening, Place, last_place, read_events
from scanjobs.repository import KindSummary, summaries_of
from scanjobs.states import ScanState
from scanjobs.store import Store
from scanjobs.tables import Scan
from sqlalchemy import select
from sqlalchemy.exc import SQLAlchemyError
from starlette.concurrency import run_in_threadpool

LOOK_S: Final = 0.5
BATCH: Final = 500
MOST_LISTENERS: Final = 500
Progress = tuple[KindSummary, ...]


class Listener:
    """Waits for news of one scan, or of all scans of an owner."""

    def __init__(self, owner: str, scan_id: str | None) -> None:
        self.owner = owner
        self.scan_id = scan_id
        self.progress: Progress = ()
        self._woken = asyncio.Event()

    def wake(self) -> None:
        """There is news."""
        self._woken.set()

    async def wait(self, timeout_s: float) -> bool:
        """Until there is news, or for so long; whether there is."""
        try:
            async with asyncio.timeout(timeout_s):
                await self._woken.wait()
        except TimeoutError:
            return False
        self._woken.clear()
        return True


class News:
    """The listeners of this process, and the task that looks for them; it runs while somebody listens."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._listeners: set[Listener] = set()
        self._task: asyncio.Task[None] | None = None

    @property
    def is_full(self) -> bool:
        """Whether as many listen as one process serves."""
        return len(self._listeners) >= MOST_LISTENERS

    @asynccontextmanager
    async def listening(self, owner: str, scan_id: str | None) -> AsyncIterator[Listener]:
        """A listener while the block runs; events from before it are for the caller to read."""
        listener = Listener(owner, scan_id)
        self._listeners.add(listener)
        if self._task is None or self._task.done():
            self._task = asyncio.create_task(self._look_on())
        try:
            yield listener
        finally:
            self._listeners.discard(listener)

    async def close(self) -> None:
        """Stop looking."""
        if self._task is not None:
            self._task.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await self._task

    async def _look_on(self) -> None:
        place: Place | None = None
        while self._listeners:
            with contextlib.suppress(SQLAlchemyError):  # a database that is away has no news; the next look tells
                if place is None:
                    place = await run_in_threadpool(self._last)
                    self._wake(set(), everybody=True)
                place = await self._look(place)
            await asyncio.sleep(LOOK_S)

    async def _look(self, place: Place) -> Place:
        happened = await run_in_threadpool(self._read, place)
        self._wake({(one.owner, one.scan_id) for one in happened})
        watched = Counter(one.scan_id for one in self._listeners if one.scan_id)
        if watched:
            self._tell(await run_in_threadpool(self._progress, list(watched)))
        return happened[-1].place if happened else place

    def _wake(self, concerned: set[tuple[str, str]], *, everybody: bool = False) -> None:
        owners, scans = {owner for owner, _ in concerned}, {scan_id for _, scan_id in concerned}
        for listener in self._listeners:
            mine = listener.owner in owners if listener.scan_id is None else listener.scan_id in scans
            if mine or everybody:
                listener.wake()

    def _tell(self, progress: dict[str, Progress]) -> None:
        for listener in self._listeners:
            found = progress.get(listener.scan_id or "")
            if found is not None and found != listener.progress:
                listener.progress = found
                listener.wake()

    def _last(self) -> Place:
        with self._store.read() as session:
            return last_place(session)

    def _read(self, place: Place) -> tuple[Happening, ...]:
        with self._store.read() as session:
            return read_events(session, place, limit=BATCH)

    def _progress(self, scan_ids: list[str]) -> dict[str, Progress]:
        """Of the watched scans that are running: only there progress moves without an event."""
        with self._store.read() as session:
            running = select(Scan).where(Scan.id.in_(scan_ids), Scan.state == ScanState.RUNNING)
            scans = list(session.scalars(running))
            return summaries_of(session, scans) if scans else {}
