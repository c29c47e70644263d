"""Bring a database up to date with the revisions in `migrations/`."""

from pathlib import Path

from alembic import command
from alembic.config import Config

REPOSITORY = Path(__file__).resolve().parents[2]
INSTALLED = Path(__file__).resolve().parent / "migrations"


def upgrade(database_url: str, revision: str = "head") -> None:
    """Migrate up; a new SQLite file gets every table."""
    command.upgrade(_config(database_url), revision)


def downgrade(database_url: str, revision: str) -> None:
    """Migrate down to a revision; `base` leaves nothing."""
    command.downgrade(_config(database_url), revision)


def _config(database_url: str) -> Config:
    folder = INSTALLED if INSTALLED.is_dir() else REPOSITORY / "migrations"
    config = Config()
    config.set_main_option("script_location", str(folder))
    config.attributes["database_url"] = database_url
    return config
