"""Submissions that arrive together share a transaction, and nothing else."""

import asyncio
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from nerfmodal.spec import ScanSpec
from scanjobs import intake, repository
from scanjobs.errors import IdempotencyConflict
from scanjobs.intake import Asked, Idempotency, Submission
from scanjobs.store import Store, open_store
from sqlalchemy.exc import DataError, OperationalError

from services.api.intake import Intake
from tests.conftest import copy_database
from tests.unit.api.service import simulation


@pytest.fixture
def store(tmp_path: Path, migrated_sqlite: Path) -> Iterator[Store]:
    """An empty database."""
    copy_database(migrated_sqlite, tmp_path)
    opened = open_store(f"sqlite:///{tmp_path / 'nerfmodal.db'}")
    yield opened
    opened.close()


def asked(seed: int, key: str | None = None) -> Asked:
    """A small simulation."""
    spec = ScanSpec.model_validate(simulation(seed=seed, plant={"id": f"p{seed % 3}"}, tags=["a", "b"]))
    digest = spec.digest()
    return Asked(
        spec=spec,
        document=spec.model_dump(mode="json"),
        digest=digest,
        owner="local",
        idempotency=Idempotency(key, digest) if key else None,
    )


def submit_together(store: Store, wanted: list[Asked]) -> list[Submission | BaseException]:
    """All while a first one holds the writer, so that they wait together."""
    service = Intake(store)
    holds = threading.Event()
    service._writer.submit(holds.wait)

    async def everything() -> list[Submission | BaseException]:
        waiting = [asyncio.ensure_future(service.submit(one)) for one in wanted]
        await asyncio.sleep(0)
        holds.set()
        return await asyncio.gather(*waiting, return_exceptions=True)

    answers = asyncio.run(everything())
    service.close()
    return answers


def transactions(store: Store, monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """How many submissions each transaction had, as they are made."""
    sizes: list[int] = []
    write = store.write

    def counting(work: Callable[[Any], Any]) -> Any:
        sizes.append(len(getattr(work, "keywords", {}).get("asked", ())))
        return write(work)

    monkeypatch.setattr(store, "write", counting)
    return sizes


def test_what_waits_together_is_one_transaction_and_stored_whole(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    """Guard: `MOST` in `_next_batch`.

    Seen to fail: with one at a time there are twenty transactions; without the tags or the events in `intake._insert`
    they are missing.
    """
    sizes = transactions(store, monkeypatch)
    answers = submit_together(store, [asked(seed) for seed in range(20)])
    assert sizes == [20]
    assert all(isinstance(answer, Submission) and answer.created for answer in answers)
    with store.read() as session:
        stored = {scan.id: scan for scan in repository.list_scans(session).items}
        assert len(stored) == 20
        for answer in answers:
            assert isinstance(answer, Submission)
            scan = stored[answer.scan.id]
            assert (scan.spec, scan.spec_digest) == (answer.scan.spec, answer.scan.spec_digest)
            assert [tag.tag for tag in scan.tags] == [tag.tag for tag in answer.scan.tags] == ["a", "b"]
            assert [event.to_state for event in repository.list_events(session, scan)] == ["queued"]


def test_one_key_twice_in_one_batch_is_one_scan_and_another_body_is_refused_alone(
    store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Guards: `_next_batch` takes each key once, and the digest of the body (`intake._again`).

    Seen to fail: with a key twice in a batch the database refuses it, and five transactions do the work of three;
    without the digest the other body is answered with the first one's scan.
    """
    sizes = transactions(store, monkeypatch)
    first, again, other, free = submit_together(store, [asked(1, "k"), asked(1, "k"), asked(2, "k"), asked(3)])
    assert sizes == [2, 1, 1]
    assert isinstance(first, Submission)
    assert isinstance(again, Submission)
    assert isinstance(free, Submission)
    assert isinstance(other, IdempotencyConflict)
    assert (first.created, again.created, free.created) == (True, False, True)
    assert first.scan.id == again.scan.id


def test_what_cannot_be_stored_is_refused_alone(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    """Guard: a refused batch is written one by one. Seen to fail: without it all twenty are answered with 503."""
    insert = intake.insert_asked

    def choosy(session: Any, asked: list[Asked]) -> Any:
        if any(one.spec.seed == 7 for one in asked):
            raise DataError("INSERT", {}, Exception("value too long"))
        return insert(session, asked)

    monkeypatch.setattr("services.api.intake.insert_asked", choosy)
    answers = submit_together(store, [asked(seed) for seed in range(20)])
    assert [seed for seed, answer in enumerate(answers) if not isinstance(answer, Submission)] == [7]
    assert isinstance(answers[7], DataError)


def test_lost_commit_is_told_to_all_and_nothing_is_written_twice(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whether it was committed nobody knows: the client asks again with its key. Seen to fail: tried one by one,
    every submission without a key is stored twice."""
    write = store.write

    def unanswered(work: Callable[[Any], Any]) -> Any:
        write(work)
        raise OperationalError("COMMIT", {}, Exception("the connection broke before the answer came"))

    monkeypatch.setattr(store, "write", unanswered)
    answers = submit_together(store, [asked(seed) for seed in range(5)])
    assert all(isinstance(answer, OperationalError) for answer in answers)
    with store.read() as session:
        assert len(repository.list_scans(session).items) == 5
