"""A service of toy steps in a folder of its own: SQLite, the in-memory broker, real runner processes."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from scanjobs.settings import Settings

from tests.integration.toy_service import TOYS, Service, serving


@pytest.fixture
def settings(tmp_path: Path) -> Settings:
    """A short lease, quick ticks, two slots, toys."""
    return Settings(
        data_folder=tmp_path / "data", tasks=TOYS, slots=2, lease_s=4.0, tick_s=0.2, watch_s=0.1, resend_s=3.0
    )


@pytest.fixture
def service(settings: Settings) -> Iterator[Service]:
    """A running toy service; the database is sound when the test ends."""
    with serving(settings) as running:
        yield running
        assert running.violations() == ()
