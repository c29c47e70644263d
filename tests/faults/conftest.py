"""Every fault on SQLite and the in-memory broker, and on PostgreSQL and Redis; the database has its tables already."""

from pathlib import Path

import pytest
from scanjobs.settings import Settings

from tests.conftest import copy_database, new_database
from tests.integration.toy_service import toy_settings
from tests.stack.servers import Postgres, Redis


@pytest.fixture
def embedded(tmp_path: Path, migrated_sqlite: Path) -> Settings:
    """Toys on SQLite and the in-memory broker."""
    settings = toy_settings(tmp_path)
    copy_database(migrated_sqlite, settings.data_folder)
    return settings


@pytest.fixture
def served(tmp_path: Path, postgres: Postgres, migrated_postgres: str, redis: Redis) -> Settings:
    """Toys on PostgreSQL and Redis."""
    url = new_database(postgres, migrated_postgres)
    return toy_settings(tmp_path).model_copy(update={"database_url": url, "broker_url": redis.url})


@pytest.fixture(params=["embedded", "served"])
def settings(request: pytest.FixtureRequest) -> Settings:
    """Toys on either pair."""
    chosen: Settings = request.getfixturevalue(request.param)
    return chosen
