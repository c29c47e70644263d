"""Bring a database up to date with the revisions in `migrations/`."""

import fcntl
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from alembic import command
from alembic.config import Config
from sqlalchemy import make_url

REPOSITORY = Path(__file__).resolve().parents[2]
INSTALLED = Path(__file__).resolve().parent / "migrations"


def upgrade(database_url: str, revision: str = "head") -> None:
    """Migrate up; a new SQLite file gets every table. Two processes that start together migrate one after the other."""
    with _alone(database_url):
        command.upgrade(_config(database_url), revision)


def downgrade(database_url: str, revision: str) -> None:
    """Migrate down to a revision; `base` leaves nothing."""
    with _alone(database_url):
        command.downgrade(_config(database_url), revision)


@contextmanager
def _alone(database_url: str) -> Iterator[None]:
    """Hold back other processes that would migrate the same database; on PostgreSQL the revisions' session does."""
    database = make_url(database_url).database
    if make_url(database_url).get_backend_name() != "sqlite" or not database:
        yield
        return
    Path(database).parent.mkdir(parents=True, exist_ok=True)
    with Path(f"{database}.migrating").open("a") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield


def _config(database_url: str) -> Config:
    folder = INSTALLED if INSTALLED.is_dir() else REPOSITORY / "migrations"
    config = Config()
    config.set_main_option("script_location", str(folder))
    config.attributes["database_url"] = database_url
    return config
