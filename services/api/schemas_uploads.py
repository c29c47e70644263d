"""What the API says of uploads and captures."""

from datetime import datetime
from typing import Annotated, Any, Literal

from pydantic import BaseModel, Field, model_validator
from scanjobs.account_tables import Capture, Upload

from services.api.schemas import instant
from services.api.schemas_access import Asked, Name

Kind = Literal["capture", "clouds"]
MOST_FILES = 50_000


class UploadDetail(BaseModel):
    """A file on its way in."""

    id: str
    name: str
    media_type: str
    length: int
    received: int = Field(description="Bytes that are safely on disk.")
    complete: bool
    sha256: str | None = Field(description="Of the whole file, once it is complete.")
    created_at: datetime
    expires_at: datetime

    @classmethod
    def of(cls, row: Upload) -> "UploadDetail":
        return cls.model_validate(
            {
                "id": row.id,
                "name": row.name,
                "media_type": row.media_type,
                "length": row.length,
                "received": row.received,
                "complete": row.state == "complete",
                "sha256": row.digest,
                "created_at": instant(row.created_at),
                "expires_at": instant(row.expires_at),
            }
        )


class UploadPage(BaseModel):
    """Uploads, the newest first."""

    items: list[UploadDetail]
    next_cursor: str | None = Field(description="Opaque; null on the last page.")


class CaptureFile(Asked):
    """An upload, and what it is called in the capture."""

    upload: Annotated[str, Field(min_length=36, max_length=36)]
    name: Annotated[str, Field(min_length=1, max_length=200)] | None = None


class CaptureRequest(Asked):
    """A capture of `files`, or of the zip file that one upload is."""

    name: Name = "capture"
    kind: Kind = "capture"
    files: Annotated[list[CaptureFile], Field(min_length=1, max_length=MOST_FILES)] | None = None
    archive: Annotated[str, Field(min_length=36, max_length=36)] | None = None

    @model_validator(mode="after")
    def _one_of_both(self) -> "CaptureRequest":
        if (self.files is None) == (self.archive is None):
            raise ValueError("files: either files or archive is needed; give one of both")
        return self


class CaptureDetail(BaseModel):
    """Pictures or clouds that were sent in and looked at."""

    id: str
    name: str
    kind: Kind
    source: dict[str, str] = Field(description="What a specification says to use it.")
    files: int
    size: int
    sha256: str = Field(description="Of the list of the files' digests and names, as sha256sum writes it.")
    facts: dict[str, Any] = Field(description="What was counted: pictures, cameras, frames, clouds.")
    created_at: datetime

    @classmethod
    def of(cls, row: Capture) -> "CaptureDetail":
        return cls.model_validate(
            {
                "id": row.id,
                "name": row.name,
                "kind": row.kind,
                "source": {"kind": row.kind, "path": f"capture:{row.id}"},
                "files": row.files,
                "size": row.size,
                "sha256": row.digest,
                "facts": row.facts or {},
                "created_at": instant(row.created_at),
            }
        )


class CapturePage(BaseModel):
    """Captures, the newest first."""

    items: list[CaptureDetail]
    next_cursor: str | None = Field(description="Opaque; null on the last page.")
