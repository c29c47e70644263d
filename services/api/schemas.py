"""What the API says, as pydantic models: they are the OpenAPI document. Times are RFC 3339 UTC, units in the names."""

from datetime import UTC, datetime
from typing import Any, Literal, cast

from nerfmodal.spec import ScanSpec
from pydantic import BaseModel, Field
from scanjobs.repository import KindSummary, StoredFile
from scanjobs.states import ScanState
from scanjobs.step_times import StepTimes
from scanjobs.tables import Scan, Step, Worker

Status = Literal["queued", "running", "succeeded", "failed", "canceled"]
STATES_OF: dict[Status, tuple[ScanState, ...]] = {
    "queued": (ScanState.UPLOADING, ScanState.QUEUED),
    "running": (ScanState.RUNNING, ScanState.PAUSED, ScanState.CANCELING),
    "succeeded": (ScanState.SUCCEEDED,),
    "failed": (ScanState.FAILED,),
    "canceled": (ScanState.CANCELED, ScanState.DELETING),
}
STATUS_OF: dict[ScanState, Status] = {state: status for status, states in STATES_OF.items() for state in states}


class Complaint(BaseModel):
    """One of several things that are wrong."""

    pointer: str
    detail: str
    hint: str


class Problem(BaseModel):
    """RFC 9457, with what this service adds."""

    type: str
    title: str
    status: int
    detail: str
    instance: str
    code: str = Field(description="Stable; programs may depend on it.")
    pointer: str | None = Field(description="JSON pointer of the bad field of the body.")
    hint: str | None = Field(description="What to change.")
    request_id: str
    errors: list[Complaint] = Field(default=[], description="All complaints, where the first is not the only one.")


class StepProgress(BaseModel):
    """How far the steps of one kind are."""

    step: str
    done: int
    total: int
    running: int
    failed: int
    fraction: float = Field(description="Of the steps' work, what running steps have reported included; 0 to 1.")

    @classmethod
    def of(cls, row: KindSummary) -> "StepProgress":
        return cls(
            step=row.kind,
            done=row.done,
            total=row.total,
            running=row.running,
            failed=row.failed,
            fraction=round(row.fraction, 4),
        )


class Failure(BaseModel):
    """Why a scan or step failed."""

    step: str | None = None
    code: str
    message: str
    hint: str | None = None
    retryable: bool = False


class ScanSummary(BaseModel):
    """A scan in a list."""

    id: str
    name: str
    status: Status
    state: str = Field(description="The exact state; `status` puts the passing ones (paused, canceling) in five words.")
    paused_for: str | None = Field(description="Of a paused scan: asked, disk_low or quota.")
    source: str
    plant: str | None
    tags: list[str]
    generation: int = Field(description="Grows with every retry, from 0.")
    created_at: datetime
    started_at: datetime | None
    finished_at: datetime | None
    progress: list[StepProgress]
    error: Failure | None

    @classmethod
    def of(cls, scan: Scan, progress: tuple[KindSummary, ...]) -> "ScanSummary":
        return cls(**_fields(scan, progress))


class ScanDetail(ScanSummary):
    """A scan by itself: with its specification and the seconds it may still take."""

    eta_s: float | None = Field(description="Seconds left at the present pace; null while it is unknown.")
    spec: dict[str, Any]

    @classmethod
    def of(cls, scan: Scan, progress: tuple[KindSummary, ...], eta_s: float | None = None) -> "ScanDetail":
        return cls(**_fields(scan, progress), eta_s=eta_s, spec=scan.spec)


class ScanPage(BaseModel):
    """Scans, the newest first."""

    items: list[ScanSummary]
    next_cursor: str | None = Field(description="Opaque; null on the last page.")


