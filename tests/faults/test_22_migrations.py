"""Fault 22: migrations base → head → base → head with data in them, on both engines, killed in the middle."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from alembic.autogenerate import compare_metadata
from alembic.migration import MigrationContext
from alembic.script import ScriptDirectory
from scanjobs import migrate, repository
from scanjobs.migrate import check_current, downgrade, upgrade
from scanjobs.store import Store, open_store
from scanjobs.tables import Base
from sqlalchemy import inspect, text

from tests.integration.toy_service import toy_spec

KILLED = """
import os, signal, sys
from sqlalchemy import event
from sqlalchemy.engine import Engine
from scanjobs.migrate import {way}

left = int(sys.argv[1])

@event.listens_for(Engine, "after_cursor_execute")
def die_in_the_middle(connection, cursor, statement, *_):
    global left
    if statement.lstrip().split(" ")[0] in ("CREATE", "ALTER", "INSERT", "DROP", "UPDATE"):
        left -= 1
        if left == 0:
            os.kill(os.getpid(), signal.SIGKILL)

{way}({url!r}, {target!r})
"""
OLD_ROWS = (
    "INSERT INTO scan (id, owner, root_id, name, source_kind, spec, spec_digest, state, generation, priority, version,"
    " cancel_seq, max_failed_frames, created_at)"
    " VALUES ('old', 'local', 'old', 'n', 'simulation', '{}', 'd', 'succeeded', 0, 0, 0, 0, 0, 1.0)",
    "INSERT INTO step (id, scan_id, kind, frame, generation, queue, depth, state, deps_left, fresh, attempt, token,"
    " progress_done, progress_total, progress_message, created_at)"
    " VALUES ('step', 'old', 'frame.train', -1, 0, 'train', 1, 'succeeded', 0, {false}, 1, 1, 0, 0, '', 1.0)",
)


@pytest.fixture(params=["sqlite", "postgresql"])
def url(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """An empty database."""
    if request.param == "sqlite":
        return f"sqlite:///{tmp_path / 'test.db'}"
    chosen: str = request.getfixturevalue("database_url")
    return chosen


def test_data_survives_upgrades_that_are_killed(url: str) -> None:
    """Rows of the first revision are there, with their values, after upgrades killed at every few statements.

    Guard: each revision is one transaction (`migrations/env.py`, `store._begin_on_sqlite`).
    Seen to fail: with every statement committed at once (`transactional_ddl=False`, and AUTOCOMMIT on PostgreSQL, no
    BEGIN on SQLite) the next upgrade fails at what is there already.
    """
    upgrade(url, "0001")
    store = open_store(url)
    write_old_rows(store)
    kills = 0
    for statements in (1, 9, 22, 33, 37):
        kills += killed(url, "upgrade", "head", statements)
        assert old_rows(store) == ("succeeded", "train") if revision_of(store) < "0004" else ("succeeded", "train-cpu")
    assert kills >= 3, "the upgrade had ended before it could be killed"
    upgrade(url)
    check_current(store)
    assert_as_declared(store)
    assert old_rows(store) == ("succeeded", "train-cpu")
    assert killed(url, "downgrade", "0001", 3)
    downgrade(url, "0001")
    assert old_rows(store) == ("succeeded", "train")
    store.close()


def test_up_down_and_up_again_with_data(url: str) -> None:
    """Guard: every revision undoes what it does. Seen to fail: with a `downgrade` that leaves the tables of 0004
    the second way up fails, because they exist.
    """
    for _ in range(2):
        upgrade(url)
        store = open_store(url)
        assert_as_declared(store)
        store.write(lambda session: repository.insert_scan(session, toy_spec()))
        with store.read() as session:
            assert len(repository.list_scans(session).items) == 1
        store.close()
        downgrade(url, "base")
    store = open_store(url)
    assert set(inspect(store.engine).get_table_names()) <= {"alembic_version"}
    store.close()


def test_there_is_one_newest_revision() -> None:
    """Two branches would leave an upgrade with a choice."""
    assert len(ScriptDirectory.from_config(migrate._config("")).get_heads()) == 1


def killed(url: str, way: str, target: str, statements: int) -> bool:
    """Migrate in a process that dies after so many changing statements; False when it ended before."""
    program = KILLED.format(way=way, url=url, target=target)
    process = subprocess.run([sys.executable, "-c", program, str(statements)], env=os.environ, check=False)
    assert process.returncode in (0, -signal.SIGKILL)
    return process.returncode != 0


def write_old_rows(store: Store) -> None:
    """A scan and a step, as the first version wrote them."""
    false = "0" if store.dialect == "sqlite" else "false"
    with store.engine.begin() as connection:
        for statement in OLD_ROWS:
            connection.execute(text(statement.replace("{false}", false)))


def old_rows(store: Store) -> tuple[str, str]:
    """State of the scan and queue of the step."""
    with store.engine.connect() as connection:
        state = connection.execute(text("SELECT state FROM scan WHERE id = 'old'")).scalar_one()
        queue = connection.execute(text("SELECT queue FROM step WHERE id = 'step'")).scalar_one()
    return str(state), str(queue)


def revision_of(store: Store) -> str:
    """Where the database stands."""
    with store.engine.connect() as connection:
        return MigrationContext.configure(connection).get_current_revision() or ""


def assert_as_declared(store: Store) -> None:
    """The tables are those of the models."""
    with store.engine.connect() as connection:
        context = MigrationContext.configure(connection, opts={"compare_type": True})
        assert compare_metadata(context, Base.metadata) == []
