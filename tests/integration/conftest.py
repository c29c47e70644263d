"""A service of toy steps in a folder of its own: SQLite, the in-memory broker, real runner processes."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from scanjobs.settings import Settings

from tests.integration.toy_service import Service, serving, toy_settings


@pytest.fixture
def settings(tmp_path: Path) -> Settings:
    """Of a test that starts its own workers."""
    return toy_settings(tmp_path)


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    """One service for the tests of a module."""
    with serving(toy_settings(tmp_path_factory.mktemp("service"))) as service:
        yield service


@pytest.fixture
def service(running: Service) -> Iterator[Service]:
    """The running service; its database is sound when the test ends."""
    yield running
    assert running.violations() == ()
