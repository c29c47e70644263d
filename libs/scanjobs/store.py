"""Engines and transactions, and the manners of the two SQL dialects.

SQLite: writers begin with BEGIN IMMEDIATE (a plain BEGIN fails with "database is locked" when it turns into a
writer), readers are in autocommit. SQLite 3.7.0 to 3.51.2 can corrupt a database in WAL mode, so these versions
journal with TRUNCATE. Every write is tried again, after a random pause, when another one was in its way.
"""

import logging
import random
import sqlite3
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final, TypeVar

from sqlalchemy import URL, Connection, Engine, create_engine, event, func, make_url, select
from sqlalchemy.exc import DBAPIError, DisconnectionError, OperationalError
from sqlalchemy.orm import Session
from sqlalchemy.pool import ConnectionPoolEntry

T = TypeVar("T")
Work = Callable[[Session], T]

FIRST_SQLITE_WITH_SOUND_WAL: Final = (3, 51, 3)
BUSY_S: Final = 30.0
TRIES: Final = 6
FROZEN_MS: Final = 30_000
"""PostgreSQL breaks a transaction that has said nothing for so long: a process that is frozen or cut off in the middle
of one would hold its rows from everybody else."""
LOCK_SPACE: Final = 0x6E6D
"""First half of every advisory lock of this program on PostgreSQL."""
CONNECTIONS: Final = 16
"""Of one process to PostgreSQL, at most."""
TRUSTED_S: Final = 1.0
"""A connection that was used so lately is taken to be alive."""
USED_AT: Final = "scanjobs_used_at"
READ_ONLY: Final = "scanjobs_read_only"
TRANSIENT_SQLSTATES: Final = frozenset({"40001", "40P01", "55P03"})
"""PostgreSQL: serialization failure, deadlock, lock not available."""

log = logging.getLogger(__name__)


class Store:
    """One database: short sessions to read, and functions that are run in a transaction to write."""

    def __init__(self, engine: Engine) -> None:
        self.engine = engine
        self._reader = engine.execution_options(**{READ_ONLY: True})

    @property
    def dialect(self) -> str:
        """`sqlite` or `postgresql`."""
        return self.engine.dialect.name

    @contextmanager
    def read(self) -> Iterator[Session]:
        """A session to look with; what it loaded stays usable after it."""
        with Session(self._reader, expire_on_commit=False, autoflush=False) as session:
            yield session

    def write(self, work: Work[T]) -> T:
        """Run `work` in one transaction and commit; it may be run several times, so it does nothing but SQL."""
        for tried in range(1, TRIES + 1):
            try:
                with Session(self.engine, expire_on_commit=False) as session, session.begin():
                    return work(session)
            except DBAPIError as error:
                if tried == TRIES or not is_transient(error):
                    raise
                time.sleep(random.uniform(0.01, 0.05) * 2**tried)
        raise AssertionError("unreachable: the last try returns or raises")

    def close(self) -> None:
        """Give all connections back."""
        self.engine.dispose()


def open_store(database_url: str) -> Store:
    """A store with its own engine: make one per process, after any fork."""
    url = make_url(database_url)
    if url.get_backend_name() == "sqlite":
        return Store(_sqlite_engine(database_url))
    if url.drivername == "postgresql":
        url = url.set(drivername="postgresql+psycopg")
    return Store(_postgres_engine(url))


def one_at_a_time(session: Session, number: int) -> None:
    """Until this transaction ends no other one gets past the same number; SQLite has one writer anyway."""
    if session.get_bind().dialect.name == "postgresql":
        session.execute(select(func.pg_advisory_xact_lock(LOCK_SPACE, number)))


@contextmanager
def together(session: Session) -> Iterator[None]:
    """Statements of this block, whose results nobody may look at, travel in one round trip (PostgreSQL's pipeline).

    Raises SQLAlchemy's DBAPIError for the first that was refused, when the block ends.
    """
    if session.get_bind().dialect.name != "postgresql":
        yield
        return
    driver: Any = session.connection().connection.driver_connection
    dialect = session.get_bind().dialect
    errors = dialect.loaded_dbapi.Error
    try:
        with driver.pipeline():
            yield
    except errors as error:  # as if SQLAlchemy itself had heard it
        raise DBAPIError.instance("one of several", None, error, errors, dialect=dialect) from error


def is_transient(error: DBAPIError) -> bool:
    """Whether another transaction was in the way, so that the same one may succeed now."""
    if getattr(error.orig, "sqlstate", None) in TRANSIENT_SQLSTATES:
        return True
    return isinstance(error, OperationalError) and "locked" in str(error.orig)


def journal_mode(version: tuple[int, ...] = sqlite3.sqlite_version_info) -> str:
    """The journal that this version of SQLite can be trusted with."""
    return "WAL" if version >= FIRST_SQLITE_WITH_SOUND_WAL else "TRUNCATE"


def _postgres_engine(url: URL) -> Engine:
    """Connections that are kept, not opened anew under load; asked whether they live when they were idle for a while.

    Asking every time costs three round trips, a quarter of a short transaction.
    """
    options = {"options": f"-c idle_in_transaction_session_timeout={FROZEN_MS}"}
    engine = create_engine(url, pool_size=CONNECTIONS, max_overflow=0, connect_args=options)

    def note(_: Any, record: ConnectionPoolEntry) -> None:
        record.info[USED_AT] = time.monotonic()

    def ask(connection: Any, record: ConnectionPoolEntry, _: object) -> None:
        if time.monotonic() - record.info.get(USED_AT, time.monotonic()) < TRUSTED_S:
            return
        try:
            engine.dialect.do_ping(connection)
        except engine.dialect.dbapi.Error as error:  # type: ignore[union-attr]
            raise DisconnectionError("it was closed while it was idle") from error  # the pool opens another one

    event.listen(engine, "checkin", note)
    event.listen(engine, "checkout", ask)
    return engine


def _sqlite_engine(url: str) -> Engine:
    database = make_url(url).database
    if database:
        Path(database).parent.mkdir(parents=True, exist_ok=True)
    engine = create_engine(url, connect_args={"timeout": BUSY_S, "check_same_thread": False})
    event.listen(engine, "connect", _prepare_sqlite)
    event.listen(engine, "begin", _begin_on_sqlite)
    log.info("SQLite %s, journal %s", sqlite3.sqlite_version, journal_mode())
    return engine


def _prepare_sqlite(connection: Any, record: object) -> None:  # noqa: ARG001
    connection.isolation_level = None  # this module begins transactions, not the driver
    for pragma in (f"journal_mode={journal_mode()}", "synchronous=FULL", "foreign_keys=ON"):
        connection.execute(f"PRAGMA {pragma}").close()


def _begin_on_sqlite(connection: Connection) -> None:
    if not connection.get_execution_options().get(READ_ONLY):
        connection.exec_driver_sql("BEGIN IMMEDIATE")
