"""Transactions: writers that wait for each other, errors that undo, and the journal that SQLite is trusted with."""

import threading

import pytest
from scanjobs import store as store_module
from scanjobs.clock import now_s
from scanjobs.store import Store, is_transient, journal_mode
from scanjobs.tables import Artifact
from sqlalchemy import func, insert, select, text, update
from sqlalchemy.exc import OperationalError
from sqlalchemy.orm import Session


def counter(session: Session) -> None:
    """Insert a row to count with."""
    row = {"digest": "0" * 64, "size": 0, "media_type": "x", "state": "stored", "created_at": now_s()}
    session.execute(insert(Artifact).values(row))


def test_no_increment_is_lost_among_threads_and_none_has_to_be_repeated(store: Store) -> None:
    """Guard: BEGIN IMMEDIATE; after a plain BEGIN two readers cannot both become writers."""
    store.write(counter)
    begun: list[int] = []

    def increment(session: Session) -> None:
        begun.append(1)
        size = session.scalars(select(Artifact.size)).one()
        session.execute(update(Artifact).values(size=size + 1))

    def many() -> None:
        for _ in range(15):
            store.write(increment)

    threads = [threading.Thread(target=many) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    with store.read() as session:
        assert session.scalars(select(Artifact.size)).one() == 60
    assert len(begun) == 60


def test_error_in_a_write_undoes_it(store: Store) -> None:
    def half(session: Session) -> None:
        counter(session)
        raise ValueError("stop")

    with pytest.raises(ValueError, match="stop"):
        store.write(half)
    with store.read() as session:
        assert session.scalars(select(func.count()).select_from(Artifact)).one() == 0


def test_write_is_tried_again_when_another_was_in_its_way(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(store_module.time, "sleep", lambda _: None)
    tries: list[int] = []

    def locked_twice(_: Session) -> int:
        tries.append(1)
        if len(tries) < 3:
            raise OperationalError("", {}, Exception("database is locked"))
        return 7

    assert store.write(locked_twice) == 7
    assert len(tries) == 3


def test_other_errors_are_not_tried_again(store: Store) -> None:
    tries: list[int] = []

    def broken(session: Session) -> None:
        tries.append(1)
        session.execute(text("SELECT * FROM nothing"))

    with pytest.raises(OperationalError):
        store.write(broken)
    assert len(tries) == 1


def test_only_conflicts_are_transient() -> None:
    assert is_transient(OperationalError("", {}, Exception("database is locked")))
    assert not is_transient(OperationalError("", {}, Exception("no such table: x")))


def test_wal_is_used_only_where_it_is_sound() -> None:
    assert journal_mode((3, 40, 1)) == "TRUNCATE"
    assert journal_mode((3, 51, 2)) == "TRUNCATE"
    assert journal_mode((3, 51, 3)) == "WAL"


def test_database_clock_has_fractions_and_runs(store: Store) -> None:
    with store.read() as session:
        first = session.scalars(select(now_s())).one()
        second = session.scalars(select(now_s())).one()
    assert 1.7e9 < first <= second < first + 5


def test_commit_is_synced_to_the_disk(store: Store) -> None:
    with store.engine.connect() as connection:
        assert connection.execute(text("PRAGMA synchronous")).scalar() == 2
        assert connection.execute(text("PRAGMA foreign_keys")).scalar() == 1
        assert str(connection.execute(text("PRAGMA journal_mode")).scalar()).upper() == journal_mode()
