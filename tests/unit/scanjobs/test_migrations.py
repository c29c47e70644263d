"""The revisions make exactly the tables of the models, up, down and up again with rows in them."""

import subprocess
import sys
from pathlib import Path

import pytest
from alembic import command
from alembic.autogenerate import compare_metadata
from alembic.config import Config
from alembic.migration import MigrationContext
from nerfmodal.spec import ScanSpec
from scanjobs import migrate, repository
from scanjobs.errors import DatabaseOutOfDate
from scanjobs.migrate import check_current, downgrade, upgrade
from scanjobs.store import Store, open_store
from scanjobs.tables import Base
from sqlalchemy import inspect

HALF = """
from alembic import op
import sqlalchemy as sa

revision = "9999"
down_revision = "{head}"
branch_labels = None
depends_on = None


def upgrade():
    op.create_table("half", sa.Column("id", sa.Integer, primary_key=True))
    raise RuntimeError("the power is gone")


def downgrade():
    op.drop_table("half")
"""


def test_models_and_revisions_agree(store: Store) -> None:
    with store.engine.connect() as connection:
        context = MigrationContext.configure(connection, opts={"compare_type": True})
        assert compare_metadata(context, Base.metadata) == []


def test_down_and_up_again_with_rows(tmp_path: Path, spec: ScanSpec) -> None:
    url = f"sqlite:///{tmp_path / 'test.db'}"
    for _ in range(2):
        upgrade(url)
        store = open_store(url)
        store.write(lambda session: repository.insert_scan(session, spec))
        with store.read() as session:
            assert len(repository.list_scans(session).items) == 1
        store.close()
        downgrade(url, "base")
        empty = open_store(url)
        assert set(inspect(empty.engine).get_table_names()) <= {"alembic_version"}
        empty.close()


def test_upgrading_twice_changes_nothing(store: Store, spec: ScanSpec) -> None:
    store.write(lambda session: repository.insert_scan(session, spec))
    upgrade(str(store.engine.url))
    with store.read() as session:
        assert len(repository.list_scans(session).items) == 1


def test_revision_that_fails_leaves_nothing_behind(store: Store, tmp_path: Path) -> None:
    (tmp_path / "versions").mkdir()
    (tmp_path / "versions" / "9999_half.py").write_text(HALF.format(head=head_of(store)))
    config = migrate._config(str(store.engine.url))
    folders = [Path(config.get_main_option("script_location") or "") / "versions", tmp_path / "versions"]
    config.set_main_option("path_separator", "newline")
    config.set_main_option("version_locations", "\n".join(str(folder) for folder in folders))
    with pytest.raises(RuntimeError, match="power"):
        command.upgrade(config, "9999")
    assert "half" not in inspect(store.engine).get_table_names()
    assert head_of(store) != "9999"


def head_of(store: Store) -> str:
    """The revision that the database is at."""
    with store.engine.connect() as connection:
        head = MigrationContext.configure(connection).get_current_revision()
    assert head is not None
    return head


def test_processes_that_start_together_migrate_one_after_the_other(tmp_path: Path) -> None:
    url = f"sqlite:///{tmp_path / 'test.db'}"
    program = f"from scanjobs.migrate import upgrade; upgrade({url!r})"
    processes = [subprocess.Popen([sys.executable, "-c", program]) for _ in range(4)]
    assert [process.wait(60) for process in processes] == [0, 0, 0, 0]


def test_database_of_another_version_is_refused(store: Store, tmp_path: Path) -> None:
    check_current(store)
    empty = open_store(f"sqlite:///{tmp_path / 'empty.db'}")
    with pytest.raises(DatabaseOutOfDate, match="revision none") as refusal:
        check_current(empty)
    assert "nerfmodal migrate" in (refusal.value.hint or "")
    empty.close()


def test_configuration_finds_its_scripts() -> None:
    assert isinstance(migrate._config("sqlite://"), Config)
    assert (migrate.REPOSITORY / "migrations" / "env.py").is_file()
