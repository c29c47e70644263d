"""The synchronous client. Requests are built in `calls`, answers read in `values`; here they are sent."""

import time
import uuid
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import httpx
import stamina

from scanclient import calls, downloads
from scanclient.answers import checked
from scanclient.calls import Call
from scanclient.errors import BrokenDownload, ScanCanceled, ScanFailed, WaitTimedOut
from scanclient.retries import unreachable, worth_retrying
from scanclient.values import Artifact, Page, Scan


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
        answer = self._send(calls.submit(dict(spec), idempotency_key or str(uuid.uuid4())))
        return Scan.parse(answer.json())

    def get(self, scan: str) -> Scan:
        """The scan with its progress. Raises `NotFound`."""
        return Scan.parse(self._send(calls.get(scan)).json())

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
        return Page.parse(self._send(call).json())

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
                return _succeeded(seen)
            if deadline is not None and time.monotonic() + poll_s > deadline:
                raise WaitTimedOut(f"scan {scan} is still {seen.status} after {timeout_s:g} s")
            time.sleep(poll_s)

    def cancel(self, scan: str) -> Scan:
        """Ask the scan to stop. Raises `Conflict` when it is over."""
        return Scan.parse(self._send(calls.cancel(scan)).json())

    def retry(self, scan: str, from_step: str | None = None) -> Scan:
        """Run a scan that is over again, from `from_step` on (``scan.identify``) or its first failure."""
        return Scan.parse(self._send(calls.retry(scan, from_step)).json())

    def modes(self, scan: str) -> dict[str, Any]:
        """The scan's ``modes.json``."""
        document: dict[str, Any] = self._send(calls.modes(scan)).json()
        return document

    def artifacts(self, scan: str) -> tuple[Artifact, ...]:
        """Every file of the scan, the results first."""
        return tuple(Artifact.parse(row) for row in self._send(calls.artifacts(scan)).json()["items"])

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
    ) -> tuple[Path, ...]:
        """Fetch a scan's files into `folder`, checked by digest; what is there already is not fetched again.

        Parameters
        ----------
        select : which files; by default the results and the truth, without frames, checkpoints and clouds.
        on_file : called after each file.

        Raises
        ------
        BrokenDownload : a file arrived twice with another digest than the service holds.
        """
        wanted = [artifact for artifact in self.artifacts(scan) if (select or is_result)(artifact)]
        paths = []
        for artifact in wanted:
            paths.append(self._download_one(scan, artifact, folder))
            if on_file is not None:
                on_file(artifact)
        return tuple(paths)

    def _download_one(self, scan: str, artifact: Artifact, folder: Path) -> Path:
        path = downloads.target(folder, artifact)
        if downloads.is_complete(path, artifact):
            return path
        try:
            return self._fetch(scan, artifact, path)
        except BrokenDownload:
            return self._fetch(scan, artifact, path)  # a part file of unknown past: once more, from byte 0

    def _fetch(self, scan: str, artifact: Artifact, path: Path) -> Path:
        part = downloads.part_path(path, artifact)
        on = worth_retrying(repeatable=True)
        try:
            for attempt in stamina.retry_context(on=on, attempts=self._attempts):
                with attempt:
                    self._fetch_rest(scan, artifact, part)
        except httpx.TransportError as error:
            raise unreachable(self._address, error) from error
        return downloads.accept(part, path, artifact)

    def _fetch_rest(self, scan: str, artifact: Artifact, part: Path) -> None:
        start = downloads.bytes_present(part, artifact)
        if start == artifact.size and part.exists():
            return
        call = calls.artifact(scan, artifact.name, start=start)
        with self._http.stream(call.method, call.path, headers=call.headers) as answer:
            if not answer.is_success:
                answer.read()
            resumed = checked(answer).status_code == httpx.codes.PARTIAL_CONTENT
            downloads.append(part, answer.iter_bytes(), start=start if resumed else 0)

    def _send(self, call: Call) -> httpx.Response:
        on = worth_retrying(repeatable=call.repeatable)
        try:
            for attempt in stamina.retry_context(on=on, attempts=self._attempts):
                with attempt:
                    return checked(self._request(call))
        except httpx.TransportError as error:
            raise unreachable(self._address, error) from error
        raise AssertionError("the retry loop ends by returning or raising")

    def _request(self, call: Call) -> httpx.Response:
        return self._http.request(call.method, call.path, params=call.params, json=call.body, headers=call.headers)


def is_result(artifact: Artifact) -> bool:
    """Whether a file is a result, or the truth of a simulation, and no frame, checkpoint or cloud."""
    return artifact.step == "scan.identify" or artifact.role == "truth"


def _succeeded(scan: Scan) -> Scan:
    if scan.status == "failed":
        raise ScanFailed(scan)
    if scan.status == "canceled":
        raise ScanCanceled(scan)
    return scan
