"""`nerfmodal demo-fleet` and `plants …` against a service of the same folder."""

import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from scanclient import Client
from scanjobs.artifacts import ArtifactStore
from scanjobs.settings import Settings
from scanjobs.store import open_store
from typer.testing import CliRunner

from services.api.app import create_app
from services.cli.main import app
from tests.unit.api.live import live

run = CliRunner()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A data folder with a fleet of six."""
    data = tmp_path_factory.mktemp("data")
    done = run.invoke(
        app, ["demo-fleet", "--plants", "6", "--scans", "18", "--full", "0", "--data", str(data), "--json"]
    )
    assert done.exit_code == 0, done.output
    assert json.loads(done.stdout)["scans"] == 108
    return data


@pytest.fixture(scope="module")
def address(folder: Path) -> Iterator[str]:
    settings = Settings(data_folder=folder)
    store = open_store(settings.database)
    with live(create_app(settings, store, ArtifactStore(settings.artifacts))) as listening:
        yield listening
    store.close()


def json_of(*words: str) -> list[dict[str, object]]:
    done = run.invoke(app, ["plants", *words, "--json"])
    assert done.exit_code == 0, done.output
    found: list[dict[str, object]] = json.loads(done.stdout)
    return found


def test_seeding_twice_makes_nothing_more_and_removing_removes(tmp_path: Path) -> None:
    words = ["demo-fleet", "--plants", "1", "--scans", "3", "--full", "0", "--data", str(tmp_path), "--json"]
    assert [json.loads(run.invoke(app, words).stdout)["plants"] for _ in range(2)] == [1, 0]
    assert json.loads(run.invoke(app, [*words, "--remove"]).stdout) == {"removed": 1}


def test_plants_are_listed_filtered_and_shown(address: str) -> None:
    every = json_of("list", "--sort", "-ratio", "--url", address)
    assert len(every) == 6
    ratios = [row["ratio"] for row in every]
    assert ratios == sorted(ratios, reverse=True)  # type: ignore[type-var]
    assert {row["treatment"] for row in json_of("list", "--treatment", "drought", "--url", address)} == {"drought"}
    shown = run.invoke(app, ["plants", "show", "demo-001", "--url", address])
    assert "leaf_0 · 1" in shown.output


def test_tables_and_crates_are_written_by_their_ending(address: str, tmp_path: Path) -> None:
    for name, begins in (("a.csv", b"plant,"), ("a.parquet", b"PAR1"), ("a.zip", b"PK")):
        assert run.invoke(app, ["plants", "export", str(tmp_path / name), "--url", address]).exit_code == 0
        assert (tmp_path / name).read_bytes().startswith(begins)
    assert run.invoke(app, ["plants", "export", str(tmp_path / "a.xls"), "--url", address]).exit_code == 3


def test_the_client_reads_writes_and_corrects(address: str) -> None:
    with Client(address) as client:
        made = client.plants.add("fern", {"treatment": "wet"})
        assert (made.id, made.treatment, made.last_status) == ("fern", "wet", None)
        assert client.plants.change("fern", {"treatment": None}).treatment is None
        assert client.plants.store_environment("at,mass_g\n2026-01-01T06:00:00Z,5\n", "fern") == 1
        client.plants.add_event("fern", "note", note="new")
        assert client.plants.history("fern")["events"][0]["note"] == "new"
        track = client.plants.tracks("demo-001")[0]
        assert {"bent"} <= {one.name for one in client.plants.correct(track.id, {"name": "bent"})}
        for alarm in client.plants.alarms(state=["open"]):
            assert client.plants.settle_alarm(alarm.id, "acknowledged", "seen").note == "seen"
        assert list(client.plants.alarms(state=["open"])) == []
