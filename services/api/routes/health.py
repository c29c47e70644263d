"""Whether the process lives, and whether it can do what it is asked: the second one looks before it answers."""

from fastapi import APIRouter, Response
from scanjobs import health

from services.api.dependencies import TheParts
from services.api.schemas import Health

router = APIRouter(tags=["health"])


@router.get("/healthz")
def alive() -> Health:
    """The process answers; says nothing about what it depends on."""
    return Health(status="ok")


@router.get("/readyz", responses={503: {"model": Health}})
def ready(parts: TheParts, response: Response) -> Health:
    """Whether the database has this version's tables and the artifact store takes files; 503 names what does not.

    `degraded` with 200: scans are taken and kept, but no step begins while the broker is silent or the disk is full.
    """
    found = health.look(parts.settings, parts.store, health.NEEDED_BY_API)
    if found.status == "unavailable":
        response.status_code = 503
        response.headers["Retry-After"] = "5"
    return Health(status=found.status, checks=dict(found.checks))
