"""A toy service on a real PostgreSQL and a real Redis."""

from pathlib import Path

import pytest
from scanjobs.settings import Settings

from tests.integration.toy_service import toy_settings
from tests.stack.servers import Redis


@pytest.fixture
def settings(tmp_path: Path, database_url: str, redis: Redis) -> Settings:
    """Toys on PostgreSQL and Redis."""
    servers = {"database_url": database_url, "broker_url": redis.url}
    return toy_settings(tmp_path).model_copy(update=servers)
