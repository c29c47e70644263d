"""Sending files: in pieces that carry their checksum, several files at a time, from where an earlier try stopped.

Nothing is kept on this side: the service is asked which files it has begun to receive (by name and length), so a
program that was killed goes on as one whose line broke. A file that is complete is compared by its digest.
"""

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Protocol

import httpx
import stamina

from scanclient import calls
from scanclient.calls import Call
from scanclient.downloads import digest_of
from scanclient.errors import BrokenUpload, Problem
from scanclient.retries import worth_retrying
from scanclient.values import Upload

PIECE_BYTES = 8 << 20
ASK_AGAIN = frozenset({409, 423, 460})
"""The bytes do not continue, somebody else is sending, a checksum differs: the offset says what to do."""
Earlier = Mapping[tuple[str, int], Upload]


class Send(Protocol):
    """How a client sends a call: with its retries, or once."""

    def __call__(self, call: Call) -> httpx.Response: ...


class Sender:
    """Sends files over a client's connections."""

    def __init__(self, send: Send, once: Send, *, attempts: int, piece_bytes: int = PIECE_BYTES) -> None:
        self._send = send
        self._once = once
        self._attempts = attempts
        self._piece_bytes = piece_bytes

    def send(
        self, files: Sequence[tuple[str, Path]], *, at_once: int, on_bytes: Callable[[int], None] | None
    ) -> tuple[Upload, ...]:
        """Send files under the names given; returns their uploads, complete. Raises `BrokenUpload`."""
        earlier = self._earlier()
        pool = ThreadPoolExecutor(at_once, "upload")
        try:
            pending = [pool.submit(self._send_file, name, path, earlier, on_bytes) for name, path in files]
            return tuple(future.result() for future in pending)
        finally:
            pool.shutdown(cancel_futures=True)

    def _earlier(self) -> Earlier:
        found: dict[tuple[str, int], Upload] = {}
        cursor: str | None = None
        while True:
            page = self._send(calls.list_uploads(cursor)).json()
            for row in page["items"]:
                upload = Upload.parse(row)
                found.setdefault((upload.name, upload.length), upload)
            cursor = page["next_cursor"]
            if cursor is None:
                return found

    def _send_file(self, name: str, path: Path, earlier: Earlier, on_bytes: Callable[[int], None] | None) -> Upload:
        length, digest = path.stat().st_size, digest_of(path)
        known = earlier.get((name, length))
        if known is not None:
            upload = self._send_rest(known, path, on_bytes)
            if upload.sha256 == digest:
                return upload
            self._send(calls.drop_upload(upload.id))  # another file of the same name and length was begun
        upload = self._send_rest(self._begin(name, length), path, on_bytes)
        if upload.sha256 != digest:
            self._send(calls.drop_upload(upload.id))
            raise BrokenUpload(f"{path} changed while it was sent")
        return upload

    def _begin(self, name: str, length: int) -> Upload:
        answer = self._send(calls.begin_upload(name, length))
        return self._look(answer.headers["Location"].rsplit("/", 1)[1])

    def _look(self, upload_id: str) -> Upload:
        return Upload.parse(self._send(calls.upload(upload_id)).json())

    def _send_rest(self, upload: Upload, path: Path, on_bytes: Callable[[int], None] | None) -> Upload:
        with path.open("rb") as file:
            while not upload.complete:
                file.seek(upload.received)
                content = file.read(min(self._piece_bytes, upload.length - upload.received))
                if not content:
                    raise BrokenUpload(f"{path} became shorter while it was sent")
                upload = self._send_piece(upload, content)
                if on_bytes is not None:
                    on_bytes(len(content))
        return upload

    def _send_piece(self, upload: Upload, content: bytes) -> Upload:
        """Send one piece; where the line broke, or another program has sent it, the service says how far it is."""
        offset = upload.received
        for attempt in stamina.retry_context(on=_may_go_on, attempts=self._attempts):
            with attempt:
                now = upload if attempt.num == 1 else self._look(upload.id)
                if now.received == offset:
                    self._once(calls.send_bytes(upload.id, offset, content))
        return self._look(upload.id)


def _may_go_on(error: Exception) -> bool | float:
    if isinstance(error, Problem) and error.status in ASK_AGAIN:
        return True
    return worth_retrying(repeatable=True)(error)
