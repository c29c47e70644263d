"""One service per test, in a folder of its own."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from alembic.migration import MigrationContext
from alembic.script import ScriptDirectory
from scanjobs import migrate
from scanjobs.artifacts import ArtifactStore
from scanjobs.settings import Settings
from scanjobs.store import Store, open_store
from scanjobs.tables import Base
from starlette.testclient import TestClient

from services.api.app import create_app
from tests.unit.api.service import Service


@pytest.fixture
def service(tmp_path: Path) -> Iterator[Service]:
    captures = tmp_path / "captures"
    captures.mkdir()
    settings = Settings(data_folder=tmp_path / "data", capture_roots=(captures,))
    store = open_store(settings.database)
    Base.metadata.create_all(store.engine)
    mark_current(store)
    artifacts = ArtifactStore(settings.artifacts)
    app = create_app(settings, store, artifacts)
    with TestClient(app, raise_server_exceptions=False) as http:
        yield Service(http=http, settings=settings, store=store, artifacts=artifacts, folder=tmp_path)
    store.close()


def mark_current(store: Store) -> None:
    """Say that the tables are those of the newest revision, which takes a second less than running every revision."""
    script = ScriptDirectory.from_config(migrate._config(""))
    with store.engine.begin() as connection:
        MigrationContext.configure(connection).stamp(script, "head")
