"""The database's clock as an SQL expression: seconds since 1970 UTC, so that no two machines' clocks are compared."""

from typing import Any

from sqlalchemy import Double
from sqlalchemy.ext.compiler import compiles
from sqlalchemy.sql.functions import GenericFunction


class now_s(GenericFunction[float]):
    """`now_s()` in a statement is the present by the database's clock."""

    type = Double()
    name = "now_s"
    inherit_cache = True


@compiles(now_s, "sqlite")
def _on_sqlite(element: now_s, compiler: Any, **options: Any) -> str:  # noqa: ARG001
    return "((julianday('now') - 2440587.5) * 86400.0)"


@compiles(now_s, "postgresql")
def _on_postgresql(element: now_s, compiler: Any, **options: Any) -> str:  # noqa: ARG001
    return "extract(epoch from clock_timestamp())::double precision"
