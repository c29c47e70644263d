"""What a process needs, looked at now: each look says `ok` or, in a few words without addresses, what is wrong.

The API needs the database and the artifacts. Without the broker or with a full disk it still answers and its answers
are still durable, so that is `degraded`: to take it out of service would turn a delay into a failure.
"""

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final, Literal

import redis
from sqlalchemy import text
from sqlalchemy.exc import SQLAlchemyError

from scanjobs.disk import is_low
from scanjobs.errors import DatabaseOutOfDate
from scanjobs.migrate import check_current
from scanjobs.settings import Settings
from scanjobs.store import Store

OK: Final = "ok"
BROKER_PATIENCE_S: Final = 1.0
NEEDED_BY_API: Final = frozenset({"database", "tables", "artifacts"})
NEEDED_BY_WORKER: Final = frozenset({"database", "tables", "artifacts", "broker"})
Status = Literal["ok", "degraded", "unavailable"]


@dataclass(frozen=True, slots=True)
class Health:
    """What was found; `status` is `unavailable` where something that is needed is wrong."""

    status: Status
    checks: Mapping[str, str]


def look(settings: Settings, store: Store, needed: frozenset[str]) -> Health:
    """Look at everything; a database that does not answer is not asked for its tables."""
    checks = {"database": _words(lambda: _database(store))}
    checks["tables"] = _words(lambda: _tables(store)) if checks["database"] == OK else "unknown"
    checks["artifacts"] = _artifacts(settings)
    checks["broker"] = _broker(settings.broker_url)
    checks["disk"] = "nearly full: no step is begun" if is_low(settings) else OK
    wrong = {name for name, words in checks.items() if words != OK}
    return Health("unavailable" if wrong & needed else "degraded" if wrong else "ok", checks)


def _database(store: Store) -> str:
    with store.read() as session:
        session.execute(text("SELECT 1"))
    return OK


def _tables(store: Store) -> str:
    try:
        check_current(store)
    except DatabaseOutOfDate as error:
        return error.message
    return OK


def _artifacts(settings: Settings) -> str:
    return OK if os.access(settings.artifacts, os.W_OK | os.X_OK) else "the folder cannot be written to"


def _broker(url: str) -> str:
    """Whether Redis answers; a broker in this process always does, and others are asked when something is sent."""
    if not url.startswith(("redis:", "rediss:")):
        return OK
    try:
        with redis.Redis.from_url(
            url, socket_timeout=BROKER_PATIENCE_S, socket_connect_timeout=BROKER_PATIENCE_S, retry=None
        ) as client:
            client.ping()
    except (redis.RedisError, OSError):
        return "it does not answer: steps wait"
    return OK


def _words(check: Callable[[], str]) -> str:
    """What the check says, or that it failed; reasons may hold addresses and stay in the log of the database."""
    try:
        return check()
    except SQLAlchemyError:
        return "it cannot be reached"
