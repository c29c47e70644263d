"""What an operator asks of the database: the commands, and what they change."""

import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from scanjobs import repository, workers
from scanjobs.messages import QUEUES
from scanjobs.migrate import upgrade
from scanjobs.settings import Settings
from scanjobs.store import Store, open_store
from scanjobs.tables import Step
from scanjobs.workers import WorkerIdentity
from sqlalchemy import update

from services.cli.worker import known_queues
from tests.integration.toy_service import toy_spec
from tests.unit.cli.conftest import Call


@pytest.fixture
def store(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Store]:
    """A database with a scan and two workers, where the commands look for it."""
    monkeypatch.setenv("NERFMODAL_DATA_FOLDER", str(tmp_path / "data"))
    url = Settings().database
    upgrade(url)
    opened = open_store(url)
    opened.write(lambda session: repository.insert_scan(session, toy_spec()))
    for name in ("aaa", "abb"):
        one = WorkerIdentity(id=name, host="here", pid=1, queues=QUEUES, slots=2)
        opened.write(lambda session, who=one: workers.register(session, who, 60.0))
    yield opened
    opened.close()


def states(call: Call) -> dict[str, str]:
    """By worker, as the command tells."""
    done = call("workers", "list", "--json")
    assert done.exit_code == 0
    return {row["id"]: row["state"] for row in json.loads(done.stdout)}


@pytest.mark.usefixtures("store")
def test_workers_are_paused_resumed_and_drained(call: Call) -> None:
    assert states(call) == {"aaa": "active", "abb": "active"}
    assert call("workers", "pause", "all").exit_code == 0
    assert call("workers", "resume", "ab").exit_code == 0
    assert states(call) == {"aaa": "paused", "abb": "active"}
    assert call("workers", "drain", "aaa").exit_code == 0
    assert states(call) == {"aaa": "draining", "abb": "active"}
    assert "abb" in call("workers", "list").stdout


@pytest.mark.usefixtures("store")
@pytest.mark.parametrize("name", ["a", "zzz"])
def test_name_that_is_not_one_worker_is_3(call: Call, name: str) -> None:
    done = call("workers", "pause", name)
    assert done.exit_code == 3
    assert "workers list" in done.stderr


def test_fsck_says_what_is_wrong_by_its_exit_code(call: Call, store: Store) -> None:
    assert call("fsck").exit_code == 0
    wrong = update(Step).where(Step.state == "pending").values(deps_left=Step.deps_left + 1)
    store.write(lambda session: session.execute(wrong))
    done = call("fsck", "--json")
    assert done.exit_code == 1
    assert "waits for" in json.loads(done.stdout)["violations"][0]


def test_train_is_short_for_both_queues_of_trainings() -> None:
    assert known_queues("train,extract") == ("train-cpu", "train-gpu", "extract")
