"""Whether the process lives, and whether it can do what it is asked: the second one looks before it answers."""

import os
from collections.abc import Callable

from fastapi import APIRouter, Response
from scanjobs.tables import Scan
from sqlalchemy import select
from sqlalchemy.exc import SQLAlchemyError

from services.api.dependencies import Parts, TheParts
from services.api.schemas import Health

router = APIRouter(tags=["health"])
OK = "ok"


@router.get("/healthz")
def alive() -> Health:
    """The process answers; says nothing about what it depends on."""
    return Health(status="ok")


@router.get("/readyz", responses={503: {"model": Health}})
def ready(parts: TheParts, response: Response) -> Health:
    """Whether the database has the tables and the artifact folder takes files; 503 names what does not."""
    checks = {"database": _database(parts), "artifacts": _artifacts(parts)}
    if all(check == OK for check in checks.values()):
        return Health(status="ok", checks=checks)
    response.status_code = 503
    response.headers["Retry-After"] = "5"
    return Health(status="unavailable", checks=checks)


def _database(parts: Parts) -> str:
    def look() -> str:
        with parts.store.read() as session:
            session.execute(select(Scan.id).limit(1)).all()
        return OK

    return _words_of(look)


def _artifacts(parts: Parts) -> str:
    folder = parts.artifacts.folder
    return OK if os.access(folder, os.W_OK | os.X_OK) else "the folder cannot be written to"


def _words_of(look: Callable[[], str]) -> str:
    """What the check says, or that it failed; reasons stay in the log, they may hold addresses."""
    try:
        return look()
    except SQLAlchemyError:
        return "it cannot be reached, or its tables are not those of this version"