class StepDetail(BaseModel):
    """One step; frame -1 is the whole scan."""

    id: str
    step: str
    frame: int
    state: str
    attempt: int
    done: int
    total: int
    message: str
    error: Failure | None
    facts: dict[str, Any] | None = Field(description="What the step says of its result: PSNR, points, frames.")
    started_at: datetime | None = Field(description="Of the last attempt.")
    finished_at: datetime | None
    waited_s: float | None = Field(
        description="Seconds that it could have been computed and was in no slot; null before it could."
    )
    run_s: float | None = Field(description="Seconds of the attempt that counts; null where there is none.")
    lost_s: float = Field(
        description="Seconds of attempts that came to nothing: failed, given back, or their worker was lost."
    )

    @classmethod
    def of(cls, row: Step, times: StepTimes) -> "StepDetail":
        return cls(
            id=row.id,
            step=row.kind,
            frame=row.frame,
            state=row.state,
            attempt=row.attempt,
            done=row.progress_done,
            total=row.progress_total,
            message=row.progress_message,
            error=Failure.model_validate(row.error) if row.error else None,
            facts=row.facts,
            started_at=instant(row.started_at),
            finished_at=instant(row.finished_at),
            waited_s=times.waited_s,
            run_s=times.run_s,
            lost_s=times.lost_s,
        )


class ArtifactDetail(BaseModel):
    """A file of a scan."""

    name: str = Field(description="Relative path; the last part of the file's address.")
    step: str
    frame: int
    role: str
    size: int
    sha256: str
    media_type: str

    @classmethod
    def of(cls, name: str, row: StoredFile) -> "ArtifactDetail":
        return cls(
            name=name,
            step=row.kind,
            frame=row.frame,
            role=row.role,
            size=row.size,
            sha256=row.digest,
            media_type=row.media_type,
        )


class ArtifactList(BaseModel):
    """Every file the present generation has made."""

    items: list[ArtifactDetail]


class ModeShape(BaseModel):
    """A mode shape at (a choice of) the sensors; see modes.json for its normalisation."""

    organ: str
    natural_frequency_hz: float | None
    positions_m: list[tuple[float, float, float]]
    directions: list[tuple[float, float, float]]
    shape: list[list[float]] = Field(description="Per sensor one component along each of `directions`.")


class Preset(BaseModel):
    """A specification to start from."""

    name: str
    spec: ScanSpec


class PresetList(BaseModel):
    """The specifications the service ships with."""

    items: list[Preset]


class PresentWorker(BaseModel):
    """A worker that has not said goodbye."""

    id: str
    state: Literal["active", "paused", "draining"]
    host: str
    queues: list[str]
    slots: int
    started_at: datetime | None

    @classmethod
    def of(cls, row: Worker) -> "PresentWorker":
        state, queues = cast("Literal['active', 'paused', 'draining']", row.state), row.queues.split(",")
        started_at = instant(row.started_at)
        return cls(id=row.id, state=state, host=row.host, queues=queues, slots=row.slots, started_at=started_at)


class WorkerList(BaseModel):
    """The workers of the service."""

    items: list[PresentWorker]


class WorkerDetail(BaseModel):
    """A worker that is alive."""

    host: str
    queues: list[str]
    slots: int


class Info(BaseModel):
    """What this service is."""

    name: str = "nerfmodal"
    version: str
    database: str
    broker: str
    workers: list[WorkerDetail]


class Health(BaseModel):
    """Whether the process answers, or what it lacks to be ready."""

    status: Literal["ok", "degraded", "unavailable"]
    checks: dict[str, str] = {}


def instant(seconds: float | None) -> datetime | None:
    """Seconds since 1970 as UTC."""
    return None if seconds is None else datetime.fromtimestamp(seconds, UTC)


def _fields(scan: Scan, progress: tuple[KindSummary, ...]) -> dict[str, Any]:
    return {
        "id": scan.id,
        "name": scan.name,
        "status": STATUS_OF[ScanState(scan.state)],
        "state": scan.state,
        "paused_for": scan.paused_for,
        "source": scan.source_kind,
        "plant": scan.plant,
        "tags": [row.tag for row in scan.tags],
        "generation": scan.generation,
        "created_at": instant(scan.created_at),
        "started_at": instant(scan.started_at),
        "finished_at": instant(scan.finished_at),
        "progress": [StepProgress.of(row) for row in progress],
        "error": scan.error,
    }
