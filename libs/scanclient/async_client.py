"""The asynchronous client: the same requests and values as `Client`; files travel in threads, as disks do not wait."""

import asyncio
import time
import uuid
from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import httpx
import stamina

from scanclient import calls
from scanclient.answers import checked
from scanclient.calls import Call
from scanclient.client import Client
from scanclient.errors import WaitTimedOut
from scanclient.fetching import AT_ONCE
from scanclient.plants import AsyncPlants
from scanclient.retries import unreachable, worth_retrying
from scanclient.values import Artifact, Capture, LogLine, Page, Scan, bound, succeeded


class AsyncClient:
    """Submit scans, follow them, fetch what they found, without blocking an event loop.

    Parameters
    ----------
    address : of the service, for instance ``http://127.0.0.1:8000``.
    key : API key (``nm_…``), sent as a bearer token.
    timeout_s : seconds without an answer before a request counts as broken.
    attempts : how often a broken connection or a 503 is tried in all.

    Examples
    --------
    >>> async with AsyncClient("http://127.0.0.1:8000") as client:
    ...     scan = await client.submit({"source": {"kind": "clouds", "path": "out/clouds"}})
    ...     await scan.wait(on_progress=print)
    """

    def __init__(self, address: str, *, key: str | None = None, timeout_s: float = 30.0, attempts: int = 6) -> None:
        headers = {"Authorization": f"Bearer {key}"} if key else {}
        self._address = address
        self._attempts = attempts
        self._http = httpx.AsyncClient(base_url=address, headers=headers, timeout=timeout_s)
        self.plants = AsyncPlants(self._send)
        """Plants, their history, tracks, alarms and exports."""
        self._blocking = partial(Client, address, key=key, timeout_s=timeout_s, attempts=attempts)

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None
    ) -> None:
        await self.close()

    async def close(self) -> None:
        """Close the connections."""
        await self._http.aclose()

    async def submit(self, spec: Mapping[str, Any], idempotency_key: str | None = None) -> Scan:
        """Start a scan; returns it as queued. Raises `InvalidRequest`."""
        return await self._scan(calls.submit(dict(spec), idempotency_key or str(uuid.uuid4())))

    async def get(self, scan: str) -> Scan:
        """The scan with its progress. Raises `NotFound`."""
        return await self._scan(calls.get(scan))

    async def list(
        self,
        *,
        status: str | None = None,
        plant: str | None = None,
        tag: str | None = None,
        cursor: str | None = None,
        limit: int = 50,
    ) -> Page:
        """One page of scans, the newest first."""
        call = calls.list_scans(status=status, plant=plant, tag=tag, cursor=cursor, limit=limit)
        page = Page.parse((await self._send(call)).json())
        return Page(items=tuple(bound(scan, self) for scan in page.items), next_cursor=page.next_cursor)

    async def iterate(
        self, *, status: str | None = None, plant: str | None = None, tag: str | None = None
    ) -> AsyncIterator[Scan]:
        """All scans, the newest first, page by page."""
        cursor: str | None = None
        while True:
            page = await self.list(status=status, plant=plant, tag=tag, cursor=cursor, limit=200)
            for scan in page.items:
                yield scan
            cursor = page.next_cursor
            if cursor is None:
                return

    async def wait(
        self,
        scan: str,
        *,
        on_progress: Callable[[Scan], None] | None = None,
        poll_s: float = 1.0,
        timeout_s: float | None = None,
    ) -> Scan:
        """Follow a scan until it succeeded. Raises `ScanFailed`, `ScanCanceled` or `WaitTimedOut`."""
        deadline = None if timeout_s is None else time.monotonic() + timeout_s
        while True:
            seen = await self.get(scan)
            if on_progress is not None:
                on_progress(seen)
            if seen.is_over:
                return succeeded(seen)
            if deadline is not None and time.monotonic() + poll_s > deadline:
                raise WaitTimedOut(f"scan {scan} is still {seen.status} after {timeout_s:g} s")
            await asyncio.sleep(poll_s)

    async def cancel(self, scan: str) -> Scan:
        """Ask the scan to stop. Raises `Conflict` when it is over."""
        return await self._scan(calls.cancel(scan))

    async def pause(self, scan: str) -> Scan:
        """Begin no more steps of the scan until it is resumed. Raises `Conflict` when it is over."""
        return await self._scan(calls.pause(scan))

    async def resume(self, scan: str) -> Scan:
        """Go on with a paused scan. Raises `Conflict` when it is over."""
        return await self._scan(calls.resume(scan))

    async def retry(self, scan: str, from_step: str | None = None, frames: Sequence[int] = ()) -> Scan:
        """Run a scan that is over again, from `from_step` on, of `frames` alone if given."""
        return await self._scan(calls.retry(scan, from_step, frames))

    async def fork(self, scan: str, changes: Mapping[str, Any], idempotency_key: str | None = None) -> Scan:
        """Submit a scan again with changes (a JSON merge patch)."""
        return await self._scan(calls.fork(scan, dict(changes), idempotency_key or str(uuid.uuid4())))

    async def delete(self, scan: str) -> None:
        """Forget a scan that has ended. Raises `Conflict` while it runs."""
        await self._send(calls.delete(scan))

    async def logs(self, scan: str, *, after: int = 0, limit: int = 500) -> tuple[LogLine, ...]:
        """What the steps wrote behind the line `after`, oldest first."""
        answer = await self._send(calls.logs(scan, after=after, limit=limit))
        return tuple(LogLine.parse(row) for row in answer.json()["items"])

    async def modes(self, scan: str) -> dict[str, Any]:
        """The scan's ``modes.json``."""
        document: dict[str, Any] = (await self._send(calls.modes(scan))).json()
        return document

    async def artifacts(self, scan: str) -> tuple[Artifact, ...]:
        """Every file of the scan, the results first."""
        answer = await self._send(calls.artifacts(scan))
        return tuple(Artifact.parse(row) for row in answer.json()["items"])

    async def preflight(
        self, spec: Mapping[str, Any], *, modes: Sequence[str] = (), noise_mm: float | None = None
    ) -> dict[str, Any]:
        """What a scan of this specification can find and will cost; nothing is started. Modes are 'HZ:DAMPING:MM'."""
        call = calls.preflight(dict(spec), modes, noise_mm)
        answer: dict[str, Any] = (await self._send(call)).json()
        return answer

    async def presets(self) -> dict[str, Any]:
        """The specifications the service ships with, by name."""
        document: dict[str, Any] = (await self._send(calls.presets())).json()
        return document

    async def info(self) -> dict[str, Any]:
        """Version and limits of the service."""
        document: dict[str, Any] = (await self._send(calls.info())).json()
        return document

    async def download(
        self,
        scan: str,
        folder: Path,
        *,
        select: Callable[[Artifact], bool] | None = None,
        on_file: Callable[[Artifact], None] | None = None,
        at_once: int = AT_ONCE,
    ) -> tuple[Path, ...]:
        """`Client.download`, in a thread."""

        def work() -> tuple[Path, ...]:
            with self._blocking() as client:
                return client.download(scan, folder, select=select, on_file=on_file, at_once=at_once)

        return await asyncio.to_thread(work)

    async def upload(
        self,
        folder: Path,
        *,
        kind: str = "capture",
        name: str | None = None,
        on_bytes: Callable[[int], None] | None = None,
        at_once: int = AT_ONCE,
    ) -> Capture:
        """`Client.upload`, in a thread."""

        def work() -> Capture:
            with self._blocking() as client:
                return client.upload(folder, kind=kind, name=name, on_bytes=on_bytes, at_once=at_once)

        return await asyncio.to_thread(work)

    async def _scan(self, call: Call) -> Scan:
        return bound(Scan.parse((await self._send(call)).json()), self)

    async def _send(self, call: Call) -> httpx.Response:
        on = worth_retrying(repeatable=call.repeatable)
        try:
            async for attempt in stamina.retry_context(on=on, attempts=self._attempts):
                with attempt:
                    return checked(await self._http.request(**call.arguments()))
        except httpx.TransportError as error:
            raise unreachable(self._address, error) from error
        raise AssertionError("the retry loop ends by returning or raising")
