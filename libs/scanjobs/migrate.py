"""Bring a database up to date with the revisions in `migrations/`."""

import fcntl
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from alembic import command
from alembic.config import Config
from alembic.migration import MigrationContext
from alembic.script import ScriptDirectory
from sqlalchemy import make_url

from scanjobs.errors import DatabaseOutOfDate
from scanjobs.store import Store

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


def check_current(store: Store) -> None:
    """Raise `DatabaseOutOfDate` unless the database is at the newest revision."""
    newest = ScriptDirectory.from_config(_config("")).get_current_head()
    with store.engine.connect() as connection:
        present = MigrationContext.configure(connection).get_current_revision()
    if present != newest:
        raise DatabaseOutOfDate(
            f"the database is at revision {present or 'none'}, this version needs {newest}.",
            hint="Run `nerfmodal migrate` with the same NERFMODAL_DATABASE_URL.",
        )


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
