"""Fault 16: commits fail, are slow, or succeed without their answer arriving."""

import random
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import pytest
from scanjobs.artifacts import ArtifactStore, Stored
from scanjobs.settings import Settings
from scanjobs.store import Store
from scanjobs.tables import ArtifactRef, Scan
from sqlalchemy import select
from sqlalchemy.exc import OperationalError
from sqlalchemy.orm import Session

from tests.faults.steps import assert_whole, can_write
from tests.integration.toy_service import Service, serving, toy_spec

T = TypeVar("T")


class Treacherous:
    """`Store.write`, of which every tenth fails before its commit, every tenth after it, and every tenth is slow."""

    def __init__(self, write: Callable[..., object]) -> None:
        self._write = write
        self._chance = random.Random(16)
        self._lock = threading.Lock()
        self.is_calm = False
        self.failed = self.unanswered = 0

    def as_method(self) -> Callable[[Store, Callable[[Session], T]], object]:
        """What takes the place of `Store.write`."""

        def write(store: Store, work: Callable[[Session], T]) -> object:
            return self(store, work)

        return write

    def __call__(self, store: Store, work: Callable[[Session], T]) -> object:
        """Write, or not, or without saying so."""
        with self._lock:
            fate = 1.0 if self.is_calm else self._chance.random()
        if fate < 0.1:
            self.failed += 1
            raise OperationalError("COMMIT", {}, Exception("the commit failed"))
        if fate < 0.2:
            time.sleep(0.5)
        result = self._write(store, work)
        if 0.2 <= fate < 0.3:
            self.unanswered += 1
            raise OperationalError("COMMIT", {}, Exception("the connection broke before the answer came"))
        return result


def test_commits_that_fail_or_are_not_answered_double_nothing(
    settings: Settings, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A claim, a dispatch or an ending that was committed is written again, or its row is taken back by time.

    Guards: an ending is written until it is answered, and the second time finds itself done (`Supervisor._write`,
    `leases._owned`); a claim without its answer is reaped; a dispatch without its message is taken back.
    Seen to fail: with `unclaimed_steps` returning nothing the unpublished steps stay `sent`; with `overdue_steps`
    returning nothing a claim whose answer was lost stays running.
    """
    quick = settings.model_copy(update={"lease_s": 2.0, "resend_s": 1.0, "max_attempts": 20})
    treacherous = Treacherous(Store.write)
    with serving(quick) as service:
        scan_ids = [service.submit(toy_spec(frames=3, seed=seed)) for seed in range(2)]
        monkeypatch.setattr(Store, "write", treacherous.as_method())
        for scan_id in scan_ids:
            assert_whole(service, scan_id, 90)
        treacherous.is_calm = True
    assert treacherous.failed
    assert treacherous.unanswered


def test_commit_waits_for_the_bytes(settings: Settings, monkeypatch: pytest.MonkeyPatch) -> None:
    """Small files are synced while their rows are written; no row is seen before its file is there.

    Guard: `kept.result()` in `Supervisor._accept`. Seen to fail: without it rows are there before the file is.
    """
    early: list[str] = []
    take = ArtifactStore.take

    def slow(store: ArtifactStore, source: Path, stored: Stored) -> None:
        time.sleep(0.3)
        with service.store.read() as session:
            early.extend(session.scalars(select(ArtifactRef.digest).where(ArtifactRef.digest == stored.digest)))
        take(store, source, stored)

    monkeypatch.setattr(ArtifactStore, "take", slow)
    with serving(settings) as service:
        assert_whole(service, service.submit(toy_spec(frames=2)))
    assert early == []


def test_no_transaction_waits_for_a_store_that_is_far(settings: Settings, monkeypatch: pytest.MonkeyPatch) -> None:
    """An upload may hang; while it does others hold the scan's row, and the lease is kept.

    Guard: `is_near` in `Supervisor._begin_to_keep`. Seen to fail: without it the row is held while the file travels.
    """
    held: list[str] = []
    scan_ids: list[str] = []
    take = ArtifactStore.take

    def far(store: ArtifactStore, source: Path, stored: Stored) -> None:
        while not scan_ids:
            time.sleep(0.01)
        time.sleep(0.3)
        try:
            service.wait(lambda: is_free(service, scan_ids[0]), 2.0)
        except TimeoutError:
            held.append(stored.digest)
        take(store, source, stored)

    monkeypatch.setattr(ArtifactStore, "is_near", False)
    monkeypatch.setattr(ArtifactStore, "take", far)
    with serving(settings) as service:
        scan_ids.append(service.submit(toy_spec(frames=1)))
        assert_whole(service, scan_ids[0])
    assert held == []


def is_free(service: Service, scan_id: str) -> bool:
    """Whether no transaction holds the scan's row at this moment; SQLite has one lock for all."""
    if service.store.dialect == "sqlite":
        return can_write(service.settings)
    with service.store.read() as session:
        query = select(Scan.id).where(Scan.id == scan_id).with_for_update(skip_locked=True)
        return session.scalars(query).first() is not None
