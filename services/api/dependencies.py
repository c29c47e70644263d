"""What routes are given: the parts of the service, the caller and what he may do, and the scan that a path names."""

from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import Annotated
from uuid import UUID

from fastapi import Depends, Path, Request
from scanjobs.artifacts import ArtifactStore
from scanjobs.errors import NotFound
from scanjobs.repository import LOCAL_OWNER
from scanjobs.scopes import Principal, Scope
from scanjobs.settings import Settings
from scanjobs.store import Store

from services.api.cursors import Cursors
from services.api.errors import RequestRefused
from services.api.intake import Intake
from services.api.news import News


@dataclass(frozen=True, slots=True, kw_only=True)
class Parts:
    """What `create_app` was made with."""

    settings: Settings
    store: Store
    artifacts: ArtifactStore
    cursors: Cursors
    news: News
    intake: Intake


async def parts_of(request: Request) -> Parts:
    """The parts of the app that the request came to."""
    parts = request.app.state.parts
    assert isinstance(parts, Parts)
    return parts


async def principal_of(request: Request) -> Principal:
    """Who the doorkeeper let in."""
    principal = request.state.principal
    assert isinstance(principal, Principal)
    return principal


ThePrincipal = Annotated[Principal, Depends(principal_of)]


async def current_owner(request: Request) -> str:
    """Whose scans the request may see."""
    return (await principal_of(request)).owner


def owner_who_may(scope: Scope) -> Callable[[Request, str], Awaitable[str]]:
    """The owner, if the key may do this; 403 otherwise."""

    async def allowed(request: Request, owner: Annotated[str, Depends(current_owner)]) -> str:
        principal = await principal_of(request)
        if not principal.may(scope):
            detail = f"This API key lacks the scope '{scope}'."
            raise RequestRefused(403, "FORBIDDEN", detail, hint=f"Use a key that has '{scope}'.")
        return owner

    return allowed


async def operator_of(owner: Annotated[str, Depends(owner_who_may(Scope.ADMIN))]) -> str:
    """The owner, if he runs the service: an `admin` key of another owner is master of that owner alone."""
    if owner != LOCAL_OWNER:
        detail = "This is for the operator of the service."
        raise RequestRefused(403, "FORBIDDEN", detail, hint=f"Use a key of the owner '{LOCAL_OWNER}' with 'admin'.")
    return owner


async def scan_id_of(scan_id: Annotated[str, Path(description="Id of a scan.")]) -> str:
    """The id in the path; what is no id cannot be found."""
    return uuid_of(scan_id, "scan", "GET /v1/scans")


def uuid_of(text: str, what: str, where: str) -> str:
    """An id as the database writes it. Raises `NotFound` for what is none."""
    try:
        return str(UUID(text))
    except ValueError as error:
        raise NotFound(f"there is no such {what}.", hint=f"List yours with {where}.") from error


TheParts = Annotated[Parts, Depends(parts_of)]
Owner = Annotated[str, Depends(owner_who_may(Scope.READ))]
Submitter = Annotated[str, Depends(owner_who_may(Scope.SUBMIT))]
Administrator = Annotated[str, Depends(owner_who_may(Scope.ADMIN))]
Operator = Annotated[str, Depends(operator_of)]
ScanId = Annotated[str, Depends(scan_id_of)]
