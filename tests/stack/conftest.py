"""A real PostgreSQL and a real Redis, and a toy service on them."""

from collections.abc import Iterator
from itertools import count
from pathlib import Path

import pytest
import sqlalchemy
from scanjobs.settings import Settings

from tests.integration.toy_service import toy_settings
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
    """An empty database."""
    name = f"test_{next(numbers)}"
    engine = sqlalchemy.create_engine(postgres.url, isolation_level="AUTOCOMMIT")
    with engine.connect() as connection:
        connection.execute(sqlalchemy.text(f"CREATE DATABASE {name}"))
    engine.dispose()
    return postgres.database(name)


@pytest.fixture
def settings(tmp_path: Path, database_url: str, redis: Redis) -> Settings:
    """Toys on PostgreSQL and Redis."""
    servers = {"database_url": database_url, "broker_url": redis.url}
    return toy_settings(tmp_path).model_copy(update=servers)
