"""Connections that PostgreSQL has closed, and many threads that want one."""

import threading
import time

import pytest
from scanjobs.store import CONNECTIONS, TRUSTED_S, Store, open_store
from sqlalchemy import text
from sqlalchemy.exc import OperationalError


def kill_all(database_url: str) -> None:
    """End every other backend of the database, as a restart does."""
    other = open_store(database_url)
    others = "datname = current_database() AND pid <> pg_backend_pid()"
    kill = f"SELECT pg_terminate_backend(pid) FROM pg_stat_activity WHERE {others}"
    with other.read() as session:
        session.execute(text(kill)).all()
    other.close()


def number(store: Store) -> int:
    with store.read() as session:
        return int(session.execute(text("SELECT 1")).scalar_one())


def test_connection_that_died_while_idle_is_replaced_unseen(database_url: str) -> None:
    """Guard: the question at checkout. Seen to fail: without it the first statement raises `OperationalError`."""
    store = open_store(database_url)
    assert number(store) == 1
    time.sleep(TRUSTED_S)
    kill_all(database_url)
    assert number(store) == 1
    store.close()


def test_connection_that_died_a_moment_ago_costs_one_error_and_no_more(database_url: str) -> None:
    store = open_store(database_url)
    assert number(store) == 1
    kill_all(database_url)
    with pytest.raises(OperationalError):
        number(store)
    assert number(store) == 1
    store.close()


def test_more_threads_than_connections_take_turns(database_url: str) -> None:
    store = open_store(database_url)
    answers: list[int] = []
    threads = [
        threading.Thread(target=lambda: answers.extend(number(store) for _ in range(5))) for _ in range(3 * CONNECTIONS)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(answers) == 15 * CONNECTIONS
    store.close()
