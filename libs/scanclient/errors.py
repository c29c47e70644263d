"""What can go wrong between a program and the service.

::

    ScanClientError
     ├─ ConnectionFailed        the service was not reached, or the connection broke, after all retries
     ├─ Problem                 the service answered with a problem (RFC 9457); carries its code
     │   ├─ InvalidRequest      400, 413, 415, 422: correct what `pointer` names
     │   ├─ NotAllowed          401, 403
     │   ├─ NotFound            404
     │   ├─ Conflict            409: the scan's state forbids it
     │   ├─ TooManyRequests     429, after all retries; `retry_after_s` says when to go on
     │   ├─ NoRoom              507: the owner's quota or the disk is used up
     │   └─ ServiceFailed       5xx
     ├─ ScanFailed              a scan that was waited for failed; `scan.error` says where and why
     ├─ ScanCanceled            a scan that was waited for was canceled
     ├─ WaitTimedOut            the scan goes on, the patience is over
     ├─ BrokenUpload            a file changed while it was sent
     └─ BrokenDownload          a file differs from its digest, or its name leaves the folder
"""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from scanclient.values import Scan


class ScanClientError(Exception):
    """The base of everything this package raises."""


class ConnectionFailed(ScanClientError):
    """The service was not reached; check the address and that the service runs (`nerfmodal up`)."""


class Problem(ScanClientError):
    """The service refused or failed; `code` is stable, `hint` says what to change.

    Attributes
    ----------
    status : HTTP status.
    code : stable word, for instance ``"INVALID_SPEC"``.
    detail : one sentence.
    pointer : JSON pointer of the bad field, where there is one.
    hint : the remedy, where there is one.
    request_id : what the operator finds in the log.
    retry_after_s : seconds after which it may be tried again, where the service says so.
    """

    def __init__(self, status: int, body: dict[str, Any], retry_after_s: float | None = None) -> None:
        self.status = status
        self.retry_after_s = retry_after_s
        self.code: str = str(body.get("code") or f"HTTP_{status}")
        self.detail: str = str(body.get("detail") or body.get("title") or "The service gave no reason.")
        self.pointer: str | None = body.get("pointer")
        self.hint: str | None = body.get("hint")
        self.request_id: str | None = body.get("request_id")
        super().__init__(str(self))

    def __str__(self) -> str:
        place = f"{self.pointer}: " if self.pointer else ""
        remedy = f" {self.hint}" if self.hint else ""
        return f"{place}{self.detail}{remedy} [{self.code}]"


class InvalidRequest(Problem):
    """The request cannot be used; correct what `pointer` names."""


class NotAllowed(Problem):
    """The key is missing, revoked, or lacks the scope."""


class NotFound(Problem):
    """There is no such scan, mode or file for this owner."""


class Conflict(Problem):
    """The scan's state forbids what was asked."""


class TooManyRequests(Problem):
    """The key's rate is used up; go on after `retry_after_s`."""


class NoRoom(Problem):
    """The owner's quota or the service's disk is used up; delete what is not needed."""


class ServiceFailed(Problem):
    """The service failed or is overloaded; try again, and quote `request_id` if it stays."""


class ScanFailed(ScanClientError):
    """The scan failed; `scan.error` names the step, the reason and the remedy."""

    def __init__(self, scan: "Scan") -> None:
        reason = f"{scan.error.step}: {scan.error.message} {scan.error.hint or ''}" if scan.error else "no reason given"
        super().__init__(f"scan {scan.id} failed at {reason}".rstrip())
        self.scan = scan


class ScanCanceled(ScanClientError):
    """The scan was canceled before it ended."""

    def __init__(self, scan: "Scan") -> None:
        super().__init__(f"scan {scan.id} was canceled")
        self.scan = scan


class WaitTimedOut(ScanClientError):
    """The scan did not end in the time given; it goes on in the service."""


class BrokenUpload(ScanClientError):
    """What arrived is not what lies on disk: the file changed while it was sent; send it again."""


class BrokenDownload(ScanClientError):
    """What arrived is not what the service holds; the file was removed, download it again."""


KINDS: Mapping[int, type[Problem]] = {
    401: NotAllowed,
    403: NotAllowed,
    404: NotFound,
    409: Conflict,
    429: TooManyRequests,
    507: NoRoom,
}


def problem(status: int, body: dict[str, Any], retry_after_s: float | None = None) -> Problem:
    """The exception that fits an answer's status."""
    default = ServiceFailed if status >= 500 else InvalidRequest
    return KINDS.get(status, default)(status, body, retry_after_s)
