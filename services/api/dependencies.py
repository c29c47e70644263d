"""What routes are given: the parts of the service, the caller, and the scan that a path names."""

from dataclasses import dataclass
from typing import Annotated
from uuid import UUID

from fastapi import Depends, Path, Request
from scanjobs.artifacts import ArtifactStore
from scanjobs.errors import NotFound
from scanjobs.repository import LOCAL_OWNER
from scanjobs.settings import Settings
from scanjobs.store import Store


@dataclass(frozen=True, slots=True, kw_only=True)
class Parts:
    """What `create_app` was made with."""

    settings: Settings
    store: Store
    artifacts: ArtifactStore


def parts_of(request: Request) -> Parts:
    """The parts of the app that the request came to."""
    parts = request.app.state.parts
    assert isinstance(parts, Parts)
    return parts


def current_owner() -> str:
    """Whose scans the request may see. Bearer keys plug in here; until then everybody is the local owner."""
    return LOCAL_OWNER


def scan_id_of(scan_id: Annotated[str, Path(description="Id of a scan.")]) -> str:
    """The id in the path; what is no id cannot be found."""
    try:
        return str(UUID(scan_id))
    except ValueError as error:
        raise NotFound("there is no such scan.", hint="List your scans with GET /v1/scans.") from error


TheParts = Annotated[Parts, Depends(parts_of)]
Owner = Annotated[str, Depends(current_owner)]
ScanId = Annotated[str, Depends(scan_id_of)]
