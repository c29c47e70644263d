"""Servers that tests of several folders share; nothing is started before a test asks for it."""

import shutil
from collections.abc import Iterator
from itertools import count
from pathlib import Path

import pytest
import sqlalchemy
from scanjobs.migrate import upgrade

from tests.stack.servers import Postgres, Redis

numbers = count()


@pytest.fixture(scope="session")
def postgres() -> Iterator[Postgres]:
    """One cluster for all tests; each has its own database."""
    server = Postgres()
    server.start()
    yield server
    server.stop()
    server.remove()


@pytest.fixture
def redis() -> Iterator[Redis]:
    """A Redis of the test's own: what one test leaves in it must not reach another."""
    server = Redis()
    server.start()
    yield server
    server.stop()


@pytest.fixture
def database_url(postgres: Postgres) -> str:
    """An empty database on PostgreSQL."""
    return new_database(postgres, "template1")


@pytest.fixture(scope="session")
def migrated_postgres(postgres: Postgres) -> str:
    """Name of a database with every table, to be copied."""
    upgrade(new_database(postgres, "template1", "migrated"))
    return "migrated"


@pytest.fixture(scope="session")
def migrated_sqlite(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An SQLite file with every table, to be copied."""
    path = tmp_path_factory.mktemp("migrated") / "nerfmodal.db"
    upgrade(f"sqlite:///{path}")
    return path


def new_database(postgres: Postgres, template: str, name: str | None = None) -> str:
    """Copy a database; the URL of the copy."""
    name = name or f"test_{next(numbers)}"
    engine = sqlalchemy.create_engine(postgres.url, isolation_level="AUTOCOMMIT")
    with engine.connect() as connection:
        connection.execute(sqlalchemy.text(f"CREATE DATABASE {name} TEMPLATE {template}"))
    engine.dispose()
    return postgres.database(name)


def copy_database(migrated: Path, data_folder: Path) -> None:
    """Put a migrated SQLite file where a service with this data folder looks for it."""
    data_folder.mkdir(parents=True, exist_ok=True)
    shutil.copy(migrated, data_folder / "nerfmodal.db")
