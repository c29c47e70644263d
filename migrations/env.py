"""Alembic's environment: the tables of scanjobs, on SQLite and PostgreSQL, each revision in one transaction."""

from alembic import context
from scanjobs.settings import Settings
from scanjobs.store import LOCK_SPACE, open_store
from scanjobs.tables import Base
from sqlalchemy import Connection, func, select

MIGRATING = 2


def run() -> None:
    """Migrate the database of the caller, or of the settings."""
    store = open_store(context.config.attributes.get("database_url") or Settings().database)
    try:
        with store.engine.connect() as connection:
            migrate(connection)
    finally:
        store.close()


def migrate(connection: Connection) -> None:
    """Run the revisions; on SQLite with foreign keys unchecked, because batches rebuild whole tables."""
    on_sqlite = connection.dialect.name == "sqlite"
    if on_sqlite:
        connection.connection.driver_connection.execute("PRAGMA foreign_keys=OFF")
    else:  # let go of when this connection is closed; another process waits here
        connection.execute(select(func.pg_advisory_lock(LOCK_SPACE, MIGRATING)))
        connection.commit()
    context.configure(
        connection=connection,
        target_metadata=Base.metadata,
        render_as_batch=on_sqlite,
        transactional_ddl=True,
        transaction_per_migration=True,
        compare_type=True,
    )
    with context.begin_transaction():
        context.run_migrations()


run()
