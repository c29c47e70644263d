"""What the service says, as frozen values. Times are UTC; units stand in the names, as in the JSON.

A key that a newer service adds is ignored: an old client reads a new service.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from datetime import datetime
from typing import Any

from scanclient.errors import ScanCanceled, ScanFailed

TERMINAL = frozenset({"succeeded", "failed", "canceled"})
"""Status words after which nothing moves unless the scan is retried."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StepProgress:
    """How far one kind of step is, in steps: `frame.train` of 60 frames has a total of 61."""

    step: str
    done: int
    total: int
    running: int
    failed: int
    fraction: float

    @classmethod
    def parse(cls, body: dict[str, Any]) -> "StepProgress":
        return cls(
            step=body["step"],
            done=body["done"],
            total=body["total"],
            running=body["running"],
            failed=body["failed"],
            fraction=body["fraction"],
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class ScanFailure:
    """Why a scan failed; `retryable` says whether the same scan may succeed when tried again."""

    step: str
    code: str
    message: str
    hint: str | None
    retryable: bool

    @classmethod
    def parse(cls, body: dict[str, Any]) -> "ScanFailure":
        return cls(
            step=body["step"],
            code=body["code"],
            message=body["message"],
            hint=body.get("hint"),
            retryable=body["retryable"],
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Scan:
    """A scan as the service knows it. `progress` and `spec` are empty in lists."""

    id: str
    name: str
    status: str
    source: str
    plant: str | None
    tags: tuple[str, ...]
    generation: int
    created_at: datetime
    started_at: datetime | None
    finished_at: datetime | None
    eta_s: float | None
    progress: tuple[StepProgress, ...]
    error: ScanFailure | None
    spec: dict[str, Any]
    client: Any = field(default=None, repr=False, compare=False)
    """Who it was asked of, and whom `wait` asks again."""

    def wait(
        self,
        *,
        on_progress: "Callable[[Scan], None] | None" = None,
        poll_s: float = 1.0,
        timeout_s: float | None = None,
    ) -> Any:
        """`Client.wait` of this scan; of an `AsyncClient` it is awaited.

        Raises
        ------
        ScanFailed, ScanCanceled, WaitTimedOut
        """
        return self.client.wait(self.id, on_progress=on_progress, poll_s=poll_s, timeout_s=timeout_s)

    @property
    def is_over(self) -> bool:
        """Whether the scan succeeded, failed or was canceled."""
        return self.status in TERMINAL

    @classmethod
    def parse(cls, body: dict[str, Any]) -> "Scan":
        error = body.get("error")
        return cls(
            id=body["id"],
            name=body["name"],
            status=body["status"],
            source=body["source"],
            plant=body.get("plant"),
            tags=tuple(body["tags"]),
            generation=body["generation"],
            created_at=datetime.fromisoformat(body["created_at"]),
            started_at=_instant(body.get("started_at")),
            finished_at=_instant(body.get("finished_at")),
            eta_s=body.get("eta_s"),
            progress=tuple(StepProgress.parse(row) for row in body.get("progress") or ()),
            error=ScanFailure.parse(error) if error else None,
            spec=body.get("spec") or {},
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Page:
    """One page of scans; `next_cursor` is opaque and None on the last page."""

    items: tuple[Scan, ...]
    next_cursor: str | None

    @classmethod
    def parse(cls, body: dict[str, Any]) -> "Page":
        return cls(items=tuple(Scan.parse(item) for item in body["items"]), next_cursor=body["next_cursor"])


@dataclass(frozen=True, slots=True, kw_only=True)
class Artifact:
    """A file of a scan: `name` is its relative path, `size` in bytes."""

    name: str
    step: str
    role: str
    size: int
    sha256: str
    media_type: str

    @classmethod
    def parse(cls, body: dict[str, Any]) -> "Artifact":
        return cls(
            name=body["name"],
            step=body["step"],
            role=body["role"],
            size=body["size"],
            sha256=body["sha256"],
            media_type=body["media_type"],
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Upload:
    """A file on its way to the service; `received` bytes are safely there, `sha256` is known once all are."""

    id: str
    name: str
    length: int
    received: int
    complete: bool
    sha256: str | None

    @classmethod
    def parse(cls, body: dict[str, Any]) -> "Upload":
        keys = ("id", "name", "length", "received", "complete", "sha256")
        return cls(**{key: body[key] for key in keys})


@dataclass(frozen=True, slots=True, kw_only=True)
class Capture:
    """Pictures or clouds that the service holds; `source` goes into a specification."""

    id: str
    name: str
    kind: str
    source: dict[str, str]
    files: int
    size: int
    facts: dict[str, Any]

    @classmethod
    def parse(cls, body: dict[str, Any]) -> "Capture":
        keys = ("id", "name", "kind", "source", "files", "size", "facts")
        return cls(**{key: body[key] for key in keys})


@dataclass(frozen=True, slots=True, kw_only=True)
class LogLine:
    """A line that a step wrote; `id` is where to go on from."""

    id: int
    step: str | None
    frame: int | None
    level: str
    text: str
    at: datetime | None

    @classmethod
    def parse(cls, body: dict[str, Any]) -> "LogLine":
        return cls(
            id=body["id"],
            step=body["step"],
            frame=body["frame"],
            level=body["level"],
            text=body["text"],
            at=_instant(body["at"]),
        )


def bound(scan: Scan, client: Any) -> Scan:
    """The same scan, asked of this client."""
    return replace(scan, client=client)


def succeeded(scan: Scan) -> Scan:
    """The scan, if it ended well. Raises `ScanFailed` or `ScanCanceled`."""
    if scan.status == "failed":
        raise ScanFailed(scan)
    if scan.status == "canceled":
        raise ScanCanceled(scan)
    return scan


def is_result(artifact: Artifact) -> bool:
    """Whether a file is a result, or the truth of a simulation, and no frame, checkpoint or cloud."""
    return artifact.step == "scan.identify" or artifact.role == "truth"


def _instant(text: str | None) -> datetime | None:
    return datetime.fromisoformat(text) if text else None
