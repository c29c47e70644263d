"""`scans upload`, `scans fork`, `scans logs` and `scans delete` against the real app."""

import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from PIL import Image
from scanjobs.artifacts import ArtifactStore
from scanjobs.migrate import upgrade
from scanjobs.settings import Settings
from scanjobs.store import open_store

from services.api.app import create_app
from tests.unit.api.live import live
from tests.unit.cli.conftest import Call


@pytest.fixture
def url(tmp_path: Path) -> Iterator[str]:
    settings = Settings(data_folder=tmp_path / "data")
    upgrade(settings.database)
    store = open_store(settings.database)
    with live(create_app(settings, store, ArtifactStore(settings.artifacts))) as address:
        yield address
    store.close()


def test_a_folder_is_sent_and_named(call: Call, url: str, tmp_path: Path) -> None:
    folder = tmp_path / "fern"
    folder.mkdir()
    Image.new("RGB", (8, 8)).save(folder / "a.png")
    sent = call("scans", "upload", folder, "--url", url)
    assert sent.exit_code == 0, sent.output
    assert sent.output.startswith("capture:")
    document = json.loads(call("scans", "upload", folder, "--url", url, "--json").output)
    assert (document["name"], document["files"]) == ("fern", 1)


def test_a_scan_is_forked_looked_into_and_forgotten(call: Call, url: str, spec: Path, tmp_path: Path) -> None:
    scan = call("scans", "submit", spec, "--url", url).output.strip()
    changes = tmp_path / "changes.yaml"
    changes.write_text("{seed: 9}")
    fork = json.loads(call("scans", "fork", scan, changes, "--url", url, "--json").output)
    assert fork["spec"]["seed"] == 9
    assert json.loads(call("scans", "logs", scan, "--url", url, "--json").output) == []
    assert call("scans", "delete", scan, "--url", url).exit_code == 1  # it has not ended
    call("scans", "cancel", scan, "--url", url)
    assert call("scans", "delete", scan, "--url", url).exit_code == 0
    assert call("scans", "show", scan, "--url", url).exit_code == 1


def test_changes_that_are_none_are_invalid_input(call: Call, url: str, tmp_path: Path) -> None:
    changes = tmp_path / "changes.yaml"
    changes.write_text("[1, 2]")
    assert call("scans", "fork", "x", changes, "--url", url).exit_code == 3
