"""Fetching a scan's files: several at a time, large ones in ranges beside one another, each checked by its digest."""

from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

import httpx
import stamina

from scanclient import calls, downloads
from scanclient.answers import checked
from scanclient.downloads import Piece
from scanclient.errors import BrokenDownload
from scanclient.retries import worth_retrying
from scanclient.values import Artifact

AT_ONCE = 4
PIECE_BYTES = 16 << 20


class Fetcher:
    """Fetches files of one scan over a client's connections; what is there already is not fetched again."""

    def __init__(self, http: httpx.Client, scan: str, *, attempts: int, piece_bytes: int = PIECE_BYTES) -> None:
        self._http = http
        self._scan = scan
        self._attempts = attempts
        self._piece_bytes = piece_bytes

    def fetch(
        self,
        artifacts: Sequence[Artifact],
        folder: Path,
        *,
        at_once: int,
        on_file: Callable[[Artifact], None] | None = None,
    ) -> tuple[Path, ...]:
        """Every file, in the order given. Raises `BrokenDownload`."""
        targets = tuple(downloads.target(folder, artifact) for artifact in artifacts)  # judged before any byte comes
        pool = ThreadPoolExecutor(at_once, "download")
        try:
            pending = [self._begin(pool, *pair) for pair in zip(artifacts, targets, strict=True)]
            for artifact, path, pieces in zip(artifacts, targets, pending, strict=True):
                self._finish(artifact, path, pieces)
                if on_file is not None:
                    on_file(artifact)
        finally:
            pool.shutdown(cancel_futures=True)
        return targets

    def _begin(self, pool: ThreadPoolExecutor, artifact: Artifact, path: Path) -> list[Future[None]]:
        if downloads.is_complete(path, artifact):
            return []
        pieces = downloads.pieces_of(artifact, self._piece_bytes)
        return [pool.submit(self._fetch_piece, artifact, path, piece) for piece in pieces]

    def _finish(self, artifact: Artifact, path: Path, pending: list[Future[None]]) -> None:
        for future in pending:
            future.result()
        if not pending:
            return
        try:
            self._accept(artifact, path)
        except BrokenDownload:  # a part file of unknown past: once more, from byte 0
            for piece in downloads.pieces_of(artifact, self._piece_bytes):
                self._fetch_piece(artifact, path, piece)
            self._accept(artifact, path)

    def _accept(self, artifact: Artifact, path: Path) -> None:
        part = downloads.part_path(path, artifact)
        pieces = downloads.pieces_of(artifact, self._piece_bytes)
        if len(pieces) > 1:
            downloads.join(part, pieces)
        downloads.accept(part, path, artifact)

    def _fetch_piece(self, artifact: Artifact, path: Path, piece: Piece) -> None:
        part = downloads.part_path(path, artifact)
        is_whole = piece == Piece(0, artifact.size)
        place = part if is_whole else downloads.piece_path(part, piece)
        for attempt in stamina.retry_context(on=worth_retrying(repeatable=True), attempts=self._attempts):
            with attempt:
                self._fetch_rest(artifact, place, piece, is_whole=is_whole)

    def _fetch_rest(self, artifact: Artifact, place: Path, piece: Piece, *, is_whole: bool) -> None:
        length = piece.end - piece.start
        present = downloads.bytes_present(place, length)
        if present == length and place.exists():
            return
        start, end = piece.start + present, None if is_whole else piece.end
        call = calls.artifact(self._scan, artifact.name, start=start, end=end)
        with self._http.stream(call.method, call.path, headers=call.headers) as answer:
            if not answer.is_success:
                answer.read()
            resumed = checked(answer).status_code == httpx.codes.PARTIAL_CONTENT
            if not resumed and not is_whole:
                raise BrokenDownload(f"{artifact.name}: the service gives no ranges")
            downloads.append(place, answer.iter_bytes(), start=present if resumed else 0)
