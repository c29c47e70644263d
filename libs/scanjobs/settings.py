"""Every setting of the service, from `NERFMODAL_…` variables; read once, at the edge, and handed down.

The defaults are the embedded service: SQLite and files in `data_folder`, the broker in this process.
"""

import os
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, field_validator
from pydantic_settings import BaseSettings, NoDecode, SettingsConfigDict

NO_LIMIT = 2**62
Seconds = Annotated[float, Field(gt=0)]


class Settings(BaseSettings):
    """The settings; times in seconds."""

    model_config = SettingsConfigDict(env_prefix="NERFMODAL_", frozen=True, extra="ignore")

    data_folder: Path = Path(".nerfmodal")
    database_url: str = ""
    """SQLAlchemy URL; empty is an SQLite file in `data_folder`."""
    broker_url: str = "memory://localhost/"
    artifact_folder: Path | None = None
    """Where artifacts lie; None is `data_folder`/artifacts."""
    artifact_url: str | None = None
    """An object store, such as `s3://bucket/prefix`, for the artifacts; `artifact_folder` is then a cache of it."""
    artifact_cache_mb: Annotated[int, Field(ge=0)] = 10_000
    capture_roots: Annotated[tuple[Path, ...], NoDecode] = (Path(),)
    """Folders that captures and clouds may be read from; in the variable separated as in PATH."""

    keyless: bool | None = None
    """Whether callers on this machine need no API key; by default only under `nerfmodal up`. Never behind a proxy."""
    requests_per_minute: Annotated[int, Field(ge=1)] = 6000
    """Of one key in one process; a key may have a limit of its own."""
    webhooks_to_private_addresses: bool = False
    """Whether webhooks may go to addresses that are not on the public internet."""
    smtp_url: Annotated[str, Field(pattern=r"^((smtp|smtps|smtp\+starttls)://.+)?$")] = ""
    """The server that sends e-mail, such as `smtp+starttls://user:password@mail.example.org:587`; empty: none."""
    smtp_from: str = ""
    """The sender of e-mail; by default nerfmodal@localhost."""
    upload_limit_mb: Annotated[int, Field(ge=1)] = 20_000
    """Of one uploaded file."""
    owner_quota_mb: Annotated[int, Field(ge=1)] = 200_000
    """Of all uploads and captures of one owner."""
    archive_limit_mb: Annotated[int, Field(ge=1)] = 50_000
    """Of an archive's members together, unpacked."""
    archive_members: Annotated[int, Field(ge=1)] = 50_000
    upload_expires_s: Seconds = 7 * 24 * 3600.0
    """An upload that was not made into a capture is forgotten after this long."""

    slots: Annotated[int, Field(ge=1)] = Field(default_factory=lambda: os.cpu_count() or 1)
    """Steps computed at the same time by one worker."""
    threads_per_runner: Annotated[int, Field(ge=1)] = 1
    tasks: str = "services.worker.tasks"
    """Python module whose TASKS maps each kind of step to a function."""

    lease_s: Seconds = 60.0
    """A running step not heard of for this long is given to somebody else."""
    tick_s: Seconds = 0.7
    """How often each worker looks for ready steps and expired leases."""
    watch_s: Seconds = 0.5
    """How often a running step is checked for a cancel and reports its progress."""
    resend_s: Seconds = 30.0
    """A sent step that nobody claimed is sent again after this long."""
    max_attempts: Annotated[int, Field(ge=1)] = 3
    runner_steps: Annotated[int, Field(ge=1)] = 50
    """A runner is replaced after this many steps."""
    runner_idle_s: Seconds = 60.0
    """An idle runner ends after this long and gives its memory back."""
    stop_grace_s: Seconds = 1.5
    """From asking a runner to stop to killing it."""
    step_limit_s: Seconds = 6 * 3600.0
    """A step that computes for longer has failed."""
    disk_low_mb: Annotated[int, Field(ge=0)] = 200
    """With less room left no step is begun and no scan is taken."""
    scan_quota_mb: Annotated[int, Field(ge=0)] = 0
    """Of the files that one owner's scans have made; 0 is no limit, an owner's own quota goes before it."""
    gpus: Annotated[int, Field(ge=0)] = Field(default_factory=lambda: len(list(Path("/dev").glob("nvidia[0-9]*"))))
    """GPUs of this machine; each computes one training at a time."""
    keep_checkpoints_days: Annotated[float, Field(ge=0)] = 30.0
    """After a scan has succeeded its checkpoints are kept for so long; results are kept until they are deleted."""
    collect_every_s: Seconds = 6 * 3600.0
    """How often one of the workers removes files that nothing refers to."""
    save_every_s: Seconds = 30.0
    """A training saves its state so often: what is lost with its worker is at most this much work."""
    drain_s: Seconds = 12.0
    """From SIGTERM to giving up on a clean end."""

    log_format: Literal["text", "json"] = "text"
    log_level: Literal["debug", "info", "warning", "error"] = "info"
    metrics_port: Annotated[int, Field(ge=0, le=65535)] = 0
    """Where a worker answers /metrics, /healthz and /readyz; 0: nowhere. The API answers them at its own port."""
    otlp_url: str = ""
    """Where OpenTelemetry traces go (OTLP over HTTP); empty: nowhere."""

    @field_validator("capture_roots", mode="before")
    @classmethod
    def _split_roots(cls, value: object) -> object:
        return tuple(part for part in value.split(os.pathsep) if part) if isinstance(value, str) else value

    @property
    def database(self) -> str:
        """The database's URL, with the default filled in."""
        return self.database_url or f"sqlite:///{(self.data_folder / 'nerfmodal.db').resolve()}"

    @property
    def uploads(self) -> Path:
        """The folder of files on their way in."""
        return (self.data_folder / "uploads").resolve()

    @property
    def captures(self) -> Path:
        """The folder of captures made from uploads; workers on other machines need it too."""
        return (self.data_folder / "captures").resolve()

    @property
    def scan_quota(self) -> int:
        """Bytes of results that one owner may have."""
        return self.scan_quota_mb * 10**6 if self.scan_quota_mb else NO_LIMIT

    @property
    def artifacts(self) -> Path:
        """The folder of the artifact store."""
        return (self.artifact_folder or self.data_folder / "artifacts").resolve()
