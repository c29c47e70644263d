"""One service per test, in a folder of its own."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from scanjobs.artifacts import ArtifactStore
from scanjobs.settings import Settings
from scanjobs.store import open_store
from starlette.testclient import TestClient

from services.api.app import create_app
from tests.conftest import copy_database
from tests.unit.api.service import Service


@pytest.fixture
def service(tmp_path: Path, migrated_sqlite: Path) -> Iterator[Service]:
    captures = tmp_path / "captures"
    captures.mkdir()
    settings = Settings(data_folder=tmp_path / "data", capture_roots=(captures,))
    copy_database(migrated_sqlite, settings.data_folder)
    store = open_store(settings.database)
    artifacts = ArtifactStore(settings.artifacts)
    app = create_app(settings, store, artifacts)
    with TestClient(app, raise_server_exceptions=False) as http:
        yield Service(http=http, settings=settings, store=store, artifacts=artifacts, folder=tmp_path)
    store.close()
