"""PostgreSQL and Redis of one run, with databases made on demand."""

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import sqlalchemy
from scanjobs.migrate import upgrade
from scanjobs.settings import Settings

from tests.stack.servers import Postgres, Redis


@dataclass(frozen=True, slots=True)
class Servers:
    """What the groups measure against."""

    postgres: Postgres
    redis: Redis
    folder: Path

    def database(self, name: str) -> str:
        """URL of a new database with every table."""
        engine = sqlalchemy.create_engine(self.postgres.url, isolation_level="AUTOCOMMIT")
        with engine.connect() as connection:
            connection.execute(sqlalchemy.text(f"CREATE DATABASE {name}"))
        engine.dispose()
        upgrade(self.postgres.database(name))
        return self.postgres.database(name)

    def settings(self, name: str, tasks: str) -> Settings:
        """Of a service on both servers whose steps do what `tasks` says."""
        return Settings(
            data_folder=self.folder / name,
            database_url=self.database(name),
            broker_url=self.redis.url,
            tasks=tasks,
            slots=1,
        )


@contextmanager
def servers() -> Iterator[Servers]:
    """Both servers while the block runs; PostgreSQL writes through, as it does in production."""
    postgres, redis = Postgres(is_synced=True), Redis()
    postgres.start()
    redis.start()
    try:
        with tempfile.TemporaryDirectory(prefix="nerfmodal-bench-") as folder:
            yield Servers(postgres, redis, Path(folder))
    finally:
        redis.stop()
        postgres.stop()
        postgres.remove()
