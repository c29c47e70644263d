"""The synchronous client. Requests are built in `calls`, answers read in `values`; here they are sent."""

import time
import uuid
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import httpx
import stamina

from scanclient import calls
from scanclient.answers import checked
from scanclient.calls import Call
from scanclient.errors import WaitTimedOut
from scanclient.fetching import AT_ONCE, Fetcher
from scanclient.plants import Plants
from scanclient.retries import unreachable, worth_retrying
from scanclient.sending import Sender
from scanclient.values import Artifact, Capture, LogLine, Page, Scan, bound, is_result, succeeded


class Client:
    """Submit scans, follow them, fetch what they found.

    Parameters
    ----------
    address : of the service, for instance ``http://127.0.0.1:8000``.
    key : API key (``nm_…``), sent as a bearer token.
    timeout_s : seconds without an answer before a request counts as broken.
    attempts : how often a broken connection or a 503 is tried in all.

    Examples
    --------
    >>> with Client("http://127.0.0.1:8000") as client:
    ...     scan = client.submit({"source": {"kind": "clouds", "path": "out/clouds"}})
    ...     client.wait(scan.id)
    ...     client.download(scan.id, Path("out"))
    """

    def __init__(self, address: str, *, key: str | None = None, timeout_s: float = 30.0, attempts: int = 6) -> None:
        headers = {"Authorization": f"Bearer {key}"} if key else {}
        self._address = address
        self._attempts = attempts
        self._http = httpx.Client(base_url=address, headers=headers, timeout=timeout_s)
        self.plants = Plants(self._send)
        """Plants, their history, tracks, alarms and exports."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        """Close the connections."""
        self._http.close()

    def submit(self, spec: Mapping[str, Any], idempotency_key: str | None = None) -> Scan:
        """Start a scan; returns it as queued.

        Raises
        ------
        InvalidRequest : the specification is refused; `pointer` names the field.
        """
        return self._scan(calls.submit(dict(spec), idempotency_key or str(uuid.uuid4())))

    def get(self, scan: str) -> Scan:
        """The scan with its progress. Raises `NotFound`."""
        return self._scan(calls.get(scan))

    def list(
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
        page = Page.parse(self._send(call).json())
        return Page(items=tuple(bound(scan, self) for scan in page.items), next_cursor=page.next_cursor)

    def iterate(self, *, status: str | None = None, plant: str | None = None, tag: str | None = None) -> Iterator[Scan]:
        """All scans, the newest first, page by page."""
        cursor: str | None = None
        while True:
            page = self.list(status=status, plant=plant, tag=tag, cursor=cursor, limit=200)
            yield from page.items
            cursor = page.next_cursor
            if cursor is None:
                return

    def wait(
        self,
        scan: str,
        *,
        on_progress: Callable[[Scan], None] | None = None,
        poll_s: float = 1.0,
        timeout_s: float | None = None,
    ) -> Scan:
        """Follow a scan until it succeeded.

        Parameters
        ----------
        on_progress : called with the scan after every look at it, the last one included.
        poll_s : seconds between looks.
        timeout_s : patience in seconds; without limit by default.

        Raises
        ------
        ScanFailed, ScanCanceled : the scan ended otherwise.
        WaitTimedOut : it did not end in time.
        """
        deadline = None if timeout_s is None else time.monotonic() + timeout_s
        while True:
            seen = self.get(scan)
            if on_progress is not None:
                on_progress(seen)
            if seen.is_over:
                return succeeded(seen)
            if deadline is not None and time.monotonic() + poll_s > deadline:
                raise WaitTimedOut(f"scan {scan} is still {seen.status} after {timeout_s:g} s")
            time.sleep(poll_s)

    def cancel(self, scan: str) -> Scan:
        """Ask the scan to stop. Raises `Conflict` when it is over."""
        return self._scan(calls.cancel(scan))

    def pause(self, scan: str) -> Scan:
        """Begin no more steps of the scan until it is resumed. Raises `Conflict` when it is over."""
        return self._scan(calls.pause(scan))

    def resume(self, scan: str) -> Scan:
        """Go on with a paused scan. Raises `Conflict` when it is over."""
        return self._scan(calls.resume(scan))

    def retry(self, scan: str, from_step: str | None = None, frames: Sequence[int] = ()) -> Scan:
        """Run a scan that is over again, from `from_step` on (``scan.identify``), of `frames` alone if given."""
        return self._scan(calls.retry(scan, from_step, frames))

    def fork(self, scan: str, changes: Mapping[str, Any], idempotency_key: str | None = None) -> Scan:
        """Submit a scan again with changes (a JSON merge patch); what they do not touch is not computed again."""
        return self._scan(calls.fork(scan, dict(changes), idempotency_key or str(uuid.uuid4())))

    def delete(self, scan: str) -> None:
        """Forget a scan that has ended, with its files. Raises `Conflict` while it runs."""
        self._send(calls.delete(scan))

    def logs(self, scan: str, *, after: int = 0, limit: int = 500) -> tuple[LogLine, ...]:
        """What the steps wrote behind the line `after`, oldest first."""
        rows = self._send(calls.logs(scan, after=after, limit=limit)).json()["items"]
        return tuple(LogLine.parse(row) for row in rows)

    def iterate_logs(self, scan: str, *, after: int = 0) -> Iterator[LogLine]:
        """All lines behind `after` that are there now, page by page."""
        while lines := self.logs(scan, after=after):
            yield from lines
            after = lines[-1].id

    def modes(self, scan: str) -> dict[str, Any]:
        """The scan's ``modes.json``."""
        document: dict[str, Any] = self._send(calls.modes(scan)).json()
        return document

    def artifacts(self, scan: str) -> tuple[Artifact, ...]:
        """Every file of the scan, the results first."""
        return tuple(Artifact.parse(row) for row in self._send(calls.artifacts(scan)).json()["items"])

    def preflight(
        self, spec: Mapping[str, Any], *, modes: Sequence[str] = (), noise_mm: float | None = None
    ) -> dict[str, Any]:
        """What a scan of this specification can find and will cost; nothing is started. Modes are 'HZ:DAMPING:MM'."""
        call = calls.preflight(dict(spec), modes, noise_mm)
        answer: dict[str, Any] = self._send(call).json()
        return answer

    def presets(self) -> dict[str, Any]:
        """The specifications the service ships with, by name."""
        document: dict[str, Any] = self._send(calls.presets()).json()
        return document

    def info(self) -> dict[str, Any]:
        """Version and limits of the service."""
        document: dict[str, Any] = self._send(calls.info()).json()
        return document

    def download(
        self,
        scan: str,
        folder: Path,
        *,
        select: Callable[[Artifact], bool] | None = None,
        on_file: Callable[[Artifact], None] | None = None,
        at_once: int = AT_ONCE,
    ) -> tuple[Path, ...]:
        """Fetch a scan's files into `folder`, checked by digest; what is there already is not fetched again.

        Parameters
        ----------
        select : which files; by default the results and the truth, without frames, checkpoints and clouds.
        on_file : called after each file.
        at_once : files, and ranges of large files, that are fetched beside one another.

        Raises
        ------
        BrokenDownload : a file arrived twice with another digest than the service holds.
        """
        wanted = [artifact for artifact in self.artifacts(scan) if (select or is_result)(artifact)]
        fetcher = Fetcher(self._http, scan, attempts=self._attempts)
        try:
            return fetcher.fetch(wanted, folder, at_once=at_once, on_file=on_file)
        except httpx.TransportError as error:
            raise unreachable(self._address, error) from error

    def upload(
        self,
        folder: Path,
        *,
        kind: str = "capture",
        name: str | None = None,
        on_bytes: Callable[[int], None] | None = None,
        at_once: int = AT_ONCE,
    ) -> Capture:
        """Send a folder of pictures (or of clouds) and make it a capture; `capture.source` goes into a specification.

        What an earlier call has sent of it, in this program or in one that was killed, is not sent again.

        Parameters
        ----------
        kind : ``"capture"`` or ``"clouds"``.
        on_bytes : called with the number of bytes of each piece that has arrived; from several threads.

        Raises
        ------
        InvalidRequest : a file cannot be used; the detail names it.
        BrokenUpload : a file changed meanwhile.
        """
        paths = sorted(path for path in folder.rglob("*") if path.is_file() and not path.name.startswith("."))
        files = [(path.relative_to(folder).as_posix(), path) for path in paths]
        sender = Sender(self._send, self._once, attempts=self._attempts)
        try:
            uploads = sender.send(files, at_once=at_once, on_bytes=on_bytes)
        except httpx.TransportError as error:
            raise unreachable(self._address, error) from error
        members = [(upload.id, relative) for upload, (relative, _) in zip(uploads, files, strict=True)]
        return Capture.parse(self._send(calls.make_capture(name or folder.name or kind, kind, members)).json())

    def _scan(self, call: Call) -> Scan:
        return bound(Scan.parse(self._send(call).json()), self)

    def _send(self, call: Call) -> httpx.Response:
        on = worth_retrying(repeatable=call.repeatable)
        try:
            for attempt in stamina.retry_context(on=on, attempts=self._attempts):
                with attempt:
                    return self._once(call)
        except httpx.TransportError as error:
            raise unreachable(self._address, error) from error
        raise AssertionError("the retry loop ends by returning or raising")

    def _once(self, call: Call) -> httpx.Response:
        return checked(self._http.request(**call.arguments()))
