"""What a claim is, what it is worth, and how an attempt ends; the rows are `leases`' business."""

from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Final, NamedTuple

from scanjobs.given import InputFile
from scanjobs.tables import Scan
from scanjobs.transitions import EventRow


@dataclass(frozen=True, slots=True, kw_only=True)
class Claim:
    """The right to compute one step once, and all that is needed for it."""

    step_id: str
    scan_id: str
    token: int
    attempt: int
    kind: str
    frame: int
    spec: dict[str, Any]
    inputs: tuple[InputFile, ...]
    traceparent: str | None = None
    """Of the request that the step comes from."""
    resume: str | None = None
    """Digest of what an earlier attempt has saved on its way."""
    device: str | None = None
    """The GPU that this claim has for itself (`gpu:0`)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Failure:
    """Why an attempt failed, in the words that the user reads."""

    code: str
    message: str
    hint: str | None = None
    retryable: bool = True
    counted: bool = True
    """False where the step is not to blame: a full disk."""
    exit_code: int | None = None
    damaged: str | None = None
    """Digest of an input that is not what it was; the step that made it is no longer kept by a retry."""


WORKER_LOST: Final = Failure(
    code="LEASE_EXPIRED",
    message="the worker that computed this step was not heard of any more.",
    hint="If it happens again, look at that machine's memory and log, then retry the scan.",
)


class RunnerNote(NamedTuple):
    """Which process computes a claim, and where it logs."""

    pid: int
    log_key: str


class Begun(NamedTuple):
    """A claim, and the event that is still to be recorded."""

    claim: Claim
    worker_id: str
    event: EventRow


class Ended(NamedTuple):
    """The held scan of a step that has ended, and the events still to be recorded."""

    scan: Scan
    events: list[EventRow]


class Standing(StrEnum):
    """What a claim is worth now."""

    HELD = "held"
    LOST = "lost"
    CANCELED = "canceled"
